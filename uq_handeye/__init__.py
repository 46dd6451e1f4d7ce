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
    from .calibration.by_scene import scene_poses
    from .calibration.calibrate import calibrate
    from .calibration.evidence.touches import Touches
    from .calibration.load import load
    from .calibration.of_camera import of_camera
    from .calibration.result import Calibration
    from .calibration.rig_by_scene import SceneRig, scene_rig
    from .calibration.rig_result import RigCalibration
    from .core.geometry.conventions import from_convention, paper_from_theta, theta_from_paper, to_convention
    from .core.geometry.nearest_rotation import orthonormalise
    from .core.geometry.uncertain_poses import covariance_of_inverse, fused_pose, relative_pose
    from .errors import (
        DegenerateMotionError,
        InputError,
        InputWarning,
        MissingExtraError,
        NotConvergedError,
        SingularNoiseError,
    )
    from .fit.diagnostics.board_rotation import resolve_board_rotation
    from .fit.diagnostics.pose_ambiguity import resolve_pose_ambiguity
    from .fit.graph.gauss_helmert import bound, efficient, maximum_likelihood
    from .fit.graph.noise_of_data import estimate_noise, estimate_robot_noise
    from .methods.method import Method
    from .methods.nguyen import nguyen
    from .methods.paper_covariances import octonion_covariance, paper_covariances, so4_covariance
    from .methods.propagate import propagate
    from .methods.registration import register
    from .methods.registry import METHODS, ROBOT_WORLD_METHODS, solve
    from .methods.scaled import se3_from_so4, so4_from_se3
    from .model.camera.board import detect_board
    from .model.camera.board_file import read_board
    from .model.camera.board_shape import BoardShape
    from .model.camera.calibrate import calibrate_camera
    from .model.camera.corners import Corners
    from .model.camera.corners_file import read_corners
    from .model.camera.description import Board, tag_points
    from .model.camera.intrinsics_file import read_intrinsics
    from .model.camera.measured_board import MeasuredBoard
    from .model.camera.result import CameraCalibration
    from .model.camera.stored_calibration import read_camera
    from .model.errors.camera_noise import CameraNoise
    from .model.errors.error_estimate import ErrorEstimate
    from .model.errors.joint_covariance import JointCovariance
    from .model.errors.known_values import parse_known_values
    from .model.errors.models import PairNoise, PoseNoise
    from .model.errors.noise_estimate import NoiseEstimate
    from .model.errors.pose_prior import PosePrior
    from .model.errors.sizes import NoisePrior
    from .model.errors.term import Component
    from .model.kinematics.against_controller import ControllerComparison, compare_with_controller
    from .model.kinematics.chain import Joint, Kinematics
    from .model.kinematics.errors import ErrorParameter
    from .model.kinematics.joints_file import read_joints
    from .model.kinematics.kinematic_errors import KinematicErrors
    from .model.points.estimate import poses_from_points
    from .model.points.measured import PointSet, Target
    from .model.points.point_file import read_points, read_target
    from .model.points.result import PointPoses, read_point_poses
    from .model.poses.estimated_pose import EstimatedPose
    from .model.poses.motions import Motions, relative_motions
    from .model.poses.pose_pairs import PosePairs
    from .model.poses.stream import Stream
    from .model.rig.description import ArmPoses, Rig, View
    from .model.shared_errors.camera_noise import camera_noise
    from .model.shared_errors.shared_error import SharedError
    from .read import (
        read_noise_file,
        read_pose_file,
        read_poses,
        read_prior,
        read_shared_errors,
        read_stream,
        write_pose_file,
    )
    from .read.rig.rig_file import read_rig
    from .read.rosbag.streams import read_bag
    from .read.synchronisation.result import Synchronised
    from .read.synchronisation.synchronise import synchronise
    from .report.certificate import Certificate, make_certificate
    from .report.comparison.compare import compare
    from .report.comparison.result import Comparison
    from .trials.simulation.rig import simulate
    from .trials.simulation.several_cameras import simulate_rig
    from .trials.validation.cross_check.result import CrossCheck
    from .trials.validation.cross_check.run import cross_check
    from .trials.validation.monte_carlo.run import MonteCarlo, monte_carlo
    from .trials.validation.posterior.density import ScalePrior
    from .trials.validation.posterior.result import Posterior
    from .trials.validation.posterior.sample import sample_posterior
    from .use.live_session.api import Live, live
    from .use.maintenance.check import check
    from .use.maintenance.check_result import ChangeCheck
    from .use.maintenance.difference import Difference, difference
    from .use.maintenance.log import CheckSeries, log_check, read_checks
    from .use.maintenance.update import include_touches, update
    from .use.planning.plan import plan
    from .use.planning.result import Plan
    from .use.verification.result import Verification
    from .use.verification.touches_file import read_touches
    from .use.verification.verify import verify

