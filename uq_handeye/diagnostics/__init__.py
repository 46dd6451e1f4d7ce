"""What residuals and geometry say about a calibration."""

from . import sentences as sentences
