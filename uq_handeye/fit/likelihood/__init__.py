"""The Gauss-Helmert fit of X and W: its bound, robust weights and goodness of fit."""
