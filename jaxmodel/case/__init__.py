"""A measurement case: records of hardware and runs, read from files, written to them, simulated."""
