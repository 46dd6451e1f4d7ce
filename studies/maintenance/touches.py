"""Touched points against a calibration: p-values without a bias, and biases that should show."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import kstest

from studies.maintenance.rigs import NOISE, Rig, noisy
from uq_handeye.calibration.evidence.touches import Touches, TouchEvidence, evidence_of_touches
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.use.verification.power import bias_of

TOUCH_SD, POINT_SD = 2e-4, 3e-4
LEVEL = 0.05
SETS = 2
TIMES = (1.0, 3.0)  # of the bias that shows with 95 % probability, in the worst direction


def touches_of(of: Rig, rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    """Sets of touches without a bias, and one with each size of it; noise given."""
    points = len(of.robot[0])
    for k in range(SETS):
        at = rng.uniform([-0.15, -0.15, 0.4], [0.15, 0.15, 0.7]) + rng.uniform(-0.1, 0.1, (points, 3))
        evidence = evidence_at(of, k, at, np.zeros(3), rng)
        first = bias_of(evidence)
        yield {"times": 0.0, "p": first.p_value}
    for times in TIMES:
        bias = times * first.detectable(first.level) * first.worst[1]
        yield {"times": times, "p": bias_of(evidence_at(of, SETS - 1, at, bias, rng)).p_value}


def evidence_at(of: Rig, k: int, at: Array, bias: Array, rng: np.random.Generator) -> TouchEvidence:
    """Hold touches against a rig: points in the camera frame, each seen from a robot pose of its own, and touched."""
    exact = of.robot[k]
    robot = noisy(exact, exact, of.setup, rng).robot
    eye_in_hand = of.setup == "eye-in-hand"
    frame = exact @ of.X if eye_in_hand else np.broadcast_to(of.X, exact.shape)
    base = np.einsum("nij,nj->ni", frame[:, :3, :3], at) + frame[:, :3, 3]
    touched = base + bias + TOUCH_SD * rng.standard_normal(base.shape)
    seen = at + POINT_SD * rng.standard_normal(at.shape)
    noise = np.broadcast_to(POINT_SD**2 * np.eye(3), (len(at), 3, 3))
    touches = Touches(
        seen, touched, robot if eye_in_hand else None, seen_covariance=noise, touch_sd=np.asarray(TOUCH_SD),
        robot_noise=np.asarray(NOISE.robot),
    )  # fmt: skip
    return evidence_of_touches(of.result, touches)


def touch_table(of: pd.DataFrame) -> pd.DataFrame:
    """Rates for each setup."""
    rows = []
    for setup, part in of.groupby("setup", sort=False):
        p = {times: group["p"].to_numpy() for times, group in part.groupby("times")}
        rows.append(
            {"setup": setup, "sets": len(p[0.0]), "false_alarms": float(np.mean(p[0.0] < LEVEL))}
            | {"uniform_p": float(kstest(p[0.0], "uniform").pvalue)}
            | {f"found_{times:.0f}": float(np.mean(p[times] < LEVEL)) for times in TIMES}
        )
    return pd.DataFrame(rows)
