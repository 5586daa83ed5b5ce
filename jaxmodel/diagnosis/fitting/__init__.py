"""One compiled program for all models of a case: unknowns, readings, candidates, and the fit."""
