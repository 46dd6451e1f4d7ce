"""The graph of unknown poses and views: its start, fit, noise, sizes and robust weights (T18)."""
