"""The fit of a camera: parameters, start, least squares, outlying corners, and the choice of the model."""
