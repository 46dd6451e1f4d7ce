"""A camera calibration as text, figures and page."""
