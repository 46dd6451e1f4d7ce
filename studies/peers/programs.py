"""The programs of the study of peers: how each is given poses and their noise, and what it gives back.

All see the same poses ``G_i X C_i = W`` (eye-in-hand) and start from nothing else. GTSAM and SymForce have no hand-eye
solver: the graph is written here (SymForce) or in tests/fixtures/gtsam_graphs.py (GTSAM), with latent robot poses, the
model of `ml`, from 4DPA's X. Covariances are converted to ``xi = (theta, tau)``: left rotation, additive translation,
rad and m. A program that is not installed is left out.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common.gtsam_graphs import gtsam_graphs
from studies.common.study import version_of
from uq_handeye.core.geometry.se3 import Array, block, inverse
from uq_handeye.methods.all_pairs import solve_all_pairs
from uq_handeye.methods.target_pose import mean_target
from uq_handeye.model.errors.cholesky import factor

Found = tuple[Array, Array | None]  # X (4, 4), covariance (6, 6) or None
Prepared = Callable[[], Found]


@dataclass(frozen=True)
class Program:
    """``prepare(poses, noise)`` does what is not timed, and gives the call that is."""

    name: str
    version: str
    method: str
    prepare: Callable[[uq.PosePairs, uq.PoseNoise], Prepared]
    told: bool = False  # whether it is given the noise
    slow: bool = False  # run in a tenth of the trials

    @property
    def label(self) -> str:
        return f"{self.name}, {self.method}"


@dataclass(frozen=True)
class Peer:
    """A package that may be installed."""

    name: str
    package: str  # on PyPI
    module: str
    gives: str
    programs: Callable[[], Iterator[Program]]

    @property
    def version(self) -> str:
        return version_of(self.package) if find_spec(self.module) is not None else "not installed"


# ------------------------------------------------------------------------------------------------- uq-handeye


def _toolkit() -> Iterator[Program]:
    def of(estimator: Callable[[uq.PosePairs, uq.PoseNoise], Any]) -> Callable[..., Prepared]:
        def prepare(poses: uq.PosePairs, noise: uq.PoseNoise) -> Prepared:
            def run() -> Found:
                found = estimator(poses, noise)
                return found.X, found.covariance_X

            return run

        return prepare

    yield Program("uq-handeye", uq.__version__, "efficient", of(uq.efficient), told=True)
    yield Program("uq-handeye", uq.__version__, "ml", of(uq.maximum_likelihood), told=True)


# ----------------------------------------------------------------------------------------------------- OpenCV


def _opencv() -> Iterator[Program]:
    cv2: Any = importlib.import_module("cv2")
    if not hasattr(cv2, "calibrateHandEye"):  # OpenCV 5.0
        return

    def hand_eye(method: int) -> Callable[..., Prepared]:
        def prepare(poses: uq.PosePairs, noise: uq.PoseNoise) -> Prepared:
            G, C = poses.robot, poses.camera

            def run() -> Found:
                R, t = cv2.calibrateHandEye(G[:, :3, :3], G[:, :3, 3], C[:, :3, :3], C[:, :3, 3], method=method)
                return _transform(R, t), None

            return run

        return prepare

    def robot_world(method: int) -> Callable[..., Prepared]:
        """``camera_T_target base_T_target^-1 = X^-1 gripper_T_base``: its second pair is that of the gripper."""

        def prepare(poses: uq.PosePairs, noise: uq.PoseNoise) -> Prepared:
            C, G = poses.camera, inverse(poses.robot)

            def run() -> Found:
                _, _, R, t = cv2.calibrateRobotWorldHandEye(
                    C[:, :3, :3], C[:, :3, 3], G[:, :3, :3], G[:, :3, 3], method=method
                )
                return inverse(_transform(R, t)), None

            return run

        return prepare

    for name in ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS"):
        number = getattr(cv2, f"CALIB_HAND_EYE_{name}")
        yield Program("OpenCV", cv2.__version__, name.title(), hand_eye(number))
    for name in ("SHAH", "LI"):
        number = getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}")
        yield Program("OpenCV", cv2.__version__, name.title(), robot_world(number))


def _transform(R: Any, t: Any) -> Array:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, np.ravel(t)
    return X


# ------------------------------------------------------------------------------------------------------ GTSAM


def _gtsam() -> Iterator[Program]:
    graphs = gtsam_graphs()
    gtsam = graphs.gtsam

    def with_graph(graph_of: Callable[..., Any]) -> Callable[..., Prepared]:
        def prepare(poses: uq.PosePairs, noise: uq.PoseNoise) -> Prepared:
            graph, start = graph_of(poses, noise), gtsam.Values()
            X = solve_all_pairs(poses)
            for key, T in ((graphs.x, X), (graphs.w, mean_target(poses, X))):
                start.insert(key, gtsam.Pose3(T))
            for k, T in enumerate(poses.robot):
                start.insert(gtsam.symbol("g", k), gtsam.Pose3(T))

            def run() -> Found:
                values = gtsam.LevenbergMarquardtOptimizer(graph, start, gtsam.LevenbergMarquardtParams()).optimize()
                found = values.atPose3(graphs.x).matrix()
                S = gtsam.Marginals(graph, values).marginalCovariance(graphs.x)
                return found, uq.from_convention(S, found, "gtsam")

            return run

        return prepare

    yield Program("GTSAM", version_of("gtsam"), "latent poses", with_graph(graphs.native), told=True)


# --------------------------------------------------------------------------------------------------- SymForce


@cache
def _symforce_optimizer(n: int) -> Any:
    """Return the optimiser of n poses; what it generates the first time in a process takes seconds and serves every
    n.
    """
    # of the code that it generates; before all else of it is imported
    importlib.import_module("symforce").set_epsilon_to_number()
    sf: Any = importlib.import_module("symforce.symbolic")
    Factor = importlib.import_module("symforce.opt.factor").Factor
    Optimizer = importlib.import_module("symforce.opt.optimizer").Optimizer

    def error(measured: Any, T: Any, epsilon: Any) -> Any:
        turn = measured.R * T.R.inverse()
        return sf.V6(*turn.to_tangent(epsilon), *(measured.t - T.t))

    def robot(G, measured, weight, epsilon):  # type: ignore[no-untyped-def]
        return weight * error(measured, G, epsilon)

    def camera(G, X, W, measured, weight, epsilon):  # type: ignore[no-untyped-def]
        return weight * error(measured, X.inverse() * G.inverse() * W, epsilon)

    pose, square = sf.Pose3, sf.Matrix66
    robot.__annotations__ = {"G": pose, "measured": pose, "weight": square, "epsilon": sf.Scalar, "return": sf.V6}
    camera.__annotations__ = {"G": pose, "X": pose, "W": pose} | robot.__annotations__
    factors = []
    for k in range(n):
        factors.append(Factor([f"G[{k}]", f"robot[{k}]", "of_robot", "epsilon"], robot))
        factors.append(Factor([f"G[{k}]", "X", "W", f"camera[{k}]", "of_camera", "epsilon"], camera))
    keys = ["X", "W", *(f"G[{k}]" for k in range(n))]
    return Optimizer(factors, keys, params=Optimizer.Params(verbose=False))


def _symforce() -> Iterator[Program]:
    def pose(T: Array) -> Any:
        sym: Any = importlib.import_module("sym")
        return sym.Pose3(R=sym.Rot3(Rotation.from_matrix(T[:3, :3]).as_quat()), t=T[:3, 3])

    def prepare(poses: uq.PosePairs, noise: uq.PoseNoise) -> Prepared:
        assert noise.robot is not None
        assert noise.camera is not None
        optimizer = _symforce_optimizer(poses.n)
        Values = importlib.import_module("symforce.values").Values  # after the optimiser has set it up
        X = solve_all_pairs(poses)
        values = Values(
            X=pose(X),
            W=pose(mean_target(poses, X)),
            of_robot=np.linalg.inv(factor(noise.robot)),
            of_camera=np.linalg.inv(factor(noise.camera)),
            epsilon=1e-12,
        )
        values["G"] = values["robot"] = [pose(T) for T in poses.robot]
        values["camera"] = [pose(T) for T in poses.camera]

        def run() -> Found:
            found = optimizer.optimize(values).optimized_values
            S = optimizer.compute_covariances(found, ["X", "W"])["X"]
            R = np.asarray(found["X"].R.to_rotation_matrix())
            to_left = block(R, 0.0, 0.0, np.eye(3))  # its rotation errors are on the right, its translations additive
            return _transform(R, found["X"].t), to_left @ S @ to_left.T

        return run

    yield Program("SymForce", version_of("symforce"), "latent poses", prepare, told=True, slow=True)


# -------------------------------------------------------------------------------------- scikit-surgerycalibration


def _surgery() -> Iterator[Program]:
    hand_eye: Any = importlib.import_module("sksurgerycalibration.video.video_calibration_hand_eye")

    def prepare(poses: uq.PosePairs, noise: uq.PoseNoise) -> Prepared:
        rotations = list(Rotation.from_matrix(poses.camera[:, :3, :3]).as_rotvec())
        translations = list(poses.camera[:, :3, 3])
        still = [np.eye(4)] * poses.n  # the target is tracked in its own frame

        def run() -> Found:
            q, t = hand_eye.set_model2hand_arrays(still, list(poses.robot))
            camera_T_gripper, _ = hand_eye.guofang_xiao_handeye_calibration(rotations, translations, q, t)
            return inverse(np.asarray(camera_T_gripper)), None

        return run

    yield Program("scikit-surgerycalibration", version_of("scikit-surgerycalibration"), "Xiao", prepare, slow=True)


PEERS = (
    Peer("OpenCV", "opencv-python-headless", "cv2", "X by 7 methods; no covariance", _opencv),
    Peer(
        "scikit-surgerycalibration",
        "scikit-surgerycalibration",
        "sksurgerycalibration",
        "X by a method of its own (Xiao) or OpenCV's; no covariance",
        _surgery,
    ),
    Peer("GTSAM", "gtsam", "gtsam", "an optimiser; the graph is the user's; covariance of X", _gtsam),
    Peer("SymForce", "symforce", "symforce", "an optimiser; the residuals are the user's; covariance of X", _symforce),
    Peer("uq-handeye", "uq-handeye", "uq_handeye", "X by 17 methods, efficient and ml; covariance of X", _toolkit),
)


def installed() -> list[Program]:
    """All programs of the peers that are installed, in this order."""
    return [program for peer in PEERS if find_spec(peer.module) is not None for program in peer.programs()]
