"""Measure on each library what its six numbers of a pose are: pairs of covariances of one and the same error.

    python -m pip install -r studies/conventions/requirements.txt
    python -m studies.conventions.measure [NAME ...]

writes ``measured.json`` beside this file. Each entry has a pose ``T``, the covariance ``toolkit`` of its error
``xi = (theta, tau)`` (left rotation, additive translation), and the covariance ``library`` of the same error as the
library has it. Nothing of the toolkit is used: what a library does to a pose is differentiated numerically.

- Libraries that move poses (gtsam, jaxlie, symforce, sophuspy, factorama) or report an error of them (g2o): the
  derivative of xi by their six numbers gives ``library`` of a random covariance.
- Libraries that report a covariance or an information matrix of data (pycolmap, OpenCV, open3d, small_gicp):
  ``library`` is what they report; ``toolkit`` comes from the residuals of the same data, differentiated
  by xi at the same pose.
- Libraries that carry a covariance on (pytransform3d, napa-vision): ``library`` is what their documentation says, and
  ``of_inverse`` what they give to the inverse of the pose, which a wrong reading of ``library`` does not explain.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
FILE = Path(__file__).with_name("measured.json")
STEP = 1e-5  # of central differences, rad and m
K = np.array([[900.0, 0, 640], [0, 910, 360], [0, 0, 1]])


def pose(rotvec: list[float], t: list[float]) -> Array:
    """Return the pose of a rotation vector and a translation."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(rotvec).as_matrix(), t
    return T


# 108 deg, as a gripper in its base; 63 deg, as a board seen by a camera.
GENERIC = pose([1.1, -0.9, 1.2], [0.6, -0.4, 0.9])
SEEN = pose([0.8, -0.5, 0.6], [0.05, -0.03, 0.6])


def moved(T: Array, xi: Array) -> Array:
    """``exp([theta]x) R, t + tau``."""
    result = T.copy()
    result[:3, :3] = Rotation.from_rotvec(xi[:3]).as_matrix() @ T[:3, :3]
    result[:3, 3] += xi[3:]
    return result


def error(T: Array, base: Array) -> Array:
    """xi with ``T = moved(base, xi)``."""
    theta = Rotation.from_matrix(T[:3, :3] @ base[:3, :3].T).as_rotvec()
    return np.concatenate([theta, T[:3, 3] - base[:3, 3]])


def derivative(function: Callable[[Array], Array]) -> Array:
    """Central differences at 0 of six numbers."""
    steps = STEP * np.eye(6)
    return np.stack([(function(d) - function(-d)) / (2 * STEP) for d in steps], axis=-1)


def random_covariance() -> Array:
    """Return a covariance of about 2 mrad and 1 mm with correlations; always the same."""
    A = np.random.default_rng(7).normal(size=(6, 6)) + np.eye(6)
    scale = np.diag([2e-3, 1e-3, 3e-3, 1e-3, 4e-4, 2e-3])
    return scale @ A @ A.T @ scale


def by_moves(T: Array, move: Callable[[Array], Array]) -> dict[str, Any]:
    """Return the pair of a library that moves T by six numbers."""
    J = np.linalg.inv(derivative(lambda d: error(move(d), T)))
    S = random_covariance()
    return {"T": T, "toolkit": S, "library": J @ S @ J.T}


def by_residuals(T: Array, residuals: Callable[[Array], Array], library: Array) -> dict[str, Any]:
    """Return the pair of a library that reports the covariance of T of residuals (N) with a unit noise."""
    D = derivative(lambda xi: residuals(moved(T, xi)))
    return {"T": T, "toolkit": np.linalg.inv(D.T @ D), "library": library}


def board() -> Array:
    """Return the 54 corners of a chessboard, 20 mm apart."""
    x, y = np.meshgrid(np.arange(9), np.arange(6))
    return np.asarray(0.02 * np.stack([x.ravel(), y.ravel(), np.zeros(54)], axis=-1), dtype=float)


def pixels(T: Array, points: Array) -> Array:
    """Return the pixels (N, 2) of points seen at the pose ``camera_T_target``."""
    p = points @ T[:3, :3].T + T[:3, 3]
    return np.asarray(p[:, :2] / p[:, 2:] @ K[:2, :2].T + K[:2, 2], dtype=float)