from ._version import __version__ as __version__

__all__ = [
    "METHODS",
    "ROBOT_WORLD_METHODS",
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
    "ErrorEstimate",
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
    "SceneRig",
    "SharedError",
    "SingularNoiseError",
    "Stream",
    "Synchronised",
    "Target",
    "Touches",
    "Verification",
    "View",
    "bound",
    "calibrate",
    "calibrate_camera",
    "camera_noise",
    "check",
    "compare",
    "compare_with_controller",
    "covariance_of_inverse",
    "cross_check",
    "detect_board",
    "difference",
    "efficient",
    "estimate_noise",
    "estimate_robot_noise",
    "from_convention",
    "fused_pose",
    "include_touches",
    "live",
    "load",
    "log_check",
    "make_certificate",
    "maximum_likelihood",
    "monte_carlo",
    "nguyen",
    "octonion_covariance",
    "of_camera",
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
    "read_pose_file",
    "read_poses",
    "read_prior",
    "read_rig",
    "read_shared_errors",
    "read_stream",
    "read_target",
    "read_touches",
    "register",
    "relative_motions",
    "relative_pose",
    "resolve_board_rotation",
    "resolve_pose_ambiguity",
    "sample_posterior",
    "scene_poses",
    "scene_rig",
    "se3_from_so4",
    "simulate",
    "simulate_rig",
    "so4_covariance",
    "so4_from_se3",
    "solve",
    "synchronise",
    "tag_points",
    "theta_from_paper",
    "to_convention",
    "update",
    "verify",
    "write_pose_file",
]


