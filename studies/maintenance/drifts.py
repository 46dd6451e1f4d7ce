"""Series of checks: run lengths of the alarm without a change, and its delay for slow drifts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

import uq_handeye as uq
from studies.maintenance.rigs import NOISES, SETUPS, Rig, rig
from uq_handeye.calibration.evidence.new_poses import PoseEvidence, evidence_of_poses
from uq_handeye.core.runtime.progress import progress_bar
from uq_handeye.use.maintenance.cusum import Scores, cusum, limit_for, scores_of
from uq_handeye.use.maintenance.series_alarm import RESIDUALS, TARGET, Chart, X, charts_of

EVERY = 50.0  # checks for each false alarm: few, so that there are some to count
LENGTH = 100  # checks of a series without change
BEFORE, AFTER = 20, 60  # checks before and after the start of a drift
STEPS = (0.01, 0.02, 0.05)  # of a drift, by the size that one check shows with 95 % probability
CHARTS = (X, TARGET, RESIDUALS)
SETS = 4  # sets of robot poses, in turn


def series_tables(full: bool) -> dict[str, pd.DataFrame]:
    """Tables of run lengths and of drifts, and one drift for the figure."""
    runs = 18 if full else 1
    lengths, delays = [], []
    cells = [(setup, noise) for setup in SETUPS for noise in NOISES][: None if full else 1]
    example: list[dict[str, Any]] = []
    with progress_bar("series", len(cells) * runs, "calibrations") as done:
        for number, (setup, noise) in enumerate(cells):
            found: list[dict[str, float]] = []
            drifted: list[dict[str, float]] = []
            for k in range(runs):
                rng = np.random.default_rng([2122, number, k])
                of = rig(setup, noise, rng, SETS)
                found.append(_without_change(of, rng))
                step = STEPS[k % len(STEPS)]
                line, charts = _drift(of, step, rng)
                drifted.append({"step": step} | line)
                if not number and k == (1 if full else 0):
                    example = [
                        {"chart": c.name, "check": j + 1, "by_limit": float(x / c.limit)}
                        for c in charts
                        for j, x in enumerate(c.path)
                    ]
                done(1)
            lengths.append({"setup": setup, "noise": noise} | _lengths(pd.DataFrame(found)))
            for _, part in pd.DataFrame(drifted).groupby("step"):
                delays.append({"setup": setup, "noise": noise, "step": part["step"].iloc[0]} | _delays(part))
    return {"run_lengths": pd.DataFrame(lengths), "drifts": pd.DataFrame(delays), "one_drift": pd.DataFrame(example)}


def _evidence(of: Rig, series: list[uq.PosePairs]) -> list[PoseEvidence]:
    return [evidence_of_poses(of.result, poses) for poses in series]


def _scores(of: Rig, evidence: list[PoseEvidence]) -> Scores:
    columns = {"X": [-e.linear.J[..., :6] for e in evidence], "target": [-e.linear.J[..., 6:] for e in evidence]}
    return scores_of(evidence, columns, evidence[0].test.reference.noise_dof)


def _without_change(of: Rig, rng: np.random.Generator) -> dict[str, float]:
    """Checks until an alarm: of the charts together, of each alone, and of one of p-values as if independent."""
    evidence = _evidence(of, [of.poses(k % SETS, rng) for k in range(LENGTH)])
    scores = _scores(of, evidence)
    together = [c.alarm for c in charts_of(scores, EVERY)]
    lengths = {"together": min((a for a in together if a is not None), default=None)}
    each = {c.name: c for c in charts_of(scores, EVERY / len(CHARTS))}
    lengths |= {name: c.alarm for name, c in each.items()}
    naive = cusum(np.asarray(-_normal(p_values(of, evidence))))
    lengths["p-values"] = Chart("", naive, limit_for(EVERY)).alarm
    found: dict[str, float] = {}
    for name, alarm in lengths.items():
        found |= {
            f"{name}, checks": LENGTH if alarm is None else alarm + 1,
            f"{name}, alarms": float(alarm is not None),
        }
    return found


def _normal(p: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    from scipy.special import ndtri

    return np.asarray(ndtri(np.clip(p, 1e-300, 1 - 1e-16)))


def p_values(of: Rig, evidence: list[PoseEvidence]) -> np.ndarray[Any, Any]:
    """Return those of each check by itself."""
    references = [e.test.reference for e in evidence[:SETS]]
    return np.array([references[k % SETS].p_value(e.d2) for k, e in enumerate(evidence)])


def _drift(of: Rig, step: float, rng: np.random.Generator) -> tuple[dict[str, float], tuple[Chart, ...]]:
    """X drifts along one direction by the same step from check to check."""
    first = evidence_of_poses(of.result, of.poses(0, rng))
    reference = first.test.reference
    information = first.information(-first.linear.J[..., :6])
    axis = np.zeros(6)
    axis[3:] = rng.standard_normal(3)
    axis /= np.sqrt(axis @ information @ axis / reference.noncentrality(0.95))  # shows with 95 % probability
    n = BEFORE + AFTER
    evidence = _evidence(of, [of.poses(k % SETS, rng, "X", max(k - BEFORE + 1, 0) * step * axis) for k in range(n)])
    charts = charts_of(_scores(of, evidence))
    alarms = [c.alarm for c in charts if c.alarm is not None]
    at = min(alarms) if alarms else n
    sure = np.flatnonzero(p_values(of, evidence)[BEFORE:] < 1e-3)
    found = {"before": float(at < BEFORE), "found": float(BEFORE <= at < n), "delay": float(at - BEFORE + 1)}
    found["size"] = step * max(at - BEFORE + 1, 0)
    found["single"] = float(sure[0] + 1) if sure.size else float(AFTER + 1)
    return found, charts


def _lengths(of: pd.DataFrame) -> dict[str, float]:
    """Average run lengths: checks until alarm or end, over alarms (the run length is nearly exponential)."""
    found: dict[str, float] = {"series": len(of)}
    for name in ("together", *CHARTS, "p-values"):
        alarms = int(of[f"{name}, alarms"].sum())
        found |= {f"alarms, {name}": alarms, f"checks, {name}": int(of[f"{name}, checks"].sum())}
    return found


def _delays(of: pd.DataFrame) -> dict[str, float]:
    kept = of[of["before"] == 0]
    return {
        "series": len(of), "alarm_before": int(of["before"].sum()), "found": int(kept["found"].sum()),
        "delay": float(kept["delay"].median()), "size": float(kept["size"].median()),
        "single": float(kept["single"].median()),
    }  # fmt: skip