def cloud() -> Array:
    """Return 200 points in a box of 2 x 1 x 0.5 m, more than 2 cm apart from each other."""
    rng, kept = np.random.default_rng(3), np.zeros((0, 3))
    while len(kept) < 200:
        p = rng.uniform([-1, -0.5, -0.25], [1, 0.5, 0.25])
        if not len(kept) or np.linalg.norm(kept - p, axis=1).min() > 0.02:
            kept = np.vstack([kept, p])
    return kept


def gtsam() -> dict[str, Any]:
    """Pose3 by retract."""
    lib: Any = import_module("gtsam")
    return by_moves(GENERIC, lambda d: np.asarray(lib.Pose3(GENERIC).retract(d).matrix()))


def jaxlie() -> dict[str, Any]:
    """SE3 times the exponential."""
    import_module("jax").config.update("jax_enable_x64", True)
    lib: Any = import_module("jaxlie")
    T = lib.SE3.from_matrix(GENERIC)
    return by_moves(GENERIC, lambda d: np.asarray((T @ lib.SE3.exp(np.asarray(d))).as_matrix(), dtype=float))


def sophus() -> dict[str, Any]:
    """SE3 times the exponential."""
    lib: Any = import_module("sophuspy")
    return by_moves(GENERIC, lambda d: np.asarray((lib.SE3(GENERIC) * lib.SE3.exp(d)).matrix()))


def symforce() -> dict[str, Any]:
    """Pose3 by retract."""
    import_module("symforce").set_epsilon_to_number()
    lib: Any = import_module("sym")
    T = lib.Pose3(lib.Rot3(Rotation.from_matrix(GENERIC[:3, :3]).as_quat()), GENERIC[:3, 3])
    return by_moves(GENERIC, lambda d: np.asarray(T.retract(np.asarray(d), 1e-12).to_homogenous_matrix(), dtype=float))


def g2o() -> dict[str, Any]:
    """EdgeSE3: its error of the measurement T, the numbers that the information of EDGE_SE3:QUAT is of."""
    lib: Any = import_module("g2o")
    first, second, edge = lib.VertexSE3(), lib.VertexSE3(), lib.EdgeSE3()
    first.set_estimate(lib.Isometry3d(np.eye(4)))
    edge.set_vertex(0, first)
    edge.set_vertex(1, second)
    edge.set_measurement(lib.Isometry3d(GENERIC))

    def of(xi: Array) -> Array:
        second.set_estimate(lib.Isometry3d(moved(GENERIC, xi)))
        edge.compute_error()
        return np.array(edge.error(), dtype=float).ravel()

    J, S = derivative(of), random_covariance()
    return {"T": GENERIC, "toolkit": S, "library": J @ S @ J.T}


def factorama() -> dict[str, Any]:
    """PoseVariable by its increment; T is world_T_camera."""
    lib: Any = import_module("factorama")

    def move(d: Array) -> Array:
        variable = lib.PoseVariable(0, GENERIC[:3, 3], GENERIC[:3, :3].T)
        variable.apply_increment(d)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.asarray(variable.dcm_CW()).T, np.ravel(variable.pos_W())
        return T

    return by_moves(GENERIC, move)


def pycolmap() -> dict[str, Any]:
    """refine_absolute_pose of exact points without a robust loss; T is cam_from_world."""
    lib: Any = import_module("pycolmap")
    points, options = board(), lib.AbsolutePoseRefinementOptions()
    if hasattr(options, "loss_function_scale"):
        options.loss_function_scale = 1e6
    camera = lib.Camera(model="PINHOLE", width=1280, height=720, params=[K[0, 0], K[1, 1], K[0, 2], K[1, 2]])
    start = lib.Rigid3d(lib.Rotation3d(Rotation.from_matrix(SEEN[:3, :3]).as_quat()), SEEN[:3, 3])
    mask = np.ones((len(points), 1), dtype=bool)
    found = lib.refine_absolute_pose(start, pixels(SEEN, points), points, mask, camera, options, True)
    T = np.eye(4)
    T[:3] = found["cam_from_world"].matrix()
    S = next(np.asarray(value) for value in found.values() if np.shape(value) == (6, 6))
    return by_residuals(T, lambda at: pixels(at, points).ravel(), S)


