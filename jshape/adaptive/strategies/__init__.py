"""Strategies: what is identified, when, and how the shaper follows."""
