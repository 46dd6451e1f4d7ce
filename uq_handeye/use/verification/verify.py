"""Test of a stored calibration by points that the camera saw and the robot touched.

The result states whether the touches fit the calibration, how large a bias is, which bias these touches would have
shown, how many touches show one of a given size, and where to touch next (`power`, `next_touches`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ...calibration.estimated import Estimated
from ...calibration.evidence.touches import Touches, TouchEvidence, evidence_of_touches
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array, inverse
from ...core.limits import MAX_LEFT_SHARE
from ...core.presentation.units import parse_deviations, parse_length
from ...core.rounding import THIRD_DIGITS
from ...errors import InputError, keywords_of, require_known
from ...findings import Finding
from ..maintenance.update import require_other_touches
from .next_touches import next_touches
from .power import Bias, bias_of, limit, touches_needed
from .result import Needed, PointTable, Verification
from .touches_file import require_metres


@dataclass(frozen=True, eq=False)
class VerifyRequest:
    """The arguments of `verify` in addition to the calibration and the points; see there."""

    robot: ArrayLike | None = None
    joints: ArrayLike | None = None
    touched_robot: ArrayLike | None = None
    touched_joints: ArrayLike | None = None
    tool: ArrayLike | None = None
    touch_sd: float | str | ArrayLike | None = None
    point_sd: float | str | ArrayLike | None = None
    tool_sd: float | str = 0.0
    board: ArrayLike | None = None
    board_covariance: ArrayLike | None = None
    same_camera: bool = True
    robot_noise: tuple[str | float, str | float] | ArrayLike | None = None
    names: Sequence[str] = ()
    show: float | str = 5e-4
    candidates: ArrayLike | None = None

    @property
    def size(self) -> float:
        """`show` in m."""
        if not (size := parse_length(self.show, "show (--show)")) > 0:
            raise InputError(f"Expected `show` (--show) to be above 0, got {self.show!r}.")
        return size

    def touches(self, seen: ArrayLike, touched: ArrayLike | None) -> Touches:
        """Return the points with what belongs to them."""
        parts = {part.name: getattr(self, part.name) for part in fields(Touches) if hasattr(self, part.name)}
        given = None if touched is None else as_numbers(touched, "touched")
        if given is not None and given.ndim >= 2 and given.shape[-2:] == (4, 4):
            parts["touched_robot"], given = given, None
        points = np.atleast_2d(as_numbers(seen, "seen"))
        if self.touch_sd is None:
            raise InputError("Expected `touch_sd`, the standard deviation of a touch per axis, such as '0.2mm'.")
        parts |= {
            "seen": points, "touched": given, "seen_covariance": covariances_of(self.point_sd, len(points)),
            "touch_sd": _length(self.touch_sd, "touch_sd"), "tool_sd": tool_deviation(self.tool_sd),
            "robot_noise": robot_covariance(self.robot_noise), "names": tuple(map(str, self.names)),
        }  # fmt: skip
        return Touches(**parts)


def verify(
    result: Estimated, seen: ArrayLike | Touches, touched: ArrayLike | None = None, **asked: Any
) -> Verification:
    """Test a calibration by points that its camera saw and a tool touched.

    Model: `evidence.touches`. The difference of touch and point has the covariance of X, the shared errors, the robot,
    the tool, seeing and touching. Answers whether the differences fit it, how large a bias (an offset of all touches)
    is, and which bias these touches would have shown.

    Parameters
    ----------
    result : Calibration
        With the joint covariance of X and W (poses, method efficient or ml).
    seen : (m, 3), or Touches
        Points in the camera frame, m. With `board`: points of the board.
    touched : (m, 3), (m, 4, 4) or None
        Points touched, in the base, m; or the robot poses ``base_T_gripper`` at the touch, as `touched_robot`.
    robot, joints : (m, 4, 4), (m, L) or None
        Robot pose or joints (rad) at which each point was seen, for a camera on the robot.
    touched_robot, touched_joints : (m, 4, 4), (m, L) or None
        Robot pose or joints at the touch. Beside `touched`, the poses tell the orientation of the tool.
    tool : (3,) or None
        Tip of the tool in the flange frame, m; None: its origin.
    touch_sd : float, str or (m,)
        Standard deviation of a touch per axis, m or ``"0.2mm"``.
    point_sd : float, str, (m,), (m, 3) or (m, 3, 3)
        Noise of the points in the camera frame: standard deviations, or covariances. None: the noise of a camera pose
        in the calibration.
    tool_sd : float or str
        Standard deviation of the tool's offset per axis, m, ``"0.3mm"``; 0 is exact, ``"unknown"`` unknown.
    board, board_covariance : (m, 4, 4), (m, 6, 6) or None
        Poses ``camera_T_target`` of a board and their covariance. `seen` are then points of the board.
    same_camera : bool
        False for points of another sensor in the frame of the camera, such as depth: the errors of the calibration's
        focal length and image centre are not theirs.
    robot_noise : (rotation, translation), (6, 6) or None
        Noise of one robot pose: standard deviations such as ``("0.02deg", "0.05mm")``, or its covariance. None: that of
        the calibration, which holds a part of the camera's noise where it was estimated.
    names : sequence of str
    show : float or str
        Bias whose number of touches is computed, m or ``"0.5mm"``.
    candidates : (c, 3) or None
        Points in the camera frame (or of the board) that could be touched next. None: the region of the points so far.

    Returns
    -------
    Verification

    Raises
    ------
    InputError
        A calibration without joint covariance, shapes that do not fit, missing robot poses, millimetres for metres.

    Examples
    --------
    >>> import numpy as np
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> result = uq.calibrate(uq.simulate(setup="eye-to-hand", noise=noise, seed=1), noise=noise)
    >>> seen = np.array([[0.1, 0, 0.7], [-0.1, 0, 0.8], [0, 0.1, 0.7], [0, -0.1, 0.9]])
    >>> touched = seen @ result.X[:3, :3].T + result.X[:3, 3] + [0.0, 0.0, 0.01]
    >>> uq.verify(result, seen, touched, touch_sd="0.2mm", point_sd="0.3mm").contradicted
    True
    """
    require_known("verify", asked, VerifyRequest)
    request = VerifyRequest(**asked)
    touches = seen if isinstance(seen, Touches) else request.touches(seen, touched)
    require_metres(result, touches)
    evidence = evidence_of_touches(result, touches)
    require_other_touches(result, touches, evidence)
    size, known = request.size, touches.tool_known
    bias = bias_of(evidence, known)
    level, (p_bias, p_scatter), (worst, direction) = bias.level, bias.p_values, bias.worst
    at_least = limit(evidence, known, level)
    tool = None if known else evidence.explained_by(evidence.by_tool)
    part = np.abs(bias.hidden.T @ bias.hidden) > THIRD_DIGITS
    hidden = np.diag(part)
    covariance = np.where(part, 0.0, bias.covariance)
    covariance[np.diag_indices(3)] = np.where(hidden, np.inf, np.diag(bias.covariance))
    table = point_table(evidence, touches)
    return Verification(
        bias=np.where(hidden, np.nan, bias.estimate),
        covariance=covariance,
        p_value=bias.p_value,
        bias_p_value=p_bias,
        scatter_p_value=p_scatter,
        chi2=bias.d2 + bias.rest,
        dof=bias.dof + bias.dof_rest,
        noise_dof=bias.reference.noise_dof if bias.dof and np.isfinite(bias.reference.noise_dof) else None,
        points=table,
        detectable=bias.detectable(level),
        limit=at_least,
        worst=direction,
        tool=None if tool is None else -tool.estimate,
        tool_std=None if tool is None else np.sqrt(np.diag(tool.covariance)),
        needed=(Needed(size, touches_needed(evidence, known, size, level), at_least),),
        next=next_touches(result, touches, evidence, level, request.candidates) if np.isfinite(worst) else (),
        findings=tuple(_findings(result, touches, evidence, bias, table)),
        tool_sd=float(touches.tool_sd),
    )


verify.__signature__ = keywords_of(verify, VerifyRequest)  # type: ignore[attr-defined]


def point_table(evidence: TouchEvidence, touches: Touches) -> PointTable:
    """Return the touches one by one, each by itself."""
    S = evidence.own + evidence.by_unit @ evidence.by_unit.mT
    if touches.tool_known:
        p = np.array([evidence.rows(np.array([k])).test.p_value for k in range(touches.m)])
    else:
        S[:, np.arange(3), np.arange(3)] = np.inf
        p = np.full(touches.m, np.nan)
    return PointTable(touches.names, evidence.r, S, p)


def covariances_of(sd: float | str | ArrayLike | None, m: int) -> Array | None:
    """Covariances (3, 3) or (m, 3, 3) of points by one standard deviation, one of each, of each axis, or themselves."""
    if sd is None:
        return None
    values = np.asarray(_length(sd, "point_sd"))
    if values.ndim >= 2 and values.shape[-2:] == (3, 3) and values.shape != (m, 3):
        return values
    if values.shape not in ((), (m,), (m, 3)) or not (np.isfinite(values) & (values >= 0)).all():
        raise InputError(
            f"Expected `point_sd` to be standard deviations >= 0, one, {(m,)} or {(m, 3)}, or covariances "
            f"{(m, 3, 3)}, got shape {values.shape}."
        )
    values = values[..., None] if values.ndim < 2 else values
    return np.broadcast_to(values, (m, 3))[..., None] ** 2 * np.eye(3)


def robot_covariance(noise: tuple[str | float, str | float] | ArrayLike | None) -> Array | None:
    """Covariance (6, 6) of one robot pose by the standard deviations of rotation and translation, or itself."""
    if noise is None:
        return None
    if np.shape(noise) == (2,):
        rotation, translation = cast("tuple[str | float, str | float]", noise)
        sd = np.array(parse_deviations((rotation, translation), "robot_noise (--robot-noise)"))
        return np.diag(np.repeat(sd, 3) ** 2)
    return np.asarray(as_numbers(noise, "robot_noise"))


# Words for the standard deviation of the tool's offset (m).
_OF_TOOL = {"unknown": float("inf"), "?": float("inf"), "inf": float("inf"), "exact": 0.0, "0": 0.0}


def tool_deviation(sd: float | str) -> float:
    """Standard deviation of the tool's offset (m); infinite where it is unknown."""
    known = _OF_TOOL.get(str(sd).strip().lower())
    value = parse_length(sd, "tool_sd (--tool-sd)") if known is None else known
    if not value >= 0:
        raise InputError(f"Expected `tool_sd` (--tool-sd) to be a length >= 0, 'exact' or 'unknown', got {sd!r}.")
    return value


