"""Models in the files of other tools: C, PyBaMM, MuJoCo; a module for each format, and those of other packages."""
