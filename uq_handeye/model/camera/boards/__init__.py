"""Kinds of boards: their points, and how each is found in a picture."""
