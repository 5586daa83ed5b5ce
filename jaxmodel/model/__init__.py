"""The electro-thermal model of one cell, motor or robot: a pure step, scanned; batches stay outside."""
