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

if TYPE_CHECKING:
    from .calibration import calibrate
    from .camera.board import Board, detect_board
    from .camera.calibration import CameraCalibration, calibrate_camera
    from .camera.corner_file import read_corners
    from .camera.corners import Corners
    from .camera.folder import read_camera
    from .camera.intrinsics_file import read_intrinsics
    from .camera.turns import resolve_turns
    from .comparison import Comparison, compare
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
    from .io import read_noise_file, read_poses, read_stream
    from .joint_covariance import JointCovariance
    from .likelihood import bound, efficient, maximum_likelihood
    from .motions import Motions, relative_motions
    from .noise import PairNoise, PoseNoise
    from .noise_estimate import NoiseEstimate, NoisePrior
    from .noise_estimation import estimate_noise
    from .planning import Plan, plan
    from .poses import PosePairs
    from .procrustes import orthonormalise, register, se3_from_so4, so4_from_se3
    from .propagation import propagate
    from .result import Calibration
    from .rig_bundle import Agreement
    from .robot_noise import estimate_robot_noise
    from .sigma_point_covariance import SigmaPoints, sigma_points
    from .simulation import simulate
    from .so4_covariances import octonion_covariance, paper_covariances, so4_covariance
    from .streams import Stream
    from .synchronisation import synchronise
    from .synchronised import Synchronised
    from .validation.cross_check import CrossCheck, cross_check
    from .validation.monte_carlo import MonteCarlo, monte_carlo
    from .validation.posterior import Posterior, sample_posterior
    from .validation.posterior_density import ScalePrior
    from .validation.sweep import Sweep, sweep

__version__ = "0.1.0"

__all__ = [
    "METHODS",
    "ROBOT_WORLD_METHODS",
    "Agreement",
    "Board",
    "Calibration",
    "CameraCalibration",
    "Comparison",
    "Corners",
    "CrossCheck",
    "DegenerateMotionError",
    "InputError",
    "InputWarning",
    "JointCovariance",
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
    "Stream",
    "Sweep",
    "Synchronised",
    "bound",
    "calibrate",
    "calibrate_camera",
    "compare",
    "cross_check",
    "detect_board",
    "efficient",
    "estimate_noise",
    "estimate_robot_noise",
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
    "read_camera",
    "read_corners",
    "read_intrinsics",
    "read_noise_file",
    "read_poses",
    "read_stream",
    "register",
    "relative_motions",
    "resolve_turns",
    "sample_posterior",
    "se3_from_so4",
    "sigma_points",
    "simulate",
    "so4_covariance",
    "so4_from_se3",
    "solve",
    "sweep",
    "synchronise",
    "theta_from_paper",
    "to_convention",
]


# Everything is loaded when it is first asked for: the command starts in a third of the time, and Ctrl-C finds it ready.
_LATER = {
    "calibration": ("calibrate",),
    "camera.calibration": ("CameraCalibration", "calibrate_camera"),
    "camera.board": ("Board", "detect_board"),
    "camera.corner_file": ("read_corners",),
    "camera.corners": ("Corners",),
    "camera.folder": ("read_camera",),
    "camera.intrinsics_file": ("read_intrinsics",),
    "camera.turns": ("resolve_turns",),
    "conventions": ("from_convention", "paper_from_theta", "theta_from_paper", "to_convention"),
    "errors": (
        "DegenerateMotionError",
        "InputError",
        "InputWarning",
        "MissingExtraError",
        "NotConvergedError",
        "SingularNoiseError",
    ),
    "estimators": ("METHODS", "ROBOT_WORLD_METHODS", "Method", "solve"),
    "estimators.nguyen": ("nguyen",),
    "io": ("read_noise_file", "read_poses", "read_stream"),
    "joint_covariance": ("JointCovariance",),
    "likelihood": ("bound", "efficient", "maximum_likelihood"),
    "motions": ("Motions", "relative_motions"),
    "noise": ("PairNoise", "PoseNoise"),
    "noise_estimate": ("NoiseEstimate", "NoisePrior"),
    "noise_estimation": ("estimate_noise",),
    "so4_covariances": ("octonion_covariance", "paper_covariances", "so4_covariance"),
    "poses": ("PosePairs",),
    "procrustes": ("orthonormalise", "register", "se3_from_so4", "so4_from_se3"),
    "propagation": ("propagate",),
    "result": ("Calibration",),
    "rig_bundle": ("Agreement",),
    "robot_noise": ("estimate_robot_noise",),
    "simulation": ("simulate",),
    "streams": ("Stream",),
    "comparison": ("Comparison", "compare"),
    "planning": ("Plan", "plan"),
    "sigma_point_covariance": ("SigmaPoints", "sigma_points"),
    "synchronisation": ("synchronise",),
    "synchronised": ("Synchronised",),
    "validation.cross_check": ("CrossCheck", "cross_check"),
    "validation.monte_carlo": ("MonteCarlo", "monte_carlo"),
    "validation.posterior": ("Posterior", "sample_posterior"),
    "validation.posterior_density": ("ScalePrior",),
    "validation.sweep": ("Sweep", "sweep"),
}


def __getattr__(name: str) -> Any:
    from importlib import import_module
    from importlib.util import find_spec

    module = next((module for module, names in _LATER.items() if name in names), None)
    if module is not None:
        value = globals()[name] = getattr(import_module(f".{module}", __name__), name)
        return value
    if not name.startswith("__") and find_spec(f"{__name__}.{name}") is not None:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
