"""Trainings, presets and the leaderboard of the environments."""