# Everything is loaded when it is first asked for: the command starts in a third of the time, and Ctrl-C finds it ready.
_LATER = {
    "calibration.by_scene": ("scene_poses",),
    "calibration.rig_by_scene": ("SceneRig", "scene_rig"),
    "calibration.calibrate": ("calibrate",),
    "calibration.of_camera": ("of_camera",),
    "calibration.load": ("load",),
    "calibration.result": ("Calibration",),
    "model.camera.board": ("detect_board",),
    "model.camera.description": ("Board", "tag_points"),
    "model.camera.board_shape": ("BoardShape",),
    "model.camera.measured_board": ("MeasuredBoard",),
    "model.camera.calibrate": ("calibrate_camera",),
    "model.camera.corners": ("Corners",),
    "model.camera.corners_file": ("read_corners",),
    "model.camera.board_file": ("read_board",),
    "model.camera.intrinsics_file": ("read_intrinsics",),
    "model.camera.result": ("CameraCalibration",),
    "model.camera.stored_calibration": ("read_camera",),
    "report.certificate": (
        "Certificate",
        "make_certificate",
    ),
    "report.comparison.compare": ("compare",),
    "report.comparison.result": ("Comparison",),
    "errors": (
        "DegenerateMotionError",
        "InputError",
        "InputWarning",
        "MissingExtraError",
        "NotConvergedError",
        "SingularNoiseError",
    ),
    "methods.method": ("Method",),
    "methods.registry": ("METHODS", "ROBOT_WORLD_METHODS", "solve"),
    "methods.nguyen": ("nguyen",),
    "calibration.evidence.touches": ("Touches",),
    "core.geometry.conventions": (
        "from_convention",
        "paper_from_theta",
        "theta_from_paper",
        "to_convention",
    ),
    "core.geometry.nearest_rotation": ("orthonormalise",),
    "core.geometry.uncertain_poses": ("covariance_of_inverse", "fused_pose", "relative_pose"),
    "read": (
        "read_noise_file",
        "read_pose_file",
        "read_poses",
        "read_prior",
        "read_shared_errors",
        "read_stream",
        "write_pose_file",
    ),
    "model.kinematics.against_controller": ("ControllerComparison", "compare_with_controller"),
    "model.kinematics.chain": (
        "Joint",
        "Kinematics",
    ),
    "model.kinematics.errors": ("ErrorParameter",),
    "model.kinematics.joints_file": ("read_joints",),
    "model.kinematics.kinematic_errors": ("KinematicErrors",),
    "fit.graph.gauss_helmert": (
        "bound",
        "efficient",
        "maximum_likelihood",
    ),
    "use.live_session.api": ("Live", "live"),
    "use.maintenance.check": ("check",),
    "use.maintenance.check_result": ("ChangeCheck",),
    "use.maintenance.log": ("CheckSeries", "log_check", "read_checks"),
    "use.maintenance.difference": ("Difference", "difference"),
    "use.maintenance.update": ("include_touches", "update"),
    "model.errors.noise_estimate": ("NoiseEstimate",),
    "model.errors.sizes": ("NoisePrior",),
    "model.errors.joint_covariance": ("JointCovariance",),
    "model.errors.camera_noise": ("CameraNoise",),
    "model.errors.known_values": ("parse_known_values",),
    "model.errors.models": ("PairNoise", "PoseNoise"),
    "model.errors.pose_prior": ("PosePrior",),
    "model.errors.error_estimate": ("ErrorEstimate",),
    "model.errors.term": ("Component",),
    "fit.graph.noise_of_data": ("estimate_noise", "estimate_robot_noise"),
    "use.planning.plan": ("plan",),
    "use.planning.result": ("Plan",),
    "fit.diagnostics.board_rotation": ("resolve_board_rotation",),
    "fit.diagnostics.pose_ambiguity": ("resolve_pose_ambiguity",),
    "model.points.estimate": ("poses_from_points",),
    "model.points.result": ("PointPoses", "read_point_poses"),
    "model.points.point_file": ("read_points", "read_target"),
    "model.points.measured": ("PointSet", "Target"),
    "model.rig.description": ("ArmPoses", "Rig", "View"),
    "model.poses.estimated_pose": ("EstimatedPose",),
    "calibration.rig_result": ("RigCalibration",),
    "read.rig.rig_file": ("read_rig",),
    "trials.simulation.several_cameras": ("simulate_rig",),
    "read.rosbag.streams": ("read_bag",),
    "model.shared_errors.camera_noise": ("camera_noise",),
    "model.poses.motions": (
        "Motions",
        "relative_motions",
    ),
    "model.poses.pose_pairs": ("PosePairs",),
    "model.poses.stream": ("Stream",),
    "methods.registration": ("register",),
    "methods.scaled": ("se3_from_so4", "so4_from_se3"),
    "methods.paper_covariances": (
        "octonion_covariance",
        "of_camera",
        "paper_covariances",
        "so4_covariance",
    ),
    "methods.propagate": ("propagate",),
    "model.shared_errors.shared_error": ("SharedError",),
    "trials.simulation.rig": ("simulate",),
    "read.synchronisation.result": ("Synchronised",),
    "read.synchronisation.synchronise": ("synchronise",),
    "trials.validation.cross_check.run": ("CrossCheck", "cross_check"),
    "trials.validation.monte_carlo.run": (
        "MonteCarlo",
        "monte_carlo",
    ),
    "trials.validation.posterior.density": ("ScalePrior",),
    "trials.validation.posterior.result": ("Posterior",),
    "trials.validation.posterior.sample": ("sample_posterior",),
    "use.verification.result": ("Verification",),
    "use.verification.touches_file": ("read_touches",),
    "use.verification.verify": ("verify",),
}


def __getattr__(name: str) -> _typing.Any:
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
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
