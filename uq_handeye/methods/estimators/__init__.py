"""The published estimators of X in ``AX = XB``, one per file, under one signature."""

from .common.method import Estimate, Method
from .common.robot_world import RobotWorldMethod
from .registry import METHODS, ROBOT_WORLD_METHODS, solve

__all__ = ["METHODS", "ROBOT_WORLD_METHODS", "Estimate", "Method", "RobotWorldMethod", "solve"]
