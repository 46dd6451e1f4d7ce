"""Studies of the live page."""
