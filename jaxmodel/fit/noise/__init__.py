"""The noise of sensors: stated, or from the scatter of the readings."""
