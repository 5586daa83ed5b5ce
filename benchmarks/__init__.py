"""What is fast, against whom: each benchmark prints a ratio on the same work in one run, compile time apart."""
