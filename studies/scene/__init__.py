"""Hand-eye calibration without a board, from rendered scenes and simulated tracks.

`pictures` draws textured scenes, `sessions` puts a robot to them.
"""
