"""Camera calibration: from board corners in pictures to intrinsics, camera poses and their joint covariance (T4b)."""

from . import sentences as sentences
