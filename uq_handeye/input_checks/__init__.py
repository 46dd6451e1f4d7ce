"""Plausible misreadings of the input."""
