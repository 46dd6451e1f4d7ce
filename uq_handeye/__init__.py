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

import typing as _typing

if _typing.TYPE_CHECKING:
    from .calibration.calibrate import calibrate
    from .calibration.result import Calibration, load
    from .camera.board import Board, detect_board, tag_points
    from .camera.board_shape import BoardShape
    from .camera.calibrate import calibrate_camera
    from .camera.corners import Corners
    from .camera.files.board_file import read_board
    from .camera.files.corner_file import read_corners
    from .camera.files.folder import read_camera
    from .camera.files.intrinsics_file import read_intrinsics
    from .camera.measured_board import MeasuredBoard
    from .camera.result import CameraCalibration
    from .certificate.certificate import Certificate, make_certificate
    from .comparison.compare import compare
    from .comparison.result import Comparison
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
    from .evidence.absorb import include_touches
    from .evidence.touches import Touches
    from .geometry.conventions import from_convention, paper_from_theta, theta_from_paper, to_convention
    from .geometry.nearest_rotation import orthonormalise
    from .input_checks.board_rotation import resolve_board_rotation
    from .input_checks.pose_ambiguity import resolve_pose_ambiguity
    from .io import read_noise_file, read_poses, read_prior, read_shared_errors, read_stream
    from .kinematics.against_controller import ControllerComparison, compare_with_controller
    from .kinematics.chain import Joint, Kinematics
    from .kinematics.errors import ErrorParameter
    from .kinematics.joints_file import read_joints
    from .kinematics.kinematic_errors import KinematicErrors
    from .likelihood.gauss_helmert import bound, efficient, maximum_likelihood
    from .likelihood.rig_bundle import Agreement
    from .likelihood.shared_estimates import SharedEstimate
    from .live_session.api import Live, live
    from .maintenance.check import check
    from .maintenance.check_result import ChangeCheck
    from .maintenance.series.alarm import SeriesAlarm, series_alarm
    from .maintenance.series.log import CheckSeries, log_check, read_checks
    from .maintenance.together.difference import Difference, difference
    from .maintenance.together.update import update
    from .noise.camera_noise import CameraNoise
    from .noise.estimate import NoiseEstimate, NoisePrior
    from .noise.joint_covariance import JointCovariance
    from .noise.models import PairNoise, PoseNoise
    from .noise.pose_prior import PosePrior, parse_known_values
    from .one_model.component import Component
    from .one_model.noise_of_data import estimate_noise, estimate_robot_noise
    from .planning.plan import plan
    from .planning.result import Plan
    from .points.estimate import poses_from_points
    from .points.files.folder import read_point_poses
    from .points.files.point_file import read_points, read_target
    from .points.measured import PointSet, Target
    from .points.result import PointPoses
    from .poses.motions import Motions, relative_motions
    from .poses.pose_pairs import PosePairs
    from .poses.stream import Stream
    from .procrustes.limit import se3_from_so4, so4_from_se3
    from .procrustes.registration import register
    from .procrustes.so4_covariances import octonion_covariance, paper_covariances, so4_covariance
    from .propagation.propagate import propagate
    from .rig.calibrate import calibrate_rig
    from .rig.description import ArmPoses, Rig, View
    from .rig.files.rig_file import read_rig
    from .rig.in_use.update import update_rig
    from .rig.result import EstimatedPose, RigCalibration
    from .rig.simulation import simulate_rig
    from .rosbag.streams import read_bag
    from .shared_errors.camera_noise import camera_noise
    from .shared_errors.shared_error import SharedError
    from .simulation.rig import simulate
    from .simulation.sigma_points import SigmaPoints, sigma_points
    from .synchronisation.result import Synchronised
    from .synchronisation.synchronise import synchronise
    from .validation.cross_check.result import CrossCheck
    from .validation.cross_check.run import cross_check
    from .validation.monte_carlo.run import MonteCarlo, monte_carlo
    from .validation.posterior.density import ScalePrior
    from .validation.posterior.result import Posterior
    from .validation.posterior.sample import sample_posterior
    from .validation.sweep.run import Sweep, sweep
    from .verification.result import Verification
    from .verification.touches_file import read_touches
    from .verification.verify import verify

from ._version import __version__ as __version__