def _length(value: float | str | ArrayLike, name: str) -> Array:
    return as_numbers(value if np.ndim(value) else parse_length(cast("str | float", value), name), name)


def _findings(
    result: Estimated,
    touches: Touches,
    evidence: TouchEvidence,
    bias: Bias,
    points: PointTable,
) -> list[Finding]:
    """Return the findings; inverted robot poses are named where they explain the touches."""
    found = []
    rms = float(np.sqrt(np.mean(np.sum(evidence.r**2, axis=-1))))
    if result.setup == "eye-in-hand" and touches.robot is not None:
        other = replace(touches, robot=inverse(touches.robot))
        other_rms = float(np.sqrt(np.mean(np.sum(evidence_of_touches(result, other).r ** 2, axis=-1))))
        if other_rms**2 < MAX_LEFT_SHARE * rms**2:
            found.append(Finding("verification.inverted_robot", "caution", {"rms": rms, "other": other_rms}))
    if touches.seen_covariance is None and touches.board is None:
        sd = float(np.sqrt(np.einsum("mii->", evidence.own - touches.touch_noise) / (3.0 * touches.m)))
        found.append(Finding("verification.point_noise_assumed", "note", {"sd": sd}))
    if len(bias.hidden):
        posed = touches.touched_robot is not None or touches.touched_joints is not None
        values = {"hidden": len(bias.hidden), "posed": posed}
        found.append(Finding("verification.tool_hides_bias", "caution", values))
    if bias.dof_rest <= 0:
        found.append(Finding("verification.no_scatter", "note", {"count": touches.m, "tested": bias.dof > 0}))
    index = np.flatnonzero(points.flagged)
    if index.size and index.size < touches.m:
        names = [points.names[k] for k in index]
        found.append(Finding("verification.points_differ", "caution", {"names": names, "count": touches.m}))
    return found
