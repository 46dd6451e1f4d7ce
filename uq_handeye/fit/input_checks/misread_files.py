"""Other readings of the two files that would fit (setup, direction, rotations, unit), and how to ask for them.

`checks` asks where X does not explain the poses. A reading is a dictionary of plain values: its ``kind`` ("inverse
robot", "inverse camera", "quaternion", "transposed", "mirrored", "scale") and what belongs to it; `sentences` names the
argument of `read_poses` and the option. The likeliest reading comes first.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ...core.files.source import Source
from ...core.formatting.units import LENGTH_UNITS
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, inverse
from ...errors import DegenerateMotionError
from ...findings import Finding
from ...methods.procrustes.limit import solve_limit
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.residuals import pose_residuals, rotation_angles
from ...model.poses.target_views import STEADY_VIEW, direction_spread
from .readings import OTHER_SETUP

# Rotation residual (rad) beyond which another reading of the files is looked for.
LARGE_ROTATION = np.radians(2.0)
# Pairs of poses that are looked at.
SEARCH_PAIRS = 2000
# Data without noise, from a simulation, say nothing about noise (rad, or share of the travel).
EXACT = 1e-7
# Of two readings that fit, the worse is named if its translation residuals are below so many times those of the better.
ALIKE = 4.0
# Translations (m) below which a file was read in too small a unit.
SMALL = 0.02
# Readings of which one comes with the other.
INVERSE = ("inverse robot", "inverse camera")
# Another reading fits if its translation residuals are below this share of the travel of the robot.
MAX_MISFIT_SHARE = 0.2
# A factor (its logarithm) is that of a unit within these: of 2.54, and of 10, 25.4 and more, which no target has.
UNIT_NEAR, UNIT_FAR = 0.03, 0.15


def other_readings(poses: PosePairs, turn: float, shift: float) -> list[dict[str, Any]]:
    """The inversions, orders, transpositions or units that make W constant in rotation *and* translation.

    If ``G X C = W`` is constant, so is ``inv(G) W inv(C) = X``: inverting one of the two lists breaks the fit,
    inverting the other as well restores it with the roles of X and W exchanged. So inversions come in twos
    (`_inversions`). Of all others two are named at most.
    """
    G, C = poses.effective_robot, poses.camera
    other = OTHER_SETUP[poses.setup]
    on_request = {f"inverse {side}": {"given": True} for side in inverted_on_request(poses)}
    candidates: list[tuple[dict[str, Any], Array, Array]] = [
        ({"kind": "inverse robot", "setup": other}, inverse(G), C),
        ({"kind": "inverse camera", "setup": other}, G, inverse(C)),
    ]
    twins = {}
    for reading, robot, camera in rotation_readings(poses.robot, C):
        candidates.append((reading, robot if poses.setup == "eye-in-hand" else inverse(robot), camera))
    fitting: list[tuple[float, dict[str, Any]]] = []
    largest = MAX_MISFIT_SHARE * float(np.linalg.norm(np.std(G[:, :3, 3], axis=0)))
    for reading, robot, camera in candidates:
        fit = consistency(robot, camera)
        if fit is not None and reading["kind"] in INVERSE:
            twins[reading["kind"]] = reading | {"length": fit[2]} | on_request.get(reading["kind"], {})
        if fit is not None and fit[1] > largest:
            continue
        # Two files in the same wrong order agree in rotation; only their translations tell.
        turns = fit is not None and (fit[0] < max(0.4 * turn, EXACT) or fit[0] < 1.5 * turn < 1.5 * LARGE_ROTATION)
        # The camera's rotation is not in the translation of W, which may fit already.
        only_turns = fit is not None and fit[0] < 0.1 * turn and fit[1] < 1.5 * shift
        if fit is not None and ((turns and fit[1] < 0.4 * shift) or only_turns):
            fitting.append((fit[1], reading | {"length": fit[2]}))
    best = min((left for left, _ in fitting), default=0.0)
    fitting = [(left, reading) for left, reading in fitting if left < ALIKE * best + EXACT]
    found = [reading for _, reading in sorted(fitting, key=lambda found: found[0])[:2]]
    if len(twins) == 2 and any(reading["kind"] in INVERSE for reading in found):
        found = [reading for reading in found if reading["kind"] not in INVERSE]
        found = [*_inversions(poses, twins["inverse robot"], twins["inverse camera"]), *found[:1]]
    scaled = scaled_reading(G, C, shift, poses.sources)
    return found if scaled is None else [*found, scaled]


def consistency(G: Array, C: Array) -> tuple[float, float, float] | None:
    """Return RMS rotation and translation of W about its mean, and |t_X|, of X fitted to some of the pairs."""
    n = len(G)
    lag = np.unique(np.linspace(1, n - 1, max(1, SEARCH_PAIRS // n)).astype(int))
    i = np.concatenate([np.arange(n - k) for k in lag])
    j = np.concatenate([np.arange(k, n) for k in lag])
    A, B = inverse(G)[j] @ G[i], C[j] @ inverse(C)[i]
    try:
        X = solve_limit(A, B)
    except DegenerateMotionError:
        return None
    angle, distance = pose_residuals(G, C, X)
    return float(np.sqrt(np.mean(angle**2))), float(np.sqrt(np.mean(distance**2))), float(np.linalg.norm(X[:3, 3]))


def rotation_readings(robot: Array, camera: Array) -> list[tuple[dict[str, Any], Array, Array]]:
    """Return each other reading of the rotations of one file or both, with the poses (n, 4, 4) that it makes."""
    found: list[tuple[dict[str, Any], Array, Array]] = []
    changed = [({"kind": "transposed"}, _transposed(robot), _transposed(camera))]
    changed += [
        ({"kind": "quaternion", "order": order}, _reordered(robot, shift_by), _reordered(camera, shift_by))
        for shift_by, order in ((-1, "wxyz"), (1, "xyzw"))
    ]
    for reading, of_robot, of_camera in changed:
        for file, pair in (
            ("robot", (of_robot, camera)),
            ("camera", (robot, of_camera)),
            (None, (of_robot, of_camera)),
        ):
            found.append((reading | {"file": file}, *pair))
    return [*found, ({"kind": "mirrored"}, robot, _mirrored(camera))]


def _inversions(poses: PosePairs, robot: dict[str, Any], camera: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the two inversions, the likelier first, and what is likelier of the first: the setup or an inverse file.

    The poses cannot decide: the other setup fits as inverse camera poses do, with X and W exchanged. What is on the
    gripper is short, and a camera sees its target in nearly the same direction; where this leaves both, the setup comes
    first, since it is forgotten more often.
    """
    lengths = robot["length"], camera["length"]  # of X; the one of the other twin is that of W
    of_frame, of_setup = lengths if poses.setup == "eye-in-hand" else lengths[::-1]
    if of_frame < of_setup:
        return [robot | {"likely": "frame"}, camera]
    robot = robot | {"likely": "setup"}
    if direction_spread(inverse(poses.camera)) < STEADY_VIEW * direction_spread(poses.camera):
        return [camera, robot]
    return [robot, camera]


