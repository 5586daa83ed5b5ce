"""Thousands of combinations of parameters, inputs and effects through the model."""
