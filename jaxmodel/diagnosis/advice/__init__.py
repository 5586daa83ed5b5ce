"""Experiments that decide between models, identifiability of parameters, remarks, and a law as an effect."""
