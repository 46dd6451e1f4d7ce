"""The uncertainty budget of X as a table (JCGM 100): the share of each source, and what all of them make."""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array
from ...core.presentation.document import Cell, Table
from ...core.presentation.numbers import digits, fixed
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M
from ...fit.diagnostics.budget import Budget
from ...model.errors.key import ErrorKey, Kind, Owner
from ...model.errors.key_text import plain_text
from ...model.errors.models import is_joint
from ..analysis import joint_sides
from ..result import Calibration

KINDS = (Kind.ROTATION, Kind.TRANSLATION)
# The smallest sources, which are one row.
OTHERS = ErrorKey(Owner.ALL, Kind.OTHERS)
DOF = "effective degrees of freedom"
# What is stated for 95 %, of lengths and angles in all directions together.
WITHIN_95 = "95 % of the errors are within"
BUDGET_CAPTION = (
    "Uncertainty budget of X (JCGM 100): standard uncertainties u of translation (mm) and rotation (deg) per axis ("
    "root mean square), share of the variance, degrees of freedom; type A is evaluated from the data, type B declared"
)


def shown_budget(result: Calibration) -> Budget | None:
    """The budget, coupled errors of a side as one source; None where it is not known."""
    if not result.has_budget:
        return None
    budget = result.budget
    for side in (Owner.ROBOT, Owner.CAMERA, Owner.A, Owner.B):
        parts = [key for what in KINDS if ((key := ErrorKey(side, what)),) in budget.keys]
        # Where errors are coupled, the shares of one kind may be beyond 100 % and below 0: only the sum counts.
        S = getattr(result.noise, side, None)
        dense = S is not None and is_joint(S) and side not in joint_sides(result.noise)
        coupling = ErrorKey(side, Kind.COUPLING)
        if parts and (dense or (coupling,) in budget.keys):
            parts += [coupling] if (coupling,) in budget.keys else []
            budget = budget.merged(parts).renamed(tuple(parts), ErrorKey(side, Kind.BOTH))
    return budget


def budget_table(result: Calibration, most: int | None = None) -> Table | None:
    """Return standard uncertainties by source, combined and for 95 %, in the terms of JCGM 100; None: not known.

    Beyond ``most`` sources the smallest are one row.
    """
    budget = shown_budget(result)
    if budget is None:
        return None
    budget = shorten_budget(budget, most)
    factors = {"X translation": MM_PER_M, "X rotation": DEG_PER_RAD}
    standard, shares, whole = budget.standard, budget.group_shares, budget.expanded()
    rows: list[list[Cell]] = []
    largest = np.max([shares[name] for name in factors], axis=0)
    for k in sorted(range(len(largest)), key=lambda k: (budget.keys[k] == (OTHERS,), -largest[k])):
        source = plain_text(budget.sources[k])
        sizes = [fixed(factor * standard[name][k], 2) for name, factor in factors.items()]
        parts = [f"{100 * shares[name][k]:.1f}" for name in factors]
        rows.append([source, budget.types[k], *sizes, *parts, freedom(float(budget.dof[k]))])
    rows.append([])
    of = [(factor, whole[name]) for name, factor in factors.items()]
    ends = [
        ("combined, u_c", [fixed(factor * found.u) for factor, found in of]),
        (DOF, [freedom(u.dof) for _, u in of]),
    ]
    if (accuracy := result.accuracy) is not None and result.covariance_kind == "model":
        within = zip(factors.values(), (accuracy.translation_95, accuracy.rotation_95), strict=True)
        ends.append((WITHIN_95, [fixed(factor * size) for factor, size in within]))
    rows += [[title, "", *cells, "", "", ""] for title, cells in ends]
    head = ["source", "type", "u (mm)", "u (deg)", "% of mm", "% of deg", "dof"]
    if not np.isfinite([*budget.dof, *(found.dof for _, found in of)]).any():  # stated once
        rows = [row[:-1] for row in rows if not row or row[0] != DOF]
        return Table(f"{BUDGET_CAPTION}; all degrees of freedom are infinite", head[:-1], rows, frozenset({1}))
    return Table(BUDGET_CAPTION, head, rows, frozenset({1}))


def shorten_budget(budget: Budget, most: int | None) -> Budget:
    """Return the budget with its smallest sources as one, so that ``most`` remain."""
    if most is None or len(budget.sources) <= most:
        return budget
    sizes = np.max([budget.group_shares[f"X {kind}"] for kind in KINDS], axis=0)
    small = set(np.argsort(-sizes, kind="stable")[most - 1 :].tolist())
    names = [name for k, name in enumerate(budget.sources) if k in small]
    whole = tuple(key for k, source in enumerate(budget.keys) if k in small for key in source)
    return budget.merged(names).renamed(whole, OTHERS)


def freedom(dof: float) -> str:
    """Return degrees of freedom as a whole number, cut off as in JCGM 100, G.4.1; many count as infinite."""
    return "infinite" if not dof < 1000 else f"{int(dof)}" if dof >= 10 else digits(dof, 2)


def budget_shares(result: Calibration) -> dict[str, Array]:
    """Shares (2,) of the variances of X's rotation and translation by source; nothing where there is no budget."""
    budget = shown_budget(result)
    if budget is None:
        return {}
    shares = np.stack([budget.group_shares[f"X {kind}"] for kind in KINDS], axis=-1)  # (sources, 2)
    return dict(zip(budget.sources, shares, strict=True))
