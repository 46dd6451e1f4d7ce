"""Geometry, files, text and pages, on which all other packages stand."""
