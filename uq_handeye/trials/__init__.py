"""Simulated trials: the noise of one problem drawn again and again, and any method run on each draw."""
