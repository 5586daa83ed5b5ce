"""A case as one program for all its models: unknowns, readings, candidates, and the fit."""
