"""Sensitivities of the readings to all candidates."""
