"""Updates by new poses against the calibration of all poses together."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

import uq_handeye as uq
from studies.common.scores import errors
from studies.maintenance.rigs import NOISES, SETUPS, calibrated, noisy
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.model.poses.pose_pairs import PosePairs

PARTS = (12, 6, 4)  # poses of the calibration and of two updates


def update_table(full: bool) -> pd.DataFrame:
    """Largest differences of X and W, in standard deviations of the calibration of all poses."""
    rows = []
    cells = [(setup, noise) for setup in SETUPS for noise in NOISES]
    for number, (setup, noise) in enumerate(cells[: None if full else 1]):
        sizes = [_one(setup, noise, np.random.default_rng([2123, number, k])) for k in range(5 if full else 1)]
        rows.append({"setup": setup, "noise": noise, "sets": len(sizes)} | pd.DataFrame(sizes).max().to_dict())
    return pd.DataFrame(rows)


def _one(setup: str, noise: str, rng: np.random.Generator) -> dict[str, float]:
    truth = uq.simulate(n_poses=sum(PARTS), setup=setup, seed=rng).truth
    assert truth is not None
    every = noisy(truth.robot, truth.camera, setup, rng)
    a, b, c = (every.rows(part) for part in np.split(np.arange(sum(PARTS)), np.cumsum(PARTS)[:-1]))
    first = calibrated(a, noise)
    together = calibrated(_joined(a, b, c), noise)
    forth = uq.update(uq.update(first, b, although_changed=True), c, although_changed=True)
    back = uq.update(uq.update(first, c, although_changed=True), b, although_changed=True)
    return {
        "from_batch": max(_distance(forth, together), _distance(back, together)),
        "by_order": _distance(forth, back),
    }


def _joined(*parts: PosePairs) -> PosePairs:
    robot, camera = (np.concatenate([getattr(part, side) for part in parts]) for side in ("robot", "camera"))
    return PosePairs(robot, camera, parts[0].setup)


def _distance(one: Any, other: Any) -> float:
    """Largest difference of a component of X or W, in standard deviations of the other."""
    pairs: list[tuple[Array, Array, Array]] = [(one.X, other.X, other.covariance), (one.W, other.W, other.covariance_W)]
    return float(max(np.abs(errors(a, b) / np.sqrt(np.diag(S))).max() for a, b, S in pairs))
