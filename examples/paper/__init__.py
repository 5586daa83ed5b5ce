"""The paper: its printed numbers, their simulation, and a report that compares both."""
