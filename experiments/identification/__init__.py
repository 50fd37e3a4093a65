"""Identification of what others have measured, on records made up after them."""
