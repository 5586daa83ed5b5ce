"""Noise of instruments, noise passed on from measured inputs, and the error of the model beside them."""
