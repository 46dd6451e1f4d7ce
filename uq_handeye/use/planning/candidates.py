r"""Robot poses from which the camera would see the target: candidates for the next poses of a session.

The poses so far show from where the target can be seen and where the robot can go; candidates stay close to both. Each
camera pose ``C = camera_T_target`` is read as four things, drawn again and put together again:

- *distance* of the target's origin: uniform in ``[0.8 nearest, 1.2 farthest]`` of the poses so far;
- *view*: the direction of the target's origin in the camera, between two of those so far: it stays in the image;
- *tilt* of the line of sight against its mean direction in the target's frame, any azimuth: from 0 to the largest so
  far and 15 degrees more, at most 75 degrees;
- *roll* about the line of sight: within the largest so far and 30 degrees more, either way.

With ``Q`` the rotation of the target in a frame whose z axis is the line of sight, ``R_C = swing(z -> view) Q``,
``Q^T = mean Rz(a) Ry(tilt) Rz(roll - a)``; ``G = W inv(C) inv(X)`` is the robot pose (its inverse for eye-to-hand).
Robot positions lie in the bounding box of those so far, grown on every side by 15 % of its diagonal or of the farthest
target distance, whichever is more. The reach of the robot, its joint limits and obstacles are unknown: look at each
pose before driving there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.geometry.checks import as_transforms
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, inverse, pose, skew
from ...errors import InputError
from ...model.poses.pose_pairs import PosePairs

# At most this many candidates are drawn, as planning takes 3 kB for each.
MAX_CANDIDATES = 100_000
_HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])


def sample_candidates(
    data: PosePairs,
    X: Array,
    W: Array,
    n: int,
    *,
    seed: int | np.random.Generator,
    grown: float = 0.15,
    floor: float | None = None,
) -> Array:
    """Up to ``n`` robot poses ``base_T_gripper`` (m, 4, 4) around the target, near the poses so far; see the module.

    Parameters
    ----------
    data : PosePairs
        The poses so far, without batch axes.
    X, W : (4, 4)
        Of the setup of the data: ``gripper_T_camera`` and ``base_T_target``, or ``base_T_camera`` and
        ``gripper_T_target``.
    n : int
        Fewer come back only if fewer than n of 50 n draws fall into the box.
    grown : float
        By which the box of the robot positions so far is grown; see the module.
    floor : float or None
        Height in the base (m) above which the flange and what it carries stay.

    Raises
    ------
    InputError
        n below 1 or above 100,000, a camera pose so far at the target itself, or no draw in the box.
    """
    require_number(n)
    X, W = as_transforms(X, "X", stack=False), as_transforms(W, "W", stack=False)
    rng = np.random.default_rng(seed)
    where = data.robot[:, :3, 3]
    low, high = where.min(axis=0), where.max(axis=0)
    margin = grown * max(float(np.linalg.norm(high - low)), float(np.linalg.norm(data.camera[:, :3, 3], axis=-1).max()))

    def draw(size: int) -> Array:
        robot = robot_of(draw_camera_poses(data.camera, size, rng), X, W, data.setup)
        inside = ((robot[:, :3, 3] >= low - margin) & (robot[:, :3, 3] <= high + margin)).all(axis=-1)
        if floor is not None:
            carried = robot @ (X if data.setup == "eye-in-hand" else W)
            inside &= np.minimum(robot[:, 2, 3], carried[:, 2, 3]) >= floor
        return np.asarray(robot[inside])

    above = "" if floor is None else ", above the floor"
    why = (
        f"poses that look at the target keeps the robot within {1e3 * margin:.0f} mm of where it has been{above}. "
        "Is X right? If so, give candidates of your own."
    )
    return drawn(draw, n, why, draws=50, ahead=4, at_once=20_000)


def drawn(draw: Callable[[int], Array], n: int, why: str, *, draws: int, ahead: int, at_once: int) -> Array:
    """Return the first n of what ``draw`` keeps, of ``draws`` n draws at most; raises `InputError` if it keeps none.

    ``ahead``: draws for each that is missing; ``at_once`` at most; ``why``: words behind "None of N".
    """
    found: list[Array] = []
    missing, left = n, draws * n
    while missing and left:
        size = min(left, max(ahead * missing, 64), at_once)
        found.append(draw(size)[:missing])
        missing -= len(found[-1])
        left -= size
    if missing == n:
        raise InputError(f"None of {draws * n} {why}")
    return np.concatenate(found)


def require_number(n: int) -> None:
    """Raise `InputError` unless ``n`` candidates can be drawn."""
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or not 1 <= n <= MAX_CANDIDATES:
        raise InputError(
            f"Expected the number of candidates to be an integer between 1 and {MAX_CANDIDATES}, got {n!r}."
        )


def require_choice(count: int, k: int, repeat: bool) -> None:
    """Raise `InputError` unless k poses can be chosen out of ``count`` candidates."""
    if count > MAX_CANDIDATES:
        raise InputError(f"Expected at most {MAX_CANDIDATES} candidates, got {count}: thin them out.")
    if k > count and not repeat:
        raise InputError(
            f"Expected at most as many poses as candidates, got k = {k} and {count} candidates; give more, or let "
            "them be taken again (repeat)."
        )


def robot_of(camera: Array, X: Array, W: Array, setup: str) -> Array:
    """``W inv(C) inv(X)``, inverted for eye-to-hand."""
    G_inverse = X @ camera @ inverse(W)
    return np.asarray(G_inverse if setup == "eye-to-hand" else inverse(G_inverse))


def draw_camera_poses(
    camera: Array,
    size: int,
    rng: np.random.Generator,
    distances: tuple[float, float] = (0.8, 1.2),
    more_tilt_deg: float = 15.0,
    most_tilt_deg: float = 75.0,
) -> Array:
    """Drawn camera poses (size, 4, 4); see the module."""
    distance = np.linalg.norm(camera[:, :3, 3], axis=-1)
    if distance.min() <= 0.0:
        raise InputError(f"Camera pose {int(np.argmin(distance))} is at the target: there is no line of sight.")
    if camera[:, 2, 3].sum() < 0.0:  # the camera looks along its -z axis: `_swing` wants the target along +z
        return _HALF_TURN @ draw_camera_poses(_HALF_TURN @ camera, size, rng)
    view = camera[:, :3, 3] / distance[:, None]
    looks = camera[:, :3, :3].mT @ _swing(view)  # Q^T: its z column is the line of sight in the target's frame
    mean = Rotation.from_matrix(looks).mean().as_matrix()
    turned = mean.T @ looks
    tilt = float(np.arccos(np.clip(turned[:, 2, 2], -1.0, 1.0)).max())
    # Rz(a) Ry(b) Rz(c): the roll a + c.
    roll = np.arctan2(turned[:, 1, 0] - turned[:, 0, 1], turned[:, 0, 0] + turned[:, 1, 1])
    most_roll = min(np.pi, float(np.abs(roll).max()) + np.radians(2.0 * more_tilt_deg))

    away = rng.uniform(distances[0] * distance.min(), distances[1] * distance.max(), size)
    first, second = view[rng.integers(len(view), size=(2, size))]
    share = rng.uniform(size=(size, 1))
    seen = share * first + (1 - share) * second
    seen /= np.linalg.norm(seen, axis=-1, keepdims=True)
    azimuth = rng.uniform(-np.pi, np.pi, size)
    tilts = rng.uniform(0.0, min(tilt + np.radians(more_tilt_deg), np.radians(most_tilt_deg)), size)
    rolls = rng.uniform(-most_roll, most_roll, size)
    look = mean @ Rotation.from_euler("ZYZ", np.stack([azimuth, tilts, rolls - azimuth], axis=1)).as_matrix()
    return pose(_swing(seen) @ look.mT, away[:, None] * seen)


def _swing(direction: Array) -> Array:
    """The smallest rotation (m, 3, 3) from the z axis to unit vectors (m, 3) that do not point along -z."""
    S = skew(np.cross([0.0, 0.0, 1.0], direction))
    return np.asarray(np.eye(3) + S + S @ S / np.maximum(1.0 + direction[:, 2], 1e-9)[:, None, None])
