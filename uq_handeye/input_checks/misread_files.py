"""Which other reading of the two files would fit (setup, direction, quaternion order, unit), and how to ask for it.

`plausibility` asks where X does not explain the poses. Every answer names the argument of `read_poses` and the option.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import DegenerateMotionError
from ..formatting.units import LENGTH_UNITS
from ..geometry.se3 import Array, inverse
from ..poses.pose_pairs import PosePairs
from ..poses.residuals import pose_residuals
from ..procrustes.limit import solve_limit

# Rotation residual (rad) beyond which another reading of the files is looked for.
LARGE_ROTATION = np.radians(2.0)
# Data without noise, from a simulation, say nothing about noise (rad, or share of the travel).
EXACT = 1e-7
# Of two readings that fit, the worse is named if its translation residuals are below so many times those of the better.
ALIKE = 4.0
# Another reading fits if its translation residuals are below this share of the travel of the robot.
FITS = 0.2
# Pairs that the search for another reading looks at.
SEARCH_PAIRS = 2000


def other_readings(poses: PosePairs, turn: float, shift: float) -> str:
    """Which inversion, quaternion order or unit would make W constant in rotation *and* translation.

    If ``G X C = W`` is constant, so is ``inv(G) W inv(C) = X``: inverting one of the two lists breaks the fit,
    inverting the other as well restores it with the roles of X and W exchanged. So inversions come in twos.
    """
    G, C = poses.effective_robot, poses.camera
    other = "eye-to-hand" if poses.setup == "eye-in-hand" else "eye-in-hand"
    candidates = [
        (
            f"the setup is {other}, or the robot file holds inverse poses",
            f'setup="{other}" (--setup {other}), or robot_frame="gripper_T_base" (--robot-frame gripper_T_base)',
            inverse(G),
            C,
        ),
        (
            "the camera file holds inverse poses, target_T_camera",
            'camera_frame="target_T_camera" (--camera-frame target_T_camera)',
            G,
            inverse(C),
        ),
    ]
    for shift_by, where, order in ((-1, "first", "wxyz"), (1, "last", "xyzw")):
        robot, camera = _reordered_robot(poses, shift_by), _reordered(C, shift_by)
        candidates += [
            (f"{file} the scalar of the quaternion {where}", option, *pair)
            for file, option, pair in (
                ("the robot file has", in_both("robot", "quaternion", order), (robot, C)),
                ("the camera file has", in_both("camera", "quaternion", order), (G, camera)),
                ("both files have", f'quaternion="{order}" (--quaternion {order})', (robot, camera)),
            )
        ]
    fitting = []
    largest = FITS * float(np.linalg.norm(np.std(G[:, :3, 3], axis=0)))
    for text, option, robot, camera in candidates:
        fit = _fit(robot, camera)
        if fit is not None and fit[1] > largest:
            continue
        # Two files in the same wrong order agree in rotation; only their translations tell.
        turns = fit is not None and (fit[0] < max(0.4 * turn, EXACT) or fit[0] < 1.5 * turn < 1.5 * LARGE_ROTATION)
        # The camera's rotation is not in the translation of W, which may fit already.
        only_turns = fit is not None and fit[0] < 0.1 * turn and fit[1] < 1.5 * shift
        if fit is not None and ((turns and fit[1] < 0.4 * shift) or only_turns):
            fitting.append((fit[1], f"{text} (X would be {fit[2]:.3g} m long): {option}"))
    fitting = [(left, text) for left, text in fitting if left < ALIKE * min(fitting)[0] + EXACT]
    if scaled := scaled_reading(G, C, shift):
        fitting.append((0.0, scaled))
    if not fitting:
        return (
            "No inversion, quaternion order or unit that was tried fits: either the rows do not belong together, or "
            "the poses carry errors of this size."
        )
    texts = [text for _, text in sorted(fitting)[:2]]
    return f"It would fit if {'; or if '.join(texts)}."


def scaled_reading(G: Array, C: Array, shift: float) -> str:
    """What to say if a factor on the camera's translations makes them fit; empty if none does."""
    scale = _scaled_camera(G, C) if len(G) >= 6 else None  # four numbers fitted to fewer poses fit anything
    if scale is None or abs(scale - 1.0) <= 0.02:
        return ""
    camera = C.copy()
    camera[:, :3, 3] *= scale
    fit = _fit(G, camera)
    if fit is None or fit[1] >= 0.4 * shift:
        return ""
    file, unit = next(
        (
            (file, unit)
            for unit in ("mm", "cm", "in")
            for file, factor in (("camera", LENGTH_UNITS[unit]), ("robot", 1.0 / LENGTH_UNITS[unit]))
            if abs(scale / factor - 1.0) < 0.03
        ),
        ("", ""),
    )
    cause = (
        f"the {file} file is in {unit}, {in_both(file, 'units', unit, 'm')}"
        if unit
        else "one file is in another unit (--robot-units, --camera-units)"
    )
    return f"the camera translations are multiplied by {scale:.4g}: {cause}, or the size of the target is wrong"


def in_both(file: str, argument: str, value: str, other: str | None = None) -> str:
    """How to say it for one file, in Python and on the command line: ``units=("m", "mm") (--camera-units mm)``."""
    second = "None" if other is None else f'"{other}"'
    pair = f'"{value}", {second}' if file == "robot" else f'{second}, "{value}"'
    return f"{argument}=({pair}) (--{file}-{argument} {value})"


def _fit(G: Array, C: Array) -> tuple[float, float, float] | None:
    """RMS rotation and translation of W about its mean, and |t_X|, of X fitted to some of the pairs."""
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


def _scaled_camera(G: Array, C: Array) -> float | None:
    """The factor s on the camera's translations that fits best: ``(R_A - I) t_X - s R_X t_B = -t_A``."""
    n = len(G)
    i, j = np.arange(n - 1), np.arange(1, n)
    i, j = np.concatenate([i, np.arange(n // 2)]), np.concatenate([j, np.arange(n // 2) + n - n // 2])
    A, B = inverse(G)[j] @ G[i], C[j] @ inverse(C)[i]
    try:
        R = solve_limit(A, B)[:3, :3]
    except DegenerateMotionError:
        return None
    M = np.concatenate([A[:, :3, :3] - np.eye(3), -(R @ B[:, :3, 3:])], axis=2).reshape(-1, 4)
    solution, _, rank, _ = np.linalg.lstsq(M, -A[:, :3, 3].reshape(-1), rcond=None)
    return float(solution[3]) if rank == 4 and solution[3] > 0 else None


def _reordered(T: Array, shift_by: int) -> Array:
    """Poses whose quaternion columns are read in the other order: -1 takes x, y, z, w for w, x, y, z; 1 undoes it."""
    result = T.copy()
    columns = Rotation.from_matrix(T[:, :3, :3]).as_quat()
    result[:, :3, :3] = Rotation.from_quat(np.roll(columns, shift_by, axis=1)).as_matrix()
    return result


def _reordered_robot(poses: PosePairs, shift_by: int) -> Array:
    T = _reordered(poses.robot, shift_by)
    return T if poses.setup == "eye-in-hand" else inverse(T)
