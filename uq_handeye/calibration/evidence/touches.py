r"""Residuals of touches against a stored calibration: points that the camera saw and the tool then touched.

The camera sees a point at p (camera frame) and the tool touches it at b' (base). The difference of the touched point
and the point that the calibration predicts is to first order, with s the errors of the estimates (`posterior`),

    r = b' - G X p = (B_touch - B_seen) s + D_touch xi_touch - D_seen xi_seen + R_touch dtau + n_touch - R_seen n_p

with B the derivatives of the point in the base by s (`prediction.predict`), ``xi`` the errors of the two robot poses,
``dtau`` the error of the tool's offset in the flange, n the noise of touching and of seeing. With ``W = G X`` of
eye-in-hand, ``R_seen = R_G R_X``; a camera fixed in the cell has G = I.

- A touch is given as a point in the base, or as a pose (or joints) of the robot and the offset of the tool. A point
  has no orientation of the flange: the tool's error then moves all touches alike.
- Points that were seen at one and the same robot pose share that pose's noise, and those of one view of a board the
  noise of the board's pose. These errors are columns of `TouchEvidence.fresh`: a later touch has new values of them.
- A robot accuracy that was propagated to X counts at both poses. A touch that is given as a point is taken to have the
  orientation of the calibration's nearest robot pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.files.records import INFINITE, Record
from ...core.geometry.checks import as_numbers, as_transforms, checked_covariance
from ...core.geometry.se3 import Array
from ...errors import InputError
from ...fit.diagnostics.task_space import by_pose
from ...fit.graph.rows import Joint, NewRows, at_points, factor_of
from ...model.errors.key import ErrorKey
from ...model.errors.keys import INTRINSICS, JOINT_NOISE, ROBOT_ACCURACY, TARGET_SCALE
from ...model.errors.term import ErrorTerm
from ..estimated import Estimated
from ..prediction.predict import (
    RobotAhead,
    own_noise,
    poses_so_far,
    posterior_of,
    rest_of_robot,
    robot_ahead,
    seen_at,
    shared_effects,
    tip_at,
)

# Parts of touches that have a row for each, with the shape of one; None: any number.
_ROWS: dict[str, tuple[int | None, ...]] = {
    **dict.fromkeys(("seen", "touched"), (3,)),
    **dict.fromkeys(("robot", "touched_robot", "board"), (4, 4)),
    **dict.fromkeys(("joints", "touched_joints"), (None,)),
    "seen_covariance": (3, 3),
    "board_covariance": (6, 6),
}


@dataclass(frozen=True, eq=False)
class Touches(Record):
    """m points that were seen and touched; lengths in m.

    Parameters
    ----------
    seen : (m, 3)
        Points in the camera frame; of a board those of the board (`board`).
    touched : (m, 3) or None
        Points touched, in the base; None: by `touched_robot` or `touched_joints` and the tool.
    robot, joints : (m, 4, 4), (m, L) or None
        Robot pose ``base_T_gripper`` or joints at which the points were seen; needed for a camera on the gripper.
    touched_robot, touched_joints : (m, 4, 4), (m, L) or None
        Robot pose or joints at the touch.
    tool : (3,)
        Tip of the tool in the flange frame.
    seen_covariance : (m, 3, 3) or None
        Noise of the points, camera frame; None: that of the calibration's camera.
    touch_sd : (m,) or float
        Standard deviation of a touch per axis.
    tool_sd : float
        Standard deviation of the tool's offset per axis: 0 is exact, infinity unknown.
    board : (m, 4, 4) or None
        Poses ``camera_T_target`` of a board: `seen` are then points of it.
    board_covariance : (m, 6, 6) or None
        Noise of these poses; None: that of the calibration's camera.
    same_camera : bool
        Whether the points come from the intrinsics of the calibration's camera, so that their errors count (not for
        those of a depth sensor).
    robot_noise : (6, 6) or None
        Noise of one robot pose, by touch and seeing; None: that of the calibration. Where the calibration estimated it,
        it may hold a part of the camera's.
    names : tuple of str
    """

    _if_any: ClassVar[str] = (
        "touched robot joints touched_robot touched_joints seen_covariance board board_covariance robot_noise"
    )

    seen: Annotated[Array, "m", 3]
    touched: Annotated[Array, "m", 3] | None = None
    robot: Annotated[Array, "m", 4, 4] | None = None
    joints: Annotated[Array, "m", "L"] | None = None
    touched_robot: Annotated[Array, "m", 4, 4] | None = None
    touched_joints: Annotated[Array, "m", "L"] | None = None
    tool: Annotated[Array, 3] | None = None
    seen_covariance: Annotated[Array, "m", 3, 3] | None = None
    touch_sd: Annotated[Array, "m"] | float = 0.0
    tool_sd: Annotated[float, INFINITE] = 0.0
    board: Annotated[Array, "m", 4, 4] | None = None
    board_covariance: Annotated[Array, "m", 6, 6] | None = None
    same_camera: bool = True
    robot_noise: Annotated[Array, 6, 6] | None = None
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        m = len(np.atleast_2d(as_numbers(self.seen, "seen")))
        given = {name: value for name in _ROWS if (value := getattr(self, name)) is not None}
        checked: dict[str, Any] = {name: _rows(value, name, _ROWS[name], m) for name, value in given.items()}
        checked["tool"] = _rows(np.zeros(3) if self.tool is None else self.tool, "tool", (3,), 1)[0]
        if self.robot_noise is not None:
            checked["robot_noise"] = _rows(self.robot_noise, "robot_noise", (6, 6), 1)[0]
        sd = as_numbers(self.touch_sd, "touch_sd")
        if sd.shape not in ((), (m,)) or not (np.isfinite(sd) & (sd >= 0)).all():
            raise InputError(
                f"Expected `touch_sd` to be one standard deviation >= 0 (m) or {m}, got {self.touch_sd!r}."
            )
        checked["touch_sd"] = np.broadcast_to(sd, (m,))
        if not self.tool_sd >= 0:
            raise InputError(f"Expected `tool_sd` to be >= 0, or infinite for an unknown tool, got {self.tool_sd!r}.")
        if not self.names:
            checked["names"] = tuple(str(k + 1) for k in range(m))
        elif len(self.names) != m:
            raise InputError(f"Expected `names` of {m} points, got {len(self.names)}.")
        if self.touched is None and self.touched_robot is None and self.touched_joints is None:
            raise InputError("Expected `touched`, points in the base, or `touched_robot`, robot poses at the touch.")
        if self.touched is not None and self.touched_joints is not None:
            raise InputError("Expected either `touched`, points in the base, or `touched_joints`, not both.")
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        super().__post_init__()

    @property
    def m(self) -> int:
        """Number of touches."""
        return len(self.seen)

    @property
    def touch_noise(self) -> Array:
        """(m, 3, 3) covariance of touching."""
        return np.asarray(np.asarray(self.touch_sd)[:, None, None] ** 2 * np.eye(3))

    @property
    def tool_known(self) -> bool:
        """True unless the offset of the tool is unknown."""
        return bool(np.isfinite(self.tool_sd))

    def rows(self, index: Any) -> Touches:
        """Some of the touches, by their numbers."""
        chosen = np.arange(self.m)[index]
        of = {name: getattr(self, name) for name in ("touch_sd", *_ROWS)}
        parts: dict[str, Any] = {name: None if each is None else each[chosen] for name, each in of.items()}
        return replace(self, **parts, names=tuple(self.names[k] for k in chosen))

    def joined(self, other: Touches) -> Touches:
        """These touches and others of the same kind."""
        parts: dict[str, Any] = {
            name: None if (of := getattr(self, name)) is None else np.concatenate([of, getattr(other, name)])
            for name in ("touch_sd", *_ROWS)
        }
        return replace(self, **parts, names=(*self.names, *other.names))


@dataclass(frozen=True, eq=False)
class TouchEvidence(NewRows):
    """Residuals of touches: the touched point minus the one predicted by the calibration, base frame, m."""

    _each = (*NewRows._each, "at", "by_tool")

    at: Array  # (m, 3) the points in the base, as the calibration has them
    by_tool: Array  # (m, 3, 3) R_touch: what an error of the tool's offset does
    fresh: int  # number of the last columns of by_unit that later touches draw again

    def _own_units_at(self, V: Array) -> Array:
        known, fresh = np.split(V, [V.shape[1] - self.fresh], axis=1)
        return np.asarray(known @ known.T + _sizes_at(self.posterior)[:, None, None] * (fresh @ fresh.T))

    def repeated(self, times: float) -> TouchEvidence:
        """The touches, each repeated ``times`` times, which divides the variance of their own noise by that number."""
        by_unit = np.array(self.by_unit)
        if self.fresh:
            by_unit[..., -self.fresh :] /= np.sqrt(times)
        parts = tuple((key, S / times) for key, S in self.parts)
        return replace(self, own=self.own / times, own_at=self.own_at / times, by_unit=by_unit, parts=parts)


def evidence_of_touches(result: Estimated, touches: Touches) -> TouchEvidence:
    """Compare points that were seen and touched with a calibration.

    A tool of which nothing is known adds no columns here: its three numbers are `TouchEvidence.by_tool`.

    Raises
    ------
    InputError
        A calibration without joint covariance; a camera on the gripper and no robot poses; no noise at all.
    """
    posterior = posterior_of(result)
    m = touches.m
    seen_from = _robot_at_seeing(result, touches)
    reached = _robot_at_touch(result, touches)
    p, by_camera, noise, view_noise, views = _seen_points(result, touches, seen_from)
    seen = seen_at(result, p, None if seen_from is None else seen_from._replace(fresh=()))
    into_base = np.broadcast_to(result.X[:3, :3], (m, 3, 3))
    if seen_from is not None:
        into_base = seen_from.poses[:, :3, :3] @ into_base
    by_state = -seen.by_all
    by_state[..., 12:] -= into_base @ by_camera
    touch_noise = touches.touch_noise
    if reached is None:
        assert touches.touched is not None
        b, by_tool = touches.touched, np.broadcast_to(np.eye(3), (m, 3, 3))
    else:
        tip = tip_at(reached, touches.tool)
        b, by_tool = tip.at if touches.touched is None else touches.touched, reached.poses[:, :3, :3]
        by_state = by_state + tip.by_all
        touch_noise = touch_noise + tip.new
    if reached is None:  # the touched point comes from a robot pose, and has its errors
        at_touch = _poses_of_points(result, touches)
        lever = by_pose(b - at_touch[:, :3, 3])
        eye = np.broadcast_to(np.eye(4), at_touch.shape)
        by_state[..., 12:] += lever @ shared_effects(result, "robot", at_touch, eye)
        touch_noise = touch_noise + lever @ rest_of_robot(result, at_touch) @ lever.mT
    by_unit = by_state @ posterior.A
    groups = []
    if seen_from is not None:
        lever = by_pose(seen.at - seen_from.poses[:, :3, 3])
        groups.append(_per_view(lever @ _roots(seen_from.noise), _equal_rows(seen_from.poses)))
    if view_noise is not None:
        groups.append(_per_view(into_base @ view_noise, views))
    of_views = sum((each for _, each in groups), np.zeros((m, 3, 3)))
    if 0 < touches.tool_sd < np.inf:
        by_unit = np.concatenate([by_unit, touches.tool_sd * by_tool], axis=-1)
    fresh = np.concatenate([np.zeros((m, 3, 0)), *(columns for columns, _ in groups)], axis=-1)
    point_noise = into_base @ noise @ into_base.mT
    own = touch_noise + point_noise + of_views
    if not (np.linalg.eigvalsh(own)[:, 0] > 0).all():
        raise InputError(
            "Expected noise of the touches: give `touch_sd` (--tcp-sd), such as 0.2mm, or `point_sd` (--point-sd)."
        )
    given = touches.touch_noise
    if touches.seen_covariance is not None:
        given = given + point_noise
    parts = tuple((key, share * (own - given)) for key, share in _estimated(posterior))
    return TouchEvidence(
        b - seen.at, np.concatenate([by_unit, fresh], axis=-1), own, posterior, seen.at, np.asarray(by_tool),
        fresh.shape[-1], own_at=at_points(posterior, own, parts), parts=parts,
    )  # fmt: skip


def _estimated(posterior: Joint) -> list[tuple[ErrorKey, float]]:
    """Noises of poses that the calibration estimated, as shares of their sum where their size is 1."""
    if posterior.points is None:
        return []
    noise = [one for one in posterior.noise if one.key not in (ROBOT_ACCURACY, JOINT_NOISE)]
    weight = [float(np.trace(one.covariance)) for one in noise]
    stated = sum(w * one.size.median**2 for w, one in zip(weight, noise, strict=True))
    named = zip(weight, noise, strict=True)
    return [(one.key, w / stated) for w, one in named if one.key in posterior.points.keys] if stated > 0 else []


def _sizes_at(posterior: Joint) -> Array:
    """(d,) variance of the noise that the calibration estimated at each point of the sizes, over that stated."""
    parts = [(key, np.full((1, 1, 1), share)) for key, share in _estimated(posterior)]
    return at_points(posterior, np.ones((1, 1, 1)), parts).reshape(-1) if posterior.points is not None else np.ones(1)


def with_tool(evidence: TouchEvidence) -> TouchEvidence:
    """Add columns of a tool with unknown offset, by a prior of one metre."""
    k = evidence.by_unit.shape[-1] - evidence.fresh
    before, fresh = evidence.by_unit[..., :k], evidence.by_unit[..., k:]
    return replace(evidence, by_unit=np.concatenate([before, evidence.by_tool, fresh], axis=-1))


def _robot_at_seeing(result: Estimated, touches: Touches) -> RobotAhead | None:
    if result.setup != "eye-in-hand":
        return None
    if touches.robot is None and touches.joints is None:
        raise InputError(
            "The camera is on the robot: expected the robot pose at which each point was seen, `robot` (columns "
            "seen_at_x "
            "... seen_at_qw of the file), or `joints`."
        )
    return _with_noise(robot_ahead(result, touches.joints, touches.robot), touches)


def _robot_at_touch(result: Estimated, touches: Touches) -> RobotAhead | None:
    if touches.touched_robot is None and touches.touched_joints is None:
        return None
    return _with_noise(robot_ahead(result, touches.touched_joints, touches.touched_robot), touches)


def _with_noise(ahead: RobotAhead, touches: Touches) -> RobotAhead:
    if touches.robot_noise is None:
        return ahead
    noise = np.broadcast_to(touches.robot_noise, ahead.noise.shape)
    return ahead._replace(fresh=(ErrorTerm.given("robot", noise),))


def _poses_of_points(result: Estimated, touches: Touches) -> Array:
    """(m, 4, 4) poses of a flange at touched points: with the orientation of the nearest pose of the calibration."""
    assert touches.touched is not None
    poses = np.broadcast_to(np.eye(4), (touches.m, 4, 4)).copy()
    so_far = poses_so_far(result)
    known = touches.robot if so_far is None else so_far.robot
    if known is not None:
        distance = np.linalg.norm(touches.touched[:, None] - known[None, :, :3, 3], axis=-1)
        poses[:, :3, :3] = known[distance.argmin(axis=1), :3, :3]
    poses[:, :3, 3] = touches.touched
    return poses


def _seen_points(
    result: Estimated, touches: Touches, seen_from: RobotAhead | None
) -> tuple[Array, Array, Array, Array | None, NDArray[np.intp]]:
    """Points in the camera, corrected by the estimates of shared errors: (m, 3); (m, 3, q) by these errors; noise
    (m, 3, 3) of each; noise by columns (m, 3, 6) of each view of a board; the number of the view of each.
    """
    posterior = posterior_of(result)
    m, q = touches.m, len(posterior.keys)
    p, views, view_noise = touches.seen, np.arange(m, dtype=np.intp), None
    noise = np.zeros((m, 3, 3)) if touches.seen_covariance is None else touches.seen_covariance
    robot = np.broadcast_to(np.eye(4), (m, 4, 4)) if seen_from is None else seen_from.poses
    by_errors = np.zeros((m, 3, q))
    if touches.board is not None:
        C = touches.board
        arm = (C[:, :3, :3] @ p[..., None])[..., 0]
        p = arm + C[:, :3, 3]
        S = touches.board_covariance
        S = np.broadcast_to(own_noise(result, "camera"), (m, 6, 6)) if S is None else S
        view_noise, views = by_pose(arm) @ _roots(S), _equal_rows(C)
    elif touches.seen_covariance is None:
        noise = np.broadcast_to(own_noise(result, "camera")[3:, 3:], (m, 3, 3))
    if touches.same_camera:
        there = np.broadcast_to(np.eye(4), (m, 4, 4)).copy()
        there[:, :3, 3] = p
        intrinsics = np.array([key.error == INTRINSICS for key in posterior.keys], dtype=bool)
        scale = np.array([key == TARGET_SCALE for key in posterior.keys], dtype=bool)
        by_errors = np.array(shared_effects(result, "camera", robot, there)[:, 3:])
        if touches.board is None:
            by_errors[..., intrinsics | scale] = 0.0
        elif intrinsics.any():
            effect = shared_effects(result, "camera", robot, touches.board)
            by_errors[..., intrinsics] = (by_pose(p - touches.board[:, :3, 3]) @ effect)[..., intrinsics]
        p = p - by_errors @ posterior.estimate
    return np.asarray(p), np.asarray(by_errors), np.asarray(noise), view_noise, views


def _per_view(columns: Array, views: NDArray[np.intp]) -> tuple[Array, Array]:
    """Noise of views by columns (m, 3, c): columns of those that several points share, covariance (m, 3, 3) of "
    "others."""
    several = np.bincount(views)[views] > 1
    each = np.where(several[:, None, None], 0.0, columns @ columns.mT)
    of, m, c = np.unique(views[several], return_inverse=True)[1], len(views), columns.shape[-1]
    found = np.zeros((m, 3, int(of.max(initial=-1)) + 1, c))
    found[np.flatnonzero(several), :, of] = columns[several]
    flat = found.reshape(m, 3, -1)
    return flat[..., flat.any(axis=(0, 1))], each


