"""The Gauss-Helmert fit of X and W: its bound, robust weights, goodness of fit, and bundle adjustment."""
