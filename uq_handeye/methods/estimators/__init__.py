"""The published estimators of X in ``AX = XB``, by families, under one signature."""

from .method import Estimate, Method
from .registry import METHODS, ROBOT_WORLD_METHODS, solve
from .robot_world import RobotWorldMethod

__all__ = ["METHODS", "ROBOT_WORLD_METHODS", "Estimate", "Method", "RobotWorldMethod", "solve"]
