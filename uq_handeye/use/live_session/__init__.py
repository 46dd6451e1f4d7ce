"""A calibration that grows: poses on disk, an answer after each, sources of poses, and the page in a browser."""
