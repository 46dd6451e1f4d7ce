"""Hand-eye calibration AX = XB with its uncertainty.

>>> import uq_handeye as uq
>>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
>>> poses = uq.simulate(n_poses=30, noise=noise, seed=1)
>>> result = uq.calibrate(poses, noise=noise)
>>> result.X.shape, result.covariance.shape
((4, 4), (6, 6))
>>> print(result.frame, (result.std[3:] * 1e3).round(2), "mm")
gripper_T_camera [0.34 0.34 0.28] mm
"""

from typing import TYPE_CHECKING, Any

from .calibration import calibrate
from .conventions import from_convention, paper_from_theta, theta_from_paper, to_convention
from .errors import (
    DegenerateMotionError,
    InputError,
    InputWarning,
    MissingExtraError,
    NotConvergedError,
    SingularNoiseError,
)
from .estimators import METHODS, ROBOT_WORLD_METHODS, Method, solve
from .estimators.nguyen import nguyen
from .io import read_noise_file, read_poses
from .likelihood import bound, efficient, maximum_likelihood
from .motions import Motions, relative_motions
from .noise import PairNoise, PoseNoise
from .noise_estimation import NoiseEstimate, NoisePrior, estimate_noise
from .octonion_covariance import octonion_covariance, paper_covariances, so4_covariance
from .poses import PosePairs
from .procrustes import orthonormalise, register, se3_from_so4, so4_from_se3
from .propagation import propagate
from .result import Calibration
from .simulation import simulate

if TYPE_CHECKING:
    from .comparison import Comparison, compare
    from .planning import Plan, plan
    from .sigma_point_covariance import SigmaPoints, sigma_points
    from .validation.cross_check import CrossCheck, cross_check
    from .validation.monte_carlo import MonteCarlo, monte_carlo
    from .validation.posterior import Posterior, sample_posterior
    from .validation.posterior_density import ScalePrior
    from .validation.sweep import Sweep, sweep

__version__ = "0.1.0"

__all__ = [
    "METHODS",
    "ROBOT_WORLD_METHODS",
    "Calibration",
    "Comparison",
    "CrossCheck",
    "DegenerateMotionError",
    "InputError",
    "InputWarning",
    "Method",
    "MissingExtraError",
    "MonteCarlo",
    "Motions",
    "NoiseEstimate",
    "NoisePrior",
    "NotConvergedError",
    "PairNoise",
    "Plan",
    "PoseNoise",
    "PosePairs",
    "Posterior",
    "ScalePrior",
    "SigmaPoints",
    "SingularNoiseError",
    "Sweep",
    "bound",
    "calibrate",
    "compare",
    "cross_check",
    "efficient",
    "estimate_noise",
    "from_convention",
    "maximum_likelihood",
    "monte_carlo",
    "nguyen",
    "octonion_covariance",
    "orthonormalise",
    "paper_covariances",
    "paper_from_theta",
    "plan",
    "propagate",
    "read_noise_file",
    "read_poses",
    "register",
    "relative_motions",
    "sample_posterior",
    "se3_from_so4",
    "sigma_points",
    "simulate",
    "so4_covariance",
    "so4_from_se3",
    "solve",
    "sweep",
    "theta_from_paper",
    "to_convention",
]


# What few programs need is loaded when it is first asked for.
_LATER = {
    "comparison": ("Comparison", "compare"),
    "planning": ("Plan", "plan"),
    "sigma_point_covariance": ("SigmaPoints", "sigma_points"),
    "validation.cross_check": ("CrossCheck", "cross_check"),
    "validation.monte_carlo": ("MonteCarlo", "monte_carlo"),
    "validation.posterior": ("Posterior", "sample_posterior"),
    "validation.posterior_density": ("ScalePrior",),
    "validation.sweep": ("Sweep", "sweep"),
}


def __getattr__(name: str) -> Any:
    module = next((module for module, names in _LATER.items() if name in names), None)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{module}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
