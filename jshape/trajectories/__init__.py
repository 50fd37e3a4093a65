"""Sampled trajectories of robots' joints: files of them, and what shaping each joint does to the path.

- ``files``: CSV, and JSON with the fields of ROS's JointTrajectory.
- ``shaping``: each joint shaped, and the deviation of the path.
"""
