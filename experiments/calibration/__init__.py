"""A simulated accelerometer record of a printer."""
