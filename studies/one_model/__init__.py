"""Calibration with default settings on arms whose errors come from an independent simulator.

`chains` has nominal arms from makers' data sheets, `true_arms` the arms as they are, `views` the camera and the board,
`rigs` the data sets with their truth, `measure` the scores of `uq.calibrate` on them. Geometry is by NumPy, SciPy and
OpenCV alone: nothing here calls the kinematics of the package that is judged.
"""
