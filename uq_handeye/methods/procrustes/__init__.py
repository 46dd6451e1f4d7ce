"""4DPA: registration, its limit, finite d, sensitivities, SO(4) covariances."""