def inverted_on_request(poses: PosePairs) -> list[str]:
    """Return the sides whose poses the reader was asked to invert."""
    return [side for finding in poses.findings if finding.code == "poses.inverted" for side in finding.values["sides"]]


def scaled_reading(G: Array, C: Array, shift: float, sources: Iterable[Source] = ()) -> dict[str, Any] | None:
    """The factor on the camera's translations that makes them fit, with the unit it may come from, if one does.

    ``bag``: the poses come from a ROS bag, for which there are other options.
    """
    scale = _scaled_camera(G, C) if len(G) >= 6 else None  # four numbers fitted to fewer poses fit anything
    if scale is None or abs(scale - 1.0) <= 0.02:
        return None
    camera = C.copy()
    camera[:, :3, 3] *= scale
    fit = consistency(G, camera)
    if fit is None or fit[0] > 2.0 * LARGE_ROTATION or fit[1] >= 0.4 * shift:  # a factor leaves the rotations
        return None
    file, unit = _unit_of(scale, G, C)
    found = {"kind": "scale", "factor": scale, "file": file, "unit": unit}
    if unit is None and not _between_units(scale):
        found["target"] = True
    return found | ({"bag": True} if any(source.format == "rosbag" for source in sources) else {})


def _unit_of(scale: float, G: Array, C: Array) -> tuple[str | None, str | None]:
    """Return the file that is in another unit, and the unit, for a factor on the camera's translations.

    A factor has two causes: one file is in a smaller unit, or the other was read in one and is in metres, which is the
    cause where its translations are smaller than any rig.
    """
    small = [file for file, T in (("robot", G), ("camera", C)) if np.abs(T[:, :3, 3]).max() < SMALL]
    for unit in ("mm", "cm", "in"):
        for file, other, factor in (
            ("camera", "robot", LENGTH_UNITS[unit]),
            ("robot", "camera", 1.0 / LENGTH_UNITS[unit]),
        ):
            if _near(scale, factor):
                return (other, "m") if other in small else (file, unit)
    return None, None


