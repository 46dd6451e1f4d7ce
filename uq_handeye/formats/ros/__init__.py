"""Texts that ROS prints: transforms and poses of its messages, and the readers of its texts."""
