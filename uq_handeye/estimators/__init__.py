"""The published estimators of X in ``AX = XB``, one per file, under one signature."""

from .method import Estimate, Method
from .registry import METHODS, solve

__all__ = ["METHODS", "Estimate", "Method", "solve"]
