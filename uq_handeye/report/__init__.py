"""Reports, comparisons of methods and certificates of a calibration, as pages, figures and data."""