def _between_units(scale: float) -> bool:
    """Return whether a factor is that between two units of length, none of which need be metres."""
    ratios = np.divide.outer(list(LENGTH_UNITS.values()), list(LENGTH_UNITS.values()))
    return any(_near(scale, ratio) for ratio in ratios[ratios != 1.0].tolist())


def _near(scale: float, factor: float) -> bool:
    """Return whether a factor is that of a unit: near 1 a target may have it, far from 1 nothing else has."""
    limit = UNIT_FAR if abs(np.log(factor)) > np.log(9.0) else UNIT_NEAR
    return bool(abs(np.log(scale / factor)) < limit)


def _scaled_camera(G: Array, C: Array) -> float | None:
    """The factor s on the camera's translations that fits best: ``R_G t_X + s R_G R_X t_C - t_W = -t_G``."""
    n = len(G)
    i, j = np.arange(n - 1), np.arange(1, n)
    i, j = np.concatenate([i, np.arange(n // 2)]), np.concatenate([j, np.arange(n // 2) + n - n // 2])
    try:
        R = solve_limit(inverse(G)[j] @ G[i], C[j] @ inverse(C)[i])[:3, :3]
    except DegenerateMotionError:
        return None
    R_G, eye = G[:, :3, :3], np.broadcast_to(np.eye(3), (n, 3, 3))
    M = np.concatenate([R_G, R_G @ R @ C[:, :3, 3:], -eye], axis=2).reshape(-1, 7)
    solution, _, rank, _ = np.linalg.lstsq(M, -G[:, :3, 3].reshape(-1), rcond=None)
    return float(solution[3]) if rank == 7 and solution[3] > 0 else None


def _transposed(T: Array) -> Array:
    """Poses whose rotations are transposed; their translations stay."""
    result = T.copy()
    result[:, :3, :3] = np.swapaxes(T[:, :3, :3], 1, 2)
    return result


def _mirrored(T: Array) -> Array:
    """Poses of left-handed frames of camera and target; which axis is turned round only moves X and W."""
    mirror = np.diag([1.0, 1.0, -1.0, 1.0])
    return np.asarray(mirror @ T @ mirror)


def _reordered(T: Array, shift_by: int) -> Array:
    """Poses whose quaternion columns are read in the other order: -1 takes x, y, z, w for w, x, y, z; 1 undoes it."""
    result = T.copy()
    columns = Rotation.from_matrix(T[:, :3, :3]).as_quat()
    result[:, :3, :3] = Rotation.from_quat(np.roll(columns, shift_by, axis=1)).as_matrix()
    return result


ALPHABETICAL = "input_checks.alphabetical_rows"


def alphabetical_rows(poses: PosePairs) -> Finding | None:
    """Return a finding if robot and camera agree once the rows of one of them are sorted by number.

    Programs list numbered names in alphabetical order: 1, 10, 11, ..., 2, 20, ...
    """
    G, C, rows = poses.effective_robot, poses.camera, np.arange(poses.n)
    travel = float(np.linalg.norm(np.std(G[:, :3, 3], axis=0)))
    for first in (0, 1):  # the number of the first name
        names = sorted(range(first, first + poses.n), key=str)
        by_number = np.argsort(names, kind="stable")
        if (by_number == rows).all():
            continue
        for file, (robot, camera) in (("camera", (G, C[by_number])), ("robot", (G[by_number], C))):
            if _disagreement(robot, camera) > 2.0 * LARGE_ROTATION:
                continue
            fit = consistency(robot, camera)
            if fit is not None and fit[0] < LARGE_ROTATION and fit[1] < MAX_MISFIT_SHARE * travel:
                return Finding(ALPHABETICAL, "failure", {"file": file, "order": [int(k) for k in names[:4]]})
    return None


def _disagreement(G: Array, C: Array) -> float:
    """Return the RMS difference of the angles from each pose to the next."""
    robot, camera = (rotation_angles(T[:-1, :3, :3].mT @ T[1:, :3, :3]) for T in (G, C))
    return float(np.sqrt(np.mean((robot - camera) ** 2)))
