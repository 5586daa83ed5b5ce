"""How the readings answer to everything that is not in a model."""
