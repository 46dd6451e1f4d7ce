"""Adapters for programs of ROS; ROS itself is imported only where it is installed."""
