"""Sensor noise, noise caused by measured inputs, and the model error."""
