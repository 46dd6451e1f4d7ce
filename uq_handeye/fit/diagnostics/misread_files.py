"""Other readings of the two files that would fit: the other setup, inverse poses, other rotations, another unit.

`residuals` searches them where X does not explain the poses. A reading is a mapping of plain values: its ``kind``
("inverse robot", "inverse camera", "quaternion", "transposed", "mirrored", "scale") and the values that belong to it;
`sentences` names the argument of `read_poses` and the option. The likeliest reading comes first.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, inverse
from ...core.limits import MAJORITY
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.target_views import STEADY_VIEW, direction_spread
from .agreement import Agreement, agreement
from .consistency import LARGE_ROTATION_RAD, MAX_MISFIT_SHARE
from .misread_scale import scaled_reading
from .readings import OTHER_SETUP, Reading

# Data with smaller residuals (rad, or share of the travel) are simulated without noise, and have no noise to compare.
NOISE_FREE = 1e-7
# Of two readings that fit, the worse is named if its translation residuals are below this many times those of the
# better.
SIMILAR_FIT_RATIO = 4.0
# Readings of which one comes with the other.
INVERSE = ("inverse robot", "inverse camera")


def other_readings(poses: PosePairs, turn: float, shift: float, any_scale: bool = False) -> list[Reading]:
    """Return the inversions, orders, transpositions or units that make W constant in rotation *and* translation.

    If ``G X C = W`` is constant, so is ``inv(G) W inv(C) = X``: inverting one of the two lists breaks the fit,
    inverting the other as well restores it with the roles of X and W exchanged. So inversions come in twos
    (`_inversions`). Of all others two are named at most. Where no single reading fits, an inversion together with
    another unit is tried, which the inversion then has as its ``scale``; with ``any_scale`` any factor.
    """
    G, C = poses.effective_robot, poses.camera
    other = OTHER_SETUP[poses.setup]
    on_request = {f"inverse {side}": {"given": True} for side in inverted_on_request(poses)}
    candidates: list[tuple[Reading, Array, Array]] = [
        ({"kind": "inverse robot", "setup": other}, inverse(G), C),
        ({"kind": "inverse camera", "setup": other}, G, inverse(C)),
    ]
    twins = {}
    for reading, robot, camera in rotation_readings(poses.robot, C):
        if reading["kind"] == "mirrored" and poses.camera_calibration is not None:
            reading = reading | {"pictures": True}
        candidates.append((reading, robot if poses.setup == "eye-in-hand" else inverse(robot), camera))
    fitting: list[tuple[float, Reading]] = []
    largest = MAX_MISFIT_SHARE * float(np.linalg.norm(np.std(G[:, :3, 3], axis=0)))
    for reading, robot, camera in candidates:
        fit = _agreement(robot, camera)
        if fit is not None and reading["kind"] in INVERSE:
            twins[reading["kind"]] = reading | {"length": fit[2]} | on_request.get(reading["kind"], {})
        if fit is not None and fit[1] > largest:
            continue
        # Two files in the same wrong order agree in rotation; only their translations tell.
        turns = fit is not None and (
            fit[0] < max(0.4 * turn, NOISE_FREE) or fit[0] < 1.5 * turn < 1.5 * LARGE_ROTATION_RAD
        )
        # The camera's rotation is not in the translation of W, which may fit already.
        only_turns = fit is not None and fit[0] < 0.1 * turn and fit[1] < 1.5 * shift
        if fit is not None and ((turns and fit[1] < 0.4 * shift) or only_turns):
            fitting.append((fit[1], reading | {"length": fit[2]}))
    best = min((left for left, _ in fitting), default=0.0)
    fitting = [(left, reading) for left, reading in fitting if left < SIMILAR_FIT_RATIO * best + NOISE_FREE]
    found = [reading for _, reading in sorted(fitting, key=lambda found: found[0])[:2]]
    if len(twins) == 2 and any(reading["kind"] in INVERSE for reading in found):
        found = [reading for reading in found if reading["kind"] not in INVERSE]
        found = [*_inversions(poses, twins["inverse robot"], twins["inverse camera"]), *found[:1]]
    scaled = scaled_reading(G, C, shift, poses.sources)
    if found or scaled is not None:
        return found if scaled is None else [*found, scaled]
    return [
        reading | {"scale": factor}
        for reading, robot, camera in candidates[: len(INVERSE)]
        if (factor := scaled_reading(robot, camera, shift, poses.sources)) is not None
        and (any_scale or factor["unit"] is not None)
    ]


def _agreement(robot: Array, camera: Array) -> Agreement | None:
    """Return how well most poses agree; None where they are no majority, or do not determine X."""
    found = agreement(robot, camera, scale_free=False)
    return None if found is None or found.share < MAJORITY else found


def rotation_readings(robot: Array, camera: Array) -> list[tuple[Reading, Array, Array]]:
    """Return each other reading of the rotations of one file or both, with the poses (n, 4, 4) that it makes."""
    found: list[tuple[Reading, Array, Array]] = []
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


def _inversions(poses: PosePairs, robot: Reading, camera: Reading) -> list[Reading]:
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
