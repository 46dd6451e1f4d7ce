"""Sentences and tables of the study."""

from __future__ import annotations

import numpy as np
import pandas as pd

from studies.common.study import Tables, markdown
from studies.maintenance.single_checks import LEVEL

# Aims: false alarms, power, right and wrong causes, updates in standard deviations.
FALSE_ALARMS, POWER, RIGHT, WRONG = 0.01, 0.03, 0.90, 0.03
GIVEN, ESTIMATED = 1e-6, 0.1


def findings(tables: Tables) -> str:
    """Return all of it."""
    parts = [
        _false_alarms(tables["false_alarms"]), _power(tables["power"]), _causes(tables["causes"]),
        _updates(tables["updates"]),
    ]  # fmt: skip
    parts.insert(3, _touches(tables["touches"]))
    if "real" in tables:
        parts.append(_real(tables["real"]))
    return "\n\n".join(parts)


def _false_alarms(of: pd.DataFrame) -> str:
    rows = [
        (c["setup"], c["noise"], f"{c['checks']:,}",
         f"{100 * c['false_alarms']:.1f} ± {100 * c['standard_error']:.1f} %",
         f"{100 * c['below_0.01']:.1f} %", f"{c['median_p']:.2f}")
        for _, c in of.iterrows()
    ]  # fmt: skip
    worst = float((of["false_alarms"] - LEVEL).abs().max())
    return "\n\n".join(
        [
            "## False alarms",
            markdown(("setup", "noise", "checks", "p < 0.05", "p < 0.01", "median p"), rows),
            f"The rate at the 5 % level is off by at most {100 * worst:.1f} points; "
            + ("the aim is 1 point." if worst <= FALSE_ALARMS else "**the aim is 1 point.**"),
        ]
    )


def _power(of: pd.DataFrame) -> str:
    wide = of.pivot_table(index=["setup", "noise"], columns="theory", values="found", sort=False)
    rows = [
        (*name, *(f"{100 * x:.1f} %" for x in line)) for name, line in zip(wide.index, wide.to_numpy(), strict=True)
    ]
    worst = float((of["found"] - of["theory"]).abs().max())
    n = int(of["checks"].min())
    return "\n\n".join(
        [
            "## Power",
            markdown(("setup", "noise", *(f"by theory {100 * t:.0f} %" for t in wide.columns)), rows),
            f"{n:,} checks per cell. The largest difference from theory is {100 * worst:.1f} points (chance of one "
            f"cell: {100 * 0.5 / np.sqrt(n):.1f} points, 1 sigma, if all checks were independent); "
            + ("the aim is 3." if worst <= POWER else "**the aim is 3.**"),
        ]
    )


def _causes(of: pd.DataFrame) -> str:
    rows = [
        (c["setup"], c["noise"], c["cause"], *(f"{100 * c[name]:.1f} %" for name in ("right", "among", "wrong")))
        for _, c in of.iterrows()
    ]
    alone = of["cause"] != "image centre"
    least, most = float(of["right"][alone].min()), float(of["wrong"].max())
    among = float(of["among"][~alone].min())
    met = least >= RIGHT and most <= WRONG and among >= RIGHT
    return "\n\n".join(
        [
            "## Causes, at three times the size that shows",
            markdown(("setup", "noise", "what changed", "named", "named or among those left", "another named"), rows),
            f"X, target and focal length are named in at least {100 * least:.1f} % of a row. An image centre "
            f"is the same as a rotation of the camera and never named without it; it is among the causes left in at "
            f"least {100 * among:.1f} %. Another cause is named in at most {100 * most:.1f} %. "
            + ("The aim is at least 90 % and at most 3 % in each row." if met else
               "**The aim is at least 90 % and at most 3 % in each row.**"),
        ]
    )  # fmt: skip


def _touches(of: pd.DataFrame) -> str:
    rows = [
        (c["setup"], f"{c['sets']:,}", f"{100 * c['false_alarms']:.1f} %", f"{c['uniform_p']:.2g}",
         f"{100 * c['found_1']:.1f} %", f"{100 * c['found_3']:.1f} %")
        for _, c in of.iterrows()
    ]  # fmt: skip
    header = (
        "setup",
        "sets",
        "p < 0.05, no bias",
        "p-values uniform (p)",
        "found, bias of 95 %",
        "found, three times it",
    )
    return "\n\n".join(["## Touched points", markdown(header, rows)])


def _updates(of: pd.DataFrame) -> str:
    rows = [
        (c["setup"], c["noise"], f"{c['sets']:.0f}", f"{c['from_batch']:.1g}", f"{c['by_order']:.1g}")
        for _, c in of.iterrows()
    ]
    met = all(
        c[name] <= (GIVEN if c["noise"] == "given" else ESTIMATED)
        for _, c in of.iterrows()
        for name in ("from_batch", "by_order")
    )
    return "\n\n".join(
        [
            "## Updates",
            markdown(("setup", "noise", "rigs", "from the fit of all", "between the two orders"), rows),
            "Largest difference of a component of X or W, in its standard deviations. "
            + ("" if met else "**") + "The aim is 1e-6 with noise given and 0.1 with noise estimated."
            + ("" if met else "**"),
        ]
    )  # fmt: skip


def _real(of: pd.DataFrame) -> str:
    rows = [
        (c["set"], c["parts"], c["way"], c["status"], f"{c['p']:.2g}", f"{c['d2_by_dof']:.2f}", c["cause"] or "-",
         f"{c['shift_mm']:.1f} ± {c['sd_mm']:.1f} mm ({c['axis']})", f"{c['detectable_mm']:.1f} mm")
        for _, c in of.iterrows()
    ]  # fmt: skip
    header = ("recording", "calibrated, checked", "assumed", "answer", "p", "d² by dof", "cause",
              "shift of X, clearest axis", "shows with 95 %")  # fmt: skip
    return "\n\n".join(["## Real recordings", markdown(header, rows)])
