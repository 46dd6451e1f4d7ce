"""Geometry, numbers, files, text and pages, which all other packages use."""