__all__ = [
    "METHODS",
    "ROBOT_WORLD_METHODS",
    "Agreement",
    "ArmPoses",
    "Board",
    "BoardShape",
    "Calibration",
    "CameraCalibration",
    "CameraNoise",
    "Certificate",
    "ChangeCheck",
    "CheckSeries",
    "Comparison",
    "Component",
    "ControllerComparison",
    "Corners",
    "CrossCheck",
    "DegenerateMotionError",
    "Difference",
    "ErrorParameter",
    "EstimatedPose",
    "InputError",
    "InputWarning",
    "Joint",
    "JointCovariance",
    "KinematicErrors",
    "Kinematics",
    "Live",
    "MeasuredBoard",
    "Method",
    "MissingExtraError",
    "MonteCarlo",
    "Motions",
    "NoiseEstimate",
    "NoisePrior",
    "NotConvergedError",
    "PairNoise",
    "Plan",
    "PointPoses",
    "PointSet",
    "PoseNoise",
    "PosePairs",
    "PosePrior",
    "Posterior",
    "Rig",
    "RigCalibration",
    "ScalePrior",
    "SeriesAlarm",
    "SharedError",
    "SharedEstimate",
    "SigmaPoints",
    "SingularNoiseError",
    "Stream",
    "Sweep",
    "Synchronised",
    "Target",
    "Touches",
    "Verification",
    "View",
    "bound",
    "calibrate",
    "calibrate_camera",
    "calibrate_rig",
    "camera_noise",
    "check",
    "compare",
    "compare_with_controller",
    "cross_check",
    "detect_board",
    "difference",
    "efficient",
    "estimate_noise",
    "estimate_robot_noise",
    "from_convention",
    "include_touches",
    "live",
    "load",
    "log_check",
    "make_certificate",
    "maximum_likelihood",
    "monte_carlo",
    "nguyen",
    "octonion_covariance",
    "orthonormalise",
    "paper_covariances",
    "paper_from_theta",
    "parse_known_values",
    "plan",
    "poses_from_points",
    "propagate",
    "read_bag",
    "read_board",
    "read_camera",
    "read_checks",
    "read_corners",
    "read_intrinsics",
    "read_joints",
    "read_noise_file",
    "read_point_poses",
    "read_points",
    "read_poses",
    "read_prior",
    "read_rig",
    "read_shared_errors",
    "read_stream",
    "read_target",
    "read_touches",
    "register",
    "relative_motions",
    "resolve_board_rotation",
    "resolve_pose_ambiguity",
    "sample_posterior",
    "se3_from_so4",
    "series_alarm",
    "sigma_points",
    "simulate",
    "simulate_rig",
    "so4_covariance",
    "so4_from_se3",
    "solve",
    "sweep",
    "synchronise",
    "tag_points",
    "theta_from_paper",
    "to_convention",
    "update",
    "update_rig",
    "verify",
]


