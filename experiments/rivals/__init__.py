"""jshape beside every other way to move a flexible machine without vibration: ``python -m experiments.rivals``."""
