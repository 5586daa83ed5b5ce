"""`python -m jaxmodel`: the command line, where the script `jaxmodel` is not on the path."""

from jaxmodel.app.cli import main

if __name__ == "__main__":
    main()
