"""Poses as the controllers of robots write them: one maker per file."""
