"""Measurements and their errors: noise, poses, arms, shared errors, cameras, points."""
