"""Errors that all poses share (focal length, principal point, scales, clock offset), and their effect on each pose."""
