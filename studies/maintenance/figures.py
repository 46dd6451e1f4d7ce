"""Figures of the study."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies.common.study import Tables

_STYLES = {
    ("eye-in-hand", "given"): ("#0072B2", "-", "o"),
    ("eye-in-hand", "estimated"): ("#0072B2", "--", "s"),
    ("eye-to-hand", "given"): ("#D55E00", "-", "^"),
    ("eye-to-hand", "estimated"): ("#D55E00", "--", "v"),
}


def figures(tables: Tables) -> Mapping[str, Figure]:
    """Draw p-values and power."""
    return {"checks": _checks(tables)}


def _checks(tables: Tables) -> Figure:
    figure = Figure(figsize=(6.9, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    for cell, of in tables["p_values"].groupby(["setup", "noise"], sort=False):
        name = _name(cell)
        colour, line, _ = _STYLES[name]
        share = of["checks"] / of["of"] * len(of)
        left.step([*of["from"], 1.0], [*share, share.iloc[-1]], where="post", color=colour, linestyle=line,
                  linewidth=1.2, label=", ".join(name))  # fmt: skip
    left.axhline(1.0, color="0.4", linewidth=0.8)
    left.set_ylim(0, None)
    left.set_xlabel("p-value, nothing changed")
    left.set_ylabel("density")
    for cell, of in tables["power"].groupby(["setup", "noise"], sort=False):
        name = _name(cell)
        colour, line, mark = _STYLES[name]
        error = np.sqrt(of["theory"] * (1 - of["theory"]) / of["checks"])
        right.errorbar(of["theory"], of["found"], yerr=2 * error, color=colour, linestyle="none", marker=mark,
                       markersize=4, fillstyle="full" if line == "-" else "none", label=", ".join(name))  # fmt: skip
    right.plot([0, 1], [0, 1], color="0.4", linewidth=0.8)
    right.set_xlabel("power by theory")
    right.set_ylabel("share found")
    right.legend(frameon=False, fontsize=7.5)
    return figure


def _name(cell: Any) -> tuple[str, str]:
    setup, noise = cell
    return str(setup), str(noise)
