"""Test of whether the result of a rig still holds, by new views: p-value, and what moved if something did.

All new rows together are tested (`posterior.rows`). Where they contradict the result, each camera and each target is
tried as the one that moved: the move that explains most, if it explains what is there, is named with its size.

Where the noise was estimated, chi-squares over their number follow F(k, nu), nu = 2 / mean Var(log variance) over the
noise of arms and cameras: as if the sizes of all were uncertain together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.special import chdtrc, fdtrc

from ...core.files.atomic import json_text
from ...core.files.records import Record
from ...core.formatting.numbers import digits, probability
from ...errors import InputError
from ..description import Rig
from .evidence import RigEvidence, evidence_of_views

# A second cause that explains nearly as much: difference of chi-square.
AS_GOOD = 6.0
UNCHANGED, MOVED, CHANGED = "unchanged", "moved", "changed"


@dataclass(frozen=True, eq=False)
class RigMove(Record):
    """One pose that may have moved: its chi-square, size (rad, m) and the probability of it if nothing moved."""

    name: str
    chi_square: float
    angle: float
    shift: float
    p: float
    left: float  # p-value of the rest with this move

    def __str__(self) -> str:
        return f"{self.name}: by {digits(np.degrees(self.angle), 2)} deg and {digits(1e3 * self.shift, 2)} mm"


@dataclass(frozen=True, eq=False)
class RigCheck(Record):
    """Result of a check.

    Attributes
    ----------
    status : "unchanged", "moved" or "changed"
        Moved: one pose explains it. Changed: no single pose does.
    p_value, chi_square : float
        Of all new views, if nothing has changed.
    dof, count : int
        Numbers of them; views.
    moves : tuple of RigMove
        Every camera, target and base, that which explains most first.
    views : dict
        p-value of the views of each pair of camera and target, by "camera, target".
    """

    _in_file: ClassVar[str] = "status p_value chi_square dof count level moves views sentence"

    status: str
    p_value: float
    chi_square: float
    dof: int
    count: int
    level: float
    moves: tuple[RigMove, ...]
    views: dict[str, float]

    @property
    def changed(self) -> bool:
        """True if the new views contradict the result."""
        return self.status != UNCHANGED

    @property
    def sentence(self) -> str:
        """The answer in one or two sentences."""
        said = f"chi-square {self.chi_square:.0f} of {self.dof}, {probability(self.p_value)}"
        if not self.changed:
            return f"UNCHANGED: the {self.count} new views agree with the calibration ({said})."
        if self.status == MOVED:
            near = [one.name for one in self.moves[1:] if one.chi_square > self.moves[0].chi_square - AS_GOOD]
            others = f" As likely: {', '.join(near)}." if near else ""
            return f"MOVED: {self.moves[0]} ({said}).{others} Calibrate it again."
        return f"CHANGED: the {self.count} new views contradict the calibration; no single move explains it ({said})."

    def text(self) -> str:
        """Return the answer and a table of the causes and views."""
        lines = [self.sentence, "", f"{'moved':<20} {'chi-square':>10} {'rotation':>12} {'position':>12}  left"]
        for one in self.moves:
            turn, shift = f"{np.degrees(one.angle):.4f} deg", f"{1e3 * one.shift:.3f} mm"
            lines.append(f"{one.name:<20} {one.chi_square:>10.1f} {turn:>12} {shift:>12}  {probability(one.left)}")
        lines += ["", *(f"{pair}: {probability(p)}" for pair, p in self.views.items())]
        return "\n".join(lines) + "\n"

    def to_json(self) -> str:
        """Return it as JSON text."""
        return json_text(self.to_dict())


def check_rig(result: Any, rig: Rig, *, level: float = 0.05) -> RigCheck:
    """Test whether a calibrated rig still holds.

    Parameters
    ----------
    result : RigCalibration
    rig : Rig
        New robot poses and views, with names and places of the calibrated rig; it may lack some of its things.
    level : float
        Probability of a false alarm.

    Raises
    ------
    InputError
        Names or places that the calibrated rig does not have, a level that is no probability.
    """
    if not 0 < level < 1:
        raise InputError(f"Expected `level` between 0 and 1, got {level!r}.")
    found = evidence_of_views(result, rig)
    d2 = found.rows.d2
    nu = _noise_dof(result)
    p = _p(d2, found.dof, nu)
    moves = sorted((_move(found, name, d2, nu) for name in _seen(found)), key=lambda one: -one.chi_square)
    status = UNCHANGED
    if p < level:
        status = MOVED if moves and moves[0].p * len(moves) < level and moves[0].left > 0.01 * level else CHANGED
    pairs = dict.fromkeys((view.camera, view.target) for view in rig.views)
    views = {f"{camera}, {target}": _of_pair(found, rig, camera, target, nu) for camera, target in pairs}
    return RigCheck(status, p, d2, found.dof, found.graph.E, level, tuple(moves), views)


def _seen(found: RigEvidence) -> list[str]:
    """Names of the poses that the new views depend on."""
    graph = found.graph
    numbers = np.unique(np.concatenate([graph.X, graph.W, *graph.base]))
    return [graph.names[k] for k in numbers.tolist() if k < graph.m]


def _move(found: RigEvidence, name: str, d2: float, nu: float) -> RigMove:
    cause = found.rows.explained_by(found.moved(name))
    rank = int(np.linalg.matrix_rank(cause.covariance, hermitian=True)) if cause.gain > 0 else 0
    angle, shift = (float(np.linalg.norm(part)) for part in (cause.estimate[:3], cause.estimate[3:]))
    left = _p(max(d2 - cause.gain, 0.0), max(found.dof - rank, 1), nu)
    return RigMove(name, cause.gain, angle, shift, _p(cause.gain, max(rank, 1), nu), left)


def _of_pair(found: RigEvidence, rig: Rig, camera: str, target: str, nu: float) -> float:
    """p-value of the views of one pair by themselves."""
    views = [k for k, view in enumerate(rig.views) if (view.camera, view.target) == (camera, target)]
    of = np.isin(found.graph.view, views)[found.edges]
    some = found.rows.rows(of)
    return _p(some.d2, int(of.sum()), nu)


def _noise_dof(result: Any) -> float:
    """Degrees of freedom of the noise; infinite where it was given."""
    spread = [np.log(part["high"] / part["low"]) / 3.92 for part in result.components
              if part["low"] > 0 and part["name"].endswith((" rotation", " translation"))]  # fmt: skip
    return 2.0 / float(np.mean(4 * np.square(spread))) if np.any(spread) else float("inf")


def _p(d2: float, k: int, nu: float) -> float:
    return float(chdtrc(k, d2) if np.isinf(nu) else fdtrc(k, nu, d2 / k))
