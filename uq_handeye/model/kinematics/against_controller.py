r"""Comparison of the controller's poses of a robot with the forward kinematics of its joints.

A controller may give its poses in another base frame B and at another tool E than the chain of the URDF, G_i = B T_i E
with T_i = FK(q_i). Neither frame, the tool, the base or both are fitted, and the simplest fit is taken that explains
the poses as well as the others; the remaining difference in mm and deg is that of the two kinematics. With Z_i = T_i^-1
G_i the tool is the mean of Z_i, with Z_i = G_i T_i^-1 the base; both together are a hand-eye problem, which is solved
by the axes of the relative rotations (R_E), the mean (R_B), linear least squares (translations) and a few Gauss-Newton
steps, on none of which the frames depend much. Each fit is repeated on the poses that it explains best, so that a row
whose joints are of another moment does not affect it.

Where no fit explains the poses they are of another arm, or one of the two files is misread. Then other readings of the
joints (`joint_readings`), robot poses inverted or in millimetres, and rows that are shifted by one are tried.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.files.json_values import JsonObject
from ...core.geometry.checks import as_transforms
from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array, inverse, logarithm
from ...core.limits import MIN_POSES_FOR_ROBUST, MIN_POSES_TO_DECIDE
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError
from ...findings import Finding
from .forward import LEVER_M
from .joint_readings import likely_readings, other_arms, single_readings

if TYPE_CHECKING:
    from .chain import Kinematics

# Largest difference (RMS over the better poses, rad and m) of an arm from its model; beyond it, it is another arm.
MAX_MODEL_ERROR = (np.radians(2.0), 0.02)
# Rounding (rad, m) of files and of controllers that give three decimals: frames that differ by less are the same.
THREE_DECIMALS = (2e-5, 1e-5)
# Distance of a pose from the model, in medians of all poses, beyond which it does not count in the fit.
MAX_MEDIANS = 3.0
# Another arm is named if its model explains the poses to this share of `MAX_MODEL_ERROR`.
MAX_SHARE_OF_ARM = 0.25
# Smallest distance (rad, m) from the model of a pose that is reported as an outlier.
MIN_REPORTED_ERROR = (np.radians(0.5), 5e-3)

Frames = tuple[Array, Array]  # base B and tool E (4, 4)


@dataclass(frozen=True, eq=False)
class ControllerComparison(ReadOnlyArrays):
    """Difference between the controller's poses and the forward kinematics of the joints: G = B FK(q) E but for a
    rest.

    Parameters
    ----------
    base, tool : (4, 4) or None
        Frames B and E that explain most of the difference; None: the same frame.
    rotation, translation : (n,)
        What is left at each pose, rad and m.
    apart : tuple of int
        Poses that differ by far more than the others.
    reading : str or None
        Where the poses seem to be of another arm: what would explain them, a key of `sentences.READINGS`.
    detail : tuple of str
        Names of the joints that the reading is about.
    """

    base: Array | None
    tool: Array | None
    rotation: Array
    translation: Array
    apart: tuple[int, ...] = ()
    reading: str | None = None
    detail: tuple[str, ...] = ()

    @property
    def _kept(self) -> NDArray[np.bool_]:
        kept = np.ones(len(self.rotation), dtype=bool)
        kept[list(self.apart)] = False
        return kept

    @property
    def rms(self) -> tuple[float, float]:
        """RMS of the rest, without the poses that are apart: rad and m."""
        kept = self._kept
        return _rms(self.rotation[kept]), _rms(self.translation[kept])

    @property
    def largest(self) -> tuple[float, float]:
        """The same: the largest, rad and m."""
        kept = self._kept
        return float(self.rotation[kept].max()), float(self.translation[kept].max())

    @property
    def same_arm(self) -> bool:
        """True if the chain may be that of this arm."""
        return bool(self.rms[0] <= MAX_MODEL_ERROR[0] and self.rms[1] <= MAX_MODEL_ERROR[1])

    @property
    def exact(self) -> bool:
        """True if the poses are those of the chain to rounding, in the same frames."""
        largest = self.largest
        same = self.base is None and self.tool is None and not self.apart
        return bool(same and largest[0] < THREE_DECIMALS[0] and largest[1] < THREE_DECIMALS[1])

    def adapt(self, kinematics: Kinematics) -> Kinematics:
        """Return the chain with the controller's base frame and tool: its poses are those of the controller.

        Jacobians and columns of errors are then at the controller's tool, in the controller's base.
        """
        if self.base is None and self.tool is None:
            return kinematics  # with its cached values
        first, *others = kinematics.joints
        end, up = kinematics.end, kinematics.up
        if self.base is not None:
            first = replace(first, origin=self.base @ first.origin)
            up = self.base[:3, :3] @ up
        if self.tool is not None:
            end = end @ self.tool
        return replace(kinematics, joints=(first, *others), end=end, up=up)

    @property
    def findings(self) -> list[Finding]:
        """Findings about the difference."""
        values = {
            "rotation": self.rms[0],
            "translation": self.rms[1],
            "largest_rotation": self.largest[0],
            "largest_translation": self.largest[1],
            "tool": _size(self.tool),
            "base": _size(self.base),
            "n": len(self.rotation),
        }
        if not self.same_arm:
            said = {name: values[name] for name in ("rotation", "translation", "n")}
            explained = {"explained_by": self.reading, "joints": list(self.detail)}
            return [Finding("kinematics.another_arm", "failure", said | explained)]
        found = [] if self.exact else [Finding("kinematics.against_controller", "note", values)]
        if self.apart:
            worst = max(self.apart, key=lambda k: float(self.translation[k]) + LEVER_M * float(self.rotation[k]))
            row = {"rows": list(self.apart), "farthest": worst}
            left = {"rotation": float(self.rotation[worst]), "translation": float(self.translation[worst])}
            found.append(Finding("kinematics.rows_apart", "caution", row | left))
        return found

    def to_dict(self) -> JsonObject:
        """Plain numbers: rad and m."""
        return {
            "base": None if self.base is None else self.base.tolist(),
            "tool": None if self.tool is None else self.tool.tolist(),
            "rotation_rms": self.rms[0],
            "translation_rms": self.rms[1],
            "rotation_max": self.largest[0],
            "translation_max": self.largest[1],
            "apart": list(self.apart),
            "same_arm": self.same_arm,
            "reading": self.reading,
        }


def compare_with_controller(
    kinematics: Kinematics, joints: Array, robot: Array, *, explain: bool = True
) -> ControllerComparison:
    """Compare the controller's poses base_T_gripper (n, 4, 4) with the chain at ``joints`` (n, L), rad and m.

    ``explain``: look for another reading where they are of another arm.

    Raises `InputError` for other shapes.
    """
    G = as_transforms(robot, "robot", stack=False)
    T = kinematics.poses(joints)
    if G.shape != T.shape or G.ndim != 3 or not len(G):
        raise InputError(f"Expected as many robot poses as rows of joints, got shapes {G.shape} and {T.shape}.")
    fit = _best(T, G)
    kept = _better(fit.cost)
    apart = np.flatnonzero(
        ~kept
        & (_beyond(fit.rotation, kept, MIN_REPORTED_ERROR[0]) | _beyond(fit.translation, kept, MIN_REPORTED_ERROR[1]))
    ).tolist()
    found = ControllerComparison(fit.base, fit.tool, fit.rotation, fit.translation, tuple(apart))
    if found.same_arm or not explain:
        return found
    found = replace(found, apart=())
    if (reading := _explaining(kinematics, np.asarray(joints, dtype=float), G)) is not None:
        found = replace(found, reading=reading.name, detail=reading.joints)
    return found


# ------------------------------------------------------------------------------------------------------- the frames


class _Fit(NamedTuple):
    """Frames, and the difference of the poses with them."""

    base: Array | None
    tool: Array | None
    rotation: Array  # (n,) rad
    translation: Array  # (n,) m

    @property
    def cost(self) -> Array:
        """(n,) m: both, by `LEVER_M`."""
        return np.asarray(np.hypot(self.translation, LEVER_M * self.rotation))

    @property
    def score(self) -> float:
        """RMS of the cost over the better poses, at least that of rounding."""
        return max(_rms(self.cost[_better(self.cost)]), float(np.hypot(THREE_DECIMALS[1], LEVER_M * THREE_DECIMALS[0])))


def _best(T: Array, G: Array, share: float = 0.5) -> _Fit:
    """Return the frames that explain the poses.

    A further frame must bring the difference below a ``share`` of that of the simpler frames. With few poses the 12
    numbers of two frames explain anything.
    """
    best = _left(T, G, None, None)
    for make in (_tool, _base, _both):
        if make is _both and len(T) < MIN_POSES_FOR_ROBUST:
            continue
        fit = _robust(T, G, make)
        if fit is not None and fit.score < share * best.score:
            best = fit
    return best


def _robust(T: Array, G: Array, make: Callable[[Array, Array], Frames | None]) -> _Fit | None:
    """Frames of the poses that they explain best."""
    rows, fit = np.ones(len(T), dtype=bool), None
    for _ in range(5):
        frames = make(T[rows], G[rows])
        if frames is None:
            return fit
        B, E = frames
        found = _left(T, G, None if make is _tool else B, None if make is _base else E)
        better = _better(found.cost)
        fit = found
        if (better == rows).all() or better.sum() < 3:
            break
        rows = better
    return fit


def _left(T: Array, G: Array, base: Array | None, tool: Array | None) -> _Fit:
    model = T if base is None else base @ T
    model = model if tool is None else model @ tool
    turn = logarithm(G[:, :3, :3] @ model[:, :3, :3].mT)
    shift = G[:, :3, 3] - model[:, :3, 3]
    return _Fit(base, tool, np.sqrt((turn**2).sum(axis=-1)), np.sqrt((shift**2).sum(axis=-1)))


def _tool(T: Array, G: Array) -> Frames:
    return np.eye(4), _middle(inverse(T) @ G)


def _base(T: Array, G: Array) -> Frames:
    return _middle(G @ inverse(T)), np.eye(4)


def _both(T: Array, G: Array) -> Frames | None:
    """B and E of G = B T E; None where the rotations do not tell them apart."""
    i, j = np.triu_indices(len(T), 1) if len(T) <= 30 else (np.arange(len(T) - 1), np.arange(1, len(T)))
    moved = logarithm(T[i, :3, :3].mT @ T[j, :3, :3])
    seen = logarithm(G[i, :3, :3].mT @ G[j, :3, :3])  # R_E^T of the former
    near = np.sqrt((moved**2).sum(axis=-1)) < 3.0  # the axis of half a turn has no sign
    M = moved[near].T @ seen[near]
    if np.linalg.svd(M, compute_uv=False)[1] < 1e-3 * max(np.trace(moved.T @ moved), 1e-12):
        return None
    R_E = orthonormalise(M)
    R_B = orthonormalise((G[:, :3, :3] @ (T[:, :3, :3] @ R_E).mT).sum(axis=0))
    A = np.zeros((len(T), 3, 6))  # t_G = t_B + R_B t_T + R_B R_T t_E
    A[:, :, :3], A[:, :, 3:] = np.eye(3), R_B @ T[:, :3, :3]
    b = G[:, :3, 3] - T[:, :3, 3] @ R_B.T
    t = np.linalg.lstsq(A.reshape(-1, 6), b.ravel(), rcond=None)[0]
    B, E = np.eye(4), np.eye(4)
    B[:3, :3], B[:3, 3], E[:3, :3], E[:3, 3] = R_B, t[:3], R_E, t[3:]
    return B, E


def _middle(Z: Array) -> Array:
    """Mean rotation and mean translation of poses that should be equal; medians choose those that count."""
    centre = np.median(Z[:, :3, 3], axis=0)
    away = np.sqrt(((Z[:, :3, 3] - centre) ** 2).sum(axis=-1))
    rows = _better(away)
    result = np.eye(4)
    result[:3, :3] = orthonormalise(Z[rows, :3, :3].sum(axis=0))
    result[:3, 3] = Z[rows, :3, 3].mean(axis=0)
    return result


def _better(cost: Array) -> NDArray[np.bool_]:
    """Return which values are no more than `MAX_MEDIANS` medians; at least half of them."""
    return np.asarray(cost <= MAX_MEDIANS * np.median(cost))


def _beyond(values: Array, kept: NDArray[np.bool_], limit: float) -> NDArray[np.bool_]:
    return np.asarray(values > max(limit, 2.0 * MAX_MEDIANS * _rms(values[kept])))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _size(T: Array | None) -> list[float] | None:
    """Angle (rad) and length (m) of a frame, None for the same frame."""
    if T is None:
        return None
    return [float(np.linalg.norm(logarithm(T[:3, :3]))), float(np.linalg.norm(T[:3, 3]))]


# ----------------------------------------------------------------------------------------------------- the readings


class _Reading(NamedTuple):
    """One way to read joints and poses."""

    name: str
    joints: tuple[str, ...]  # that it is about, or all in their order
    q: Array
    G: Array
    arm: Kinematics | None = None  # another one


def _explaining(kinematics: Kinematics, q: Array, G: Array) -> _Reading | None:
    """Return the first reading by which the poses are those of the chain; a few poses are tried before all of them."""
    if len(G) < MIN_POSES_TO_DECIDE:
        return None
    readings = chain(_likely(kinematics, q, G), _best_arm(kinematics, q, G), _unlikely(kinematics, q, G))
    return next((one for one in readings if _explains(kinematics, one)), None)


def _explains(kinematics: Kinematics, reading: _Reading) -> bool:
    arm = reading.arm or kinematics
    n = len(reading.G)
    rows = np.unique(np.linspace(0, n - 1, min(n, 10)).astype(int))
    few = _best(arm.poses(reading.q[rows]), reading.G[rows])
    if few.score > 3.0 * np.hypot(MAX_MODEL_ERROR[1], LEVER_M * MAX_MODEL_ERROR[0]):
        return False
    fit = _best(arm.poses(reading.q), reading.G)
    kept = _better(fit.cost)
    return bool(_rms(fit.rotation[kept]) <= MAX_MODEL_ERROR[0] and _rms(fit.translation[kept]) <= MAX_MODEL_ERROR[1])


def _best_arm(kinematics: Kinematics, q: Array, G: Array) -> Iterator[_Reading]:
    """Yield the other arm of the table that explains the poses best, if it does so as an arm of this size would.

    Similar arms explain each other's poses to some cm.
    """
    rows = np.unique(np.linspace(0, len(G) - 1, min(len(G), 10)).astype(int))
    arms = list(other_arms(kinematics))
    scores = [_best(arm.poses(q[rows]), G[rows]).score for _, arm in arms]
    if scores and min(scores) < MAX_SHARE_OF_ARM * np.hypot(MAX_MODEL_ERROR[1], LEVER_M * MAX_MODEL_ERROR[0]):
        names, arm = arms[int(np.argmin(scores))]
        yield _Reading("arm", names, q, G, arm)


def _likely(kinematics: Kinematics, q: Array, G: Array) -> Iterator[_Reading]:
    for name, joints, read in likely_readings(kinematics, q):
        yield _Reading(name, joints, read, G)
    yield _Reading("inverted", (), q, inverse(G))
    for factor, name in ((1e-3, "millimetres"), (1e3, "metres")):
        scaled = G.copy()
        scaled[:, :3, 3] *= factor
        yield _Reading(name, (), q, scaled)
    yield _Reading("rows later", (), q[1:], G[:-1])
    yield _Reading("rows earlier", (), q[:-1], G[1:])


def _unlikely(kinematics: Kinematics, q: Array, G: Array) -> Iterator[_Reading]:
    for name, joints, read in single_readings(kinematics, q):
        yield _Reading(name, joints, read, G)
