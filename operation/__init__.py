"""The model at work on a robot: compensating cold and load, estimating the charge, telling how long a mission lasts."""
