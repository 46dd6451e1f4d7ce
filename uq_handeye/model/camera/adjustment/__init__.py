"""The fit of a camera: what is estimated, its start, least squares, outlying corners, and the choice of the model."""
