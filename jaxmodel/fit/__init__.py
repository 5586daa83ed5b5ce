"""Calibration of any model of a case: unknowns, curves, weights, and how candidates would change the predictions."""
