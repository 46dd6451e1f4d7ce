"""Single checks: false alarms, power against theory, causes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

import uq_handeye as uq
from studies.maintenance.rigs import CAUSES, NOISES, SETUPS, Rig, rig
from studies.maintenance.touches import touch_table, touches_of
from uq_handeye.calibration.evidence.new_poses import evidence_of_poses
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.core.progress import progress_bar
from uq_handeye.use.maintenance.causes import columns_of_causes

LEVEL = 0.05
POWERS = (0.3, 0.6, 0.9)
TIMES = 3.0  # the size that shows with 95 % probability, for the causes
BINS = 20
SETS = 4  # of robot poses for each calibration
# Calibrations of a cell; checks of each without a change, and of each size. Estimating the noise takes time.
CALIBRATIONS, CHECKS, SIZES = (
    {"given": 500, "estimated": 1000},
    {"given": 4, "estimated": 2},
    {"given": 2, "estimated": 1},
)


def single_checks(full: bool) -> dict[str, pd.DataFrame]:
    """Tables of false alarms, their p-values, power, causes, and touched points."""
    cells = [(setup, noise) for setup in SETUPS for noise in NOISES]
    total = sum(CALIBRATIONS[noise] if full else 2 for _, noise in cells)
    lines: list[dict[str, Any]] = []
    touches: list[dict[str, Any]] = []
    with progress_bar("checks", total, "calibrations") as done:
        for number, (setup, noise) in enumerate(cells):
            for k in range(CALIBRATIONS[noise] if full else 2):
                rng = np.random.default_rng([2121, number, k])
                drawn_rig = rig(setup, noise, rng, SETS)
                about = {"setup": setup, "noise": noise, "calibration": k}
                lines += [about | line for line in checks_of(drawn_rig, noise, k, rng)]
                touches += [about | line for line in touches_of(drawn_rig, rng)] if noise == "given" else []
                done(1)
    of = pd.DataFrame(lines)
    return {"false_alarms": _false_alarms(of), "p_values": _p_values(of), "power": _power(of), "causes": _causes(of),
            "touches": touch_table(pd.DataFrame(touches))}  # fmt: skip


def checks_of(of: Rig, noise: str, k: int, rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    """Checks without a change, of each size, and of causes."""
    first = [evidence_of_poses(of.result, of.poses(which, rng)) for which in range(min(SETS, CHECKS[noise]))]
    references = [evidence.test.reference for evidence in first]

    def p_value(which: int, cause: str = "", size: Any = 0.0) -> float:
        """Return that of `check`, without its causes; the distribution is that at the same robot poses."""
        evidence = evidence_of_poses(of.result, of.poses(which, rng, cause, size))
        return references[which].p_value(evidence.d2)

    for number in range(CHECKS[noise]):
        p = p_value(number % SETS)
        yield {"what": "nothing", "p": p, "changed": p < LEVEL}
    evidence, reference = first[0], references[0]
    columns = columns_of_causes(evidence, of.setup)
    information = {name: evidence.information(columns[name]) for name in CAUSES}
    for power in POWERS * SIZES[noise]:
        delta = drawn(information["X"], reference.noncentrality(power, LEVEL), rng)
        p = p_value(0, "X", delta)
        yield {"what": "power", "theory": power, "changed": p < LEVEL}
    for cause in (CAUSES[k % 2], CAUSES[2 + k % 2]):
        delta = drawn(information[cause], TIMES**2 * reference.noncentrality(0.95, LEVEL), rng)
        check = uq.check(of.result, of.poses(0, rng, cause, delta))
        named = check.causes.named
        yield {
            "what": "cause", "cause": cause, "changed": check.p_value < LEVEL,
            "right": named is not None and named.name == cause and check.changed,
            "wrong": named is not None and named.name != cause,
            "among": cause in (one.name for one in check.causes.candidates),
        }  # fmt: skip


def drawn(information: Array, noncentrality: float, rng: np.random.Generator) -> Array:
    """Draw a change of the noncentrality given, in a direction that is uniform in its units of information."""
    values, vectors = np.linalg.eigh(information)
    z = rng.standard_normal(len(values))
    return np.asarray(vectors @ (z / np.sqrt(values))) * float(np.sqrt(noncentrality) / np.linalg.norm(z))


def _false_alarms(of: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for (setup, noise), part in of[of["what"] == "nothing"].groupby(["setup", "noise"], sort=False):
        each = part.groupby("calibration")["changed"].mean()
        rows.append(
            {
                "setup": setup, "noise": noise, "calibrations": len(each), "checks": len(part),
                "false_alarms": float(part["changed"].mean()),
                # checks of one calibration are not independent: the standard error is that of the means of each
                "standard_error": float(each.std(ddof=1) / np.sqrt(len(each))),
                "below_0.01": float((part["p"] < 0.01).mean()), "median_p": float(part["p"].median()),
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


def _p_values(of: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for (setup, noise), part in of[of["what"] == "nothing"].groupby(["setup", "noise"], sort=False):
        counts = np.histogram(part["p"], BINS, (0.0, 1.0))[0]
        rows += [
            {"setup": setup, "noise": noise, "from": k / BINS, "checks": int(count), "of": len(part)}
            for k, count in enumerate(counts)
        ]
    return pd.DataFrame(rows)


def _power(of: pd.DataFrame) -> pd.DataFrame:
    groups = of[of["what"] == "power"].groupby(["setup", "noise", "theory"], sort=False)
    rows = [
        {"setup": setup, "noise": noise, "theory": theory, "checks": len(part), "found": float(part["changed"].mean())}
        for (setup, noise, theory), part in groups
    ]
    return pd.DataFrame(rows)


def _causes(of: pd.DataFrame) -> pd.DataFrame:
    groups = of[of["what"] == "cause"].groupby(["setup", "noise", "cause"], sort=False)
    rows = [
        {"setup": setup, "noise": noise, "cause": cause, "checks": len(part)}
        | {name: float(part[name].astype(float).mean()) for name in ("changed", "right", "wrong", "among")}
        for (setup, noise, cause), part in groups
    ]
    return pd.DataFrame(rows)