# Everything is loaded when it is first asked for: the command starts in a third of the time, and Ctrl-C finds it ready.
_LATER = {
    "calibration.calibrate": ("calibrate",),
    "calibration.result": ("Calibration", "load"),
    "camera.board": (
        "Board",
        "detect_board",
        "tag_points",
    ),
    "camera.board_shape": ("BoardShape",),
    "camera.calibrate": ("calibrate_camera",),
    "camera.corners": ("Corners",),
    "camera.files.board_file": ("read_board",),
    "camera.files.corner_file": ("read_corners",),
    "camera.files.folder": ("read_camera",),
    "camera.files.intrinsics_file": ("read_intrinsics",),
    "camera.measured_board": ("MeasuredBoard",),
    "camera.result": ("CameraCalibration",),
    "certificate.certificate": (
        "Certificate",
        "make_certificate",
    ),
    "comparison.compare": ("compare",),
    "comparison.result": ("Comparison",),
    "errors": (
        "DegenerateMotionError",
        "InputError",
        "InputWarning",
        "MissingExtraError",
        "NotConvergedError",
        "SingularNoiseError",
    ),
    "estimators": (
        "METHODS",
        "Method",
        "ROBOT_WORLD_METHODS",
        "solve",
    ),
    "estimators.nguyen": ("nguyen",),
    "evidence.absorb": ("include_touches",),
    "evidence.touches": ("Touches",),
    "geometry.conventions": (
        "from_convention",
        "paper_from_theta",
        "theta_from_paper",
        "to_convention",
    ),
    "geometry.nearest_rotation": ("orthonormalise",),
    "io": (
        "read_noise_file",
        "read_poses",
        "read_prior",
        "read_shared_errors",
        "read_stream",
    ),
    "kinematics.against_controller": ("ControllerComparison", "compare_with_controller"),
    "kinematics.chain": (
        "Joint",
        "Kinematics",
    ),
    "kinematics.errors": ("ErrorParameter",),
    "kinematics.joints_file": ("read_joints",),
    "kinematics.kinematic_errors": ("KinematicErrors",),
    "likelihood.gauss_helmert": (
        "bound",
        "efficient",
        "maximum_likelihood",
    ),
    "likelihood.rig_bundle": ("Agreement",),
    "likelihood.shared_estimates": ("SharedEstimate",),
    "live_session.api": ("Live", "live"),
    "maintenance.check": ("check",),
    "maintenance.check_result": ("ChangeCheck",),
    "maintenance.series.alarm": ("SeriesAlarm", "series_alarm"),
    "maintenance.series.log": ("CheckSeries", "log_check", "read_checks"),
    "maintenance.together.difference": ("Difference", "difference"),
    "maintenance.together.update": ("update",),
    "noise.camera_noise": ("CameraNoise",),
    "noise.estimate": (
        "NoiseEstimate",
        "NoisePrior",
    ),
    "noise.joint_covariance": ("JointCovariance",),
    "noise.models": (
        "PairNoise",
        "PoseNoise",
    ),
    "noise.pose_prior": ("PosePrior", "parse_known_values"),
    "one_model.component": ("Component",),
    "one_model.noise_of_data": ("estimate_noise", "estimate_robot_noise"),
    "planning.plan": ("plan",),
    "planning.result": ("Plan",),
    "input_checks.board_rotation": ("resolve_board_rotation",),
    "input_checks.pose_ambiguity": ("resolve_pose_ambiguity",),
    "points.estimate": ("poses_from_points",),
    "points.files.folder": ("read_point_poses",),
    "points.files.point_file": ("read_points", "read_target"),
    "points.measured": ("PointSet", "Target"),
    "points.result": ("PointPoses",),
    "rig.calibrate": ("calibrate_rig",),
    "rig.description": ("ArmPoses", "Rig", "View"),
    "rig.in_use.update": ("update_rig",),
    "rig.result": ("EstimatedPose", "RigCalibration"),
    "rig.files.rig_file": ("read_rig",),
    "rig.simulation": ("simulate_rig",),
    "rosbag.streams": ("read_bag",),
    "shared_errors.camera_noise": ("camera_noise",),
    "poses.motions": (
        "Motions",
        "relative_motions",
    ),
    "poses.pose_pairs": ("PosePairs",),
    "poses.stream": ("Stream",),
    "procrustes.limit": (
        "se3_from_so4",
        "so4_from_se3",
    ),
    "procrustes.registration": ("register",),
    "procrustes.so4_covariances": (
        "octonion_covariance",
        "paper_covariances",
        "so4_covariance",
    ),
    "propagation.propagate": ("propagate",),
    "shared_errors.shared_error": ("SharedError",),
    "simulation.rig": ("simulate",),
    "simulation.sigma_points": (
        "SigmaPoints",
        "sigma_points",
    ),
    "synchronisation.result": ("Synchronised",),
    "synchronisation.synchronise": ("synchronise",),
    "validation.cross_check.result": ("CrossCheck",),
    "validation.cross_check.run": ("cross_check",),
    "validation.monte_carlo.run": (
        "MonteCarlo",
        "monte_carlo",
    ),
    "validation.posterior.density": ("ScalePrior",),
    "validation.posterior.result": ("Posterior",),
    "validation.posterior.sample": ("sample_posterior",),
    "validation.sweep.run": ("Sweep", "sweep"),
    "verification.result": ("Verification",),
    "verification.touches_file": ("read_touches",),
    "verification.verify": ("verify",),
}

# Earlier names, which keep working.
_RENAMED = {
    "AgainstController": "ControllerComparison",
    "against_controller": "compare_with_controller",
    "known": "parse_known_values",
    "resolve_turns": "resolve_board_rotation",
}


def __getattr__(name: str) -> _typing.Any:
    import warnings
    from importlib import import_module
    from importlib.util import find_spec

    if name in _RENAMED:
        warnings.warn(f"{name} is now called {_RENAMED[name]}.", DeprecationWarning, stacklevel=2)
        name = _RENAMED[name]
    module = next((module for module, names in _LATER.items() if name in names), None)
    if module is not None:
        value = globals()[name] = getattr(import_module(f".{module}", __name__), name)
        return value
    if not name.startswith("__") and find_spec(f"{__name__}.{name}") is not None:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