def opencv() -> dict[str, Any]:
    """The Jacobian of projectPoints by rvec and tvec, whose inverse normal matrix calibrateCameraExtended reports."""
    lib: Any = import_module("cv2")
    points, rvec = board(), Rotation.from_matrix(SEEN[:3, :3]).as_rotvec()
    J = lib.projectPoints(points, rvec, SEEN[:3, 3], K, None)[1][:, :6]
    return by_residuals(SEEN, lambda at: pixels(at, points).ravel(), np.linalg.inv(J.T @ J))


def open3d() -> dict[str, Any]:
    """get_information_matrix_from_point_clouds; T is target_T_source."""
    lib: Any = import_module("open3d")
    points = cloud()
    clouds = [lib.geometry.PointCloud(lib.utility.Vector3dVector(p))
              for p in (points, points @ GENERIC[:3, :3].T + GENERIC[:3, 3])]  # fmt: skip
    L = lib.pipelines.registration.get_information_matrix_from_point_clouds(*clouds, 1e-3, GENERIC)
    return by_residuals(GENERIC, lambda at: (points @ at[:3, :3].T + at[:3, 3]).ravel(), np.linalg.inv(L))


def small_gicp() -> dict[str, Any]:
    """RegistrationResult.H of ICP on exact points; T is T_target_source."""
    lib: Any = import_module("small_gicp")
    points = cloud()
    target = lib.PointCloud(points @ GENERIC[:3, :3].T + GENERIC[:3, 3])
    found = lib.align(target, lib.PointCloud(points), lib.KdTree(target), GENERIC, "ICP", 1e-2)
    T = np.asarray(found.T_target_source)
    return by_residuals(T, lambda at: (points @ at[:3, :3].T + at[:3, 3]).ravel(), np.linalg.inv(found.H))


def napa() -> dict[str, Any]:
    """PoseWithCovariance.inverse of a covariance in the order of ROS."""
    lib: Any = import_module("napa_vision")
    S = random_covariance()
    L = np.roll(S, (3, 3), (0, 1))
    return {
        "T": GENERIC,
        "toolkit": S,
        "library": L,
        "of_inverse": lib.PoseWithCovariance(GENERIC, L).inverse().covariance,
    }


def pytransform3d() -> dict[str, Any]:
    """invert_uncertain_transform of the covariance of a left twist."""
    lib: Any = import_module("pytransform3d.uncertainty")
    exponential: Any = import_module("pytransform3d.transformations").transform_from_exponential_coordinates
    pair = by_moves(GENERIC, lambda d: np.asarray(exponential(d)) @ GENERIC)
    return pair | {"of_inverse": lib.invert_uncertain_transform(GENERIC, pair["library"])[1]}


# Distribution of each.
LIBRARIES: dict[str, tuple[Callable[[], dict[str, Any]], str]] = {
    "gtsam": (gtsam, "gtsam"),
    "jaxlie": (jaxlie, "jaxlie"),
    "sophus": (sophus, "sophuspy"),
    "symforce": (symforce, "symforce"),
    "g2o": (g2o, "g2o-python"),
    "factorama": (factorama, "factorama"),
    "pycolmap": (pycolmap, "pycolmap"),
    "opencv": (opencv, "opencv-python-headless"),
    "open3d": (open3d, "open3d"),
    "small-gicp": (small_gicp, "small_gicp"),
    "napa": (napa, "napa-vision"),
    "pytransform3d": (pytransform3d, "pytransform3d"),
}


def plain(value: Any) -> Any:
    """Return arrays as lists of twelve digits."""
    return [[float(f"{x:.12g}") for x in row] for row in np.asarray(value, dtype=float)]


def main(names: list[str]) -> None:
    """Measure the libraries named, or all, and write the file; what is not named stays as it is."""
    found = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    for name in names or LIBRARIES:
        measure, distribution = LIBRARIES[name]
        about = {"version": f"{distribution} {metadata.version(distribution)}", "function": (measure.__doc__ or "")}
        about["function"] = " ".join(about["function"].split())
        found[name] = about | {key: plain(value) for key, value in measure().items()}
        print(name, found[name]["version"])
    entries = (f" {json.dumps(name)}: {json.dumps(entry)}" for name, entry in sorted(found.items()))
    FILE.write_text("{\n" + ",\n".join(entries) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
