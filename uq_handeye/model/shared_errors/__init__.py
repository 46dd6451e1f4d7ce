"""Errors that all poses share: focal length, principal point, scales, clock offset; what they do to each pose."""
