"""Does the headline hold? The error of X against the stated accuracy, for rigs of the kinds that users have.

    python -m studies.headline [--full] [-o results]

Rigs with known X are drawn at random (`rigs`): noise given or estimated, few and many poses, both setups, outliers,
shared errors, drift, arms without URDF, poses from corners, and files that are wrong. Each is calibrated by
`uq.calibrate` with its defaults. Where the result is usable, the errors of translation, rotation and of a point at the
distance of the target are divided by the accuracy stated for the worst direction (1 sigma). The headline holds where
none of the three is beyond 3. ``chance`` is how often Gaussian errors of the stated covariance would be.

Seed 2020. 30 rigs of each kind with ``--full``, 1 without.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
import pandas as pd

import uq_handeye as uq
from studies.common.scores import errors
from studies.common.study import Study, Tables
from studies.headline.figures import figures
from studies.headline.findings import findings
from studies.headline.rigs import KINDS, Rig
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.core.progress import progress_bar

SEED, RIGS = 2020, 30
BEYOND = 3.0
SAMPLES = 2000


def sizes(e: Array, distance: float, X: Array) -> Array:
    """(..., 3) lengths of the translation, the rotation and the error of a point ahead, of errors (..., 6) of X."""
    arm = distance * X[:3, 2]
    point = e[..., 3:] + np.cross(e[..., :3], arm)
    return np.stack([np.linalg.norm(part, axis=-1) for part in (e[..., 3:], e[..., :3], point)], axis=-1)


def score_rig(rig: Rig) -> dict[str, float]:
    """Calibrate a rig: whether it is usable, and its errors in units of the stated accuracy."""
    line = {"poses": float(rig.poses.n), "to_hand": float(rig.poses.setup == "eye-to-hand")}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            result = uq.calibrate(rig.poses, **rig.options)
        except (uq.InputError, uq.NotConvergedError, uq.DegenerateMotionError):
            return line | {"refused": 1.0, "usable": 0.0}
        accuracy = result.accuracy
    line |= {"refused": 0.0, "usable": float(result.usable and accuracy is not None)}
    if accuracy is None or result.covariance is None:
        return line
    stated = np.array([accuracy.translation, accuracy.rotation, accuracy.point])
    found = sizes(errors(result.X, rig.X), accuracy.distance, result.X) / stated
    rng = np.random.default_rng(0)
    values, axes = np.linalg.eigh(result.covariance)
    e = rng.standard_normal((SAMPLES, 6)) * np.sqrt(np.clip(values, 0, None)) @ axes.T
    by_chance = (sizes(e, accuracy.distance, result.X) > BEYOND * stated).any(axis=-1).mean()
    return line | {
        "lower_limit": float(accuracy.lower_limit),
        "cautions": float(len(result.cautions)),
        "translation_ratio": float(found[0]),
        "rotation_ratio": float(found[1]),
        "point_ratio": float(found[2]),
        "stated_mm": 1e3 * accuracy.translation,
        "stated_deg": float(np.degrees(accuracy.rotation)),
        "dof": float(result.reference.dof or np.inf),
        "chance": float(by_chance),
    }


def measured(full: bool) -> Iterator[dict[str, object]]:
    rigs = RIGS if full else 1
    with progress_bar("headline", len(KINDS) * rigs, "rigs") as done:
        for number, (kind, make) in enumerate(KINDS.items()):
            for k in range(rigs):
                rig = make(np.random.default_rng([SEED, number, k]))
                if rig is not None:
                    yield {"kind": kind, **score_rig(rig)}
                done(1)


def measure(full: bool) -> Tables:
    return {"rigs": pd.DataFrame(list(measured(full)))}


STUDY = Study("headline", measure, findings, figures)
