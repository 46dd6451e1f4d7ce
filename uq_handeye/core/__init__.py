"""Geometry, reading and writing of files, and text and pages: what all other packages stand on."""