def _equal_rows(poses: Array) -> NDArray[np.intp]:
    """(m,) the same number for equal poses."""
    return np.asarray(np.unique(poses.reshape(len(poses), -1), axis=0, return_inverse=True)[1], dtype=np.intp).reshape(
        -1
    )


def _roots(S: Array) -> Array:
    return np.stack([factor_of(one) for one in S.reshape(-1, *S.shape[-2:])]).reshape(S.shape)


def _rows(value: ArrayLike, name: str, shape: tuple[int | None, ...], m: int) -> Array:
    """Return m rows of a shape; one pose or covariance is repeated for all. Raises `InputError` for others."""
    rows = np.asarray(as_transforms(value, name, stack=False)) if shape == (4, 4) else as_numbers(value, name)
    rows = rows[None] if rows.ndim == len(shape) else rows
    fits = rows.ndim > 1 and all(size in (None, given) for size, given in zip(shape, rows.shape[1:], strict=False))
    one = len(shape) == 2 and len(rows) == 1
    if rows.ndim != len(shape) + 1 or not fits or not m or (len(rows) != m and not one) or not np.isfinite(rows).all():
        axes = ", ".join("L" if size is None else str(size) for size in shape)
        raise InputError(
            f"Expected `{name}` to be {m} rows ({axes}) of finite numbers, m and rad, got shape {np.shape(value)}."
        )
    if shape in ((3, 3), (6, 6)):
        checked_covariance(np.pad(rows, [(0, 0), *[(6 - rows.shape[-1], 0)] * 2]), name, joint=False)
    return np.asarray(np.broadcast_to(rows, (m, *rows.shape[1:])))
