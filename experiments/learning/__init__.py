"""Trainings and the leaderboard of the environments."""
