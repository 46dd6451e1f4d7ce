"""The data: pose pairs, motions, streams, their timing; residuals."""
