"""Sampled trajectories of robots' joints: files of them, and what shaping each joint does to the path."""
