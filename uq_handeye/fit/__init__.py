"""The fit of the joint model of poses and errors, and the checks of its residuals and of its geometry."""
