"""Arms that are not as their URDF says: are X and what the camera sees elsewhere within what is stated?

    python -m studies.kinematics [--full] [-o results]

Simulated arms (`arms`): three URDFs of published nominal dimensions, kinematic errors drawn once for each arm, exact
forward kinematics with them. 30 poses about one view of the target are calibrated, eye-in-hand and eye-to-hand: with
joints and URDF, the scales of the errors declared or estimated, and without joints. Predicted is what the camera
measures at 20 other joints near the view and at 20 anywhere in the workspace (`predict_camera`).

A population: six-axis arms whose scales are themselves drawn, log-normal by a factor of 2 about those of theory T13,
with a smooth error that no model has. Physical flange: X against the machined flange, with and without the columns that
X and W absorb. Real arms (UQ_HANDEYE_DATA): a Franka FR3 with a camera on its hand and a two-axis positioner before a
sensor, camera poses held out; three Pandas whose tool ball was put into sockets (`touches`), touches held out.

Seed 2019. With ``--full`` 48 sets per cell, 24 of the flange, 8 subsets of a real set; quick: 1.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import uq_handeye as uq
from studies.common.study import Study, Tables
from studies.kinematics.arms import ARMS
from studies.kinematics.figures import figures
from studies.kinematics.findings import findings
from studies.kinematics.real_sets import recorded, subsets
from studies.kinematics.simulated import INSIDE, Case, calibrated, drawn, predicted, rms, scored
from studies.kinematics.touches import fitted, nominal, read_touches, score
from uq_handeye.core.progress import progress_bar

SEED = 2019
SETS, SUBSETS = 48, 8
SETUPS = ("eye-in-hand", "eye-to-hand")
CAMERA = (5e-4, 1e-4)  # rad, m: 0.03 deg, 0.1 mm
TRACKER = (1e-4, 2e-5)
FACTORY = {"joint offsets": np.radians(0.02), "joint tilts": np.radians(0.02), "link lengths": 2e-4}
INDUSTRIAL = {
    "joint offsets": 3e-3,
    "joint tilts": 0.9e-3,
    "link lengths": 0.3e-3,
    "transmission": 0.4e-3,
    "sag": 1.5e-3,
}
COBOT = {"joint offsets": 7.5e-3, "joint tilts": 1.8e-3, "link lengths": 0.3e-3, "transmission": 0.4e-3, "sag": 1e-3}
FIELDS = {
    "joint offsets": "offset_sd",
    "joint tilts": "tilt_sd",
    "link lengths": "length_sd",
    "transmission": "transmission_sd",
    "sag": "sag_sd",
}
# Scales that errors are drawn from, joint noise (rad), and what is said of the arm where its scales are estimated.
OF_ARM: dict[str, tuple[dict[str, float], float, dict[str, Any]]] = {
    "ur5_like": (FACTORY, 5e-5, {FIELDS[group]: sd for group, sd in FACTORY.items()}),
    "irb120_like": (INDUSTRIAL, 2e-4, {"robot_class": "industrial"}),
    "panda_like": (COBOT, 2e-4, {"robot_class": "cobot"}),
}
# The simulated cameras and targets are without the errors that `calibrate` takes real ones to share.
CLEAN: dict[str, Any] = {"shared": []}
FACTOR, JOINT_NOISE, UNMODELLED = 2.0, 2.5e-4, 3e-4  # of the population; rad
REAL = {
    "fr3_philnad": ("eye-in-hand", "cobot"),
    "industrial_kinematic": ("eye-to-hand", "industrial"),
}
TOUCHED = ("panda_2", "panda_3", "panda_6")


def declared(scales: Mapping[str, float], **more: Any) -> uq.KinematicErrors:
    given: dict[str, Any] = {FIELDS[group]: sd for group, sd in scales.items()}
    return uq.KinematicErrors("declared", **given, **more)


def means(found: list[dict[str, float]]) -> dict[str, float]:
    """Over the sets that have an X."""
    table = pd.DataFrame(found)
    values = {str(name): float(value) for name, value in table.drop(columns="refused").mean().items()}
    return {"sets": len(table), "refused": int(table["refused"].sum()), **values}


def of_simulated(full: bool) -> Iterator[dict[str, object]]:
    cells = [(arm, setup) for arm in ARMS for setup in SETUPS]
    with progress_bar("simulated arms", len(cells), "cells") as done:
        for number, (arm, setup) in enumerate(cells):
            if not full and number not in (0, 3):
                continue
            scales, joint_sd, said = OF_ARM[arm]
            found: dict[str, list[dict[str, float]]] = {"declared": [], "estimated": [], "no joints": []}
            for k in range(SETS if full else 1):
                of = drawn(Case(arm, setup, scales, joint_sd, CAMERA), np.random.default_rng([SEED, number, k]))
                with_arm = {"kinematics": of.rig.kinematics, **CLEAN}
                found["declared"].append(
                    scored(of, {**with_arm, "kinematic_errors": declared(scales, joint_sd=joint_sd)})
                )
                found["estimated"].append(scored(of, {**with_arm, "kinematic_errors": uq.KinematicErrors(**said)}))
                found["no joints"].append(scored(of, CLEAN))
            for way, lines in found.items():
                yield {"arm": arm, "setup": setup, "way": way, **means(lines)}
            done(1)


def of_flange(full: bool) -> Iterator[dict[str, object]]:
    """X against the physical flange, with the columns that X absorbs and without."""
    cells = [(arm, setup) for arm in ARMS for setup in SETUPS]
    with progress_bar("flange", len(cells), "cells") as done:
        for number, (arm, setup) in enumerate(cells):
            if not full and number:
                continue
            scales, joint_sd, _ = OF_ARM[arm]
            found: dict[str, list[dict[str, float]]] = {"controller": [], "physical": []}
            for k in range(SETS // 2 if full else 1):
                of = drawn(Case(arm, setup, scales, joint_sd, CAMERA), np.random.default_rng([SEED, 10 + number, k]))
                for flange, lines in found.items():
                    errors = declared(scales, joint_sd=joint_sd, flange=flange)
                    options = {"kinematics": of.rig.kinematics, "kinematic_errors": errors, **CLEAN}
                    flanges = {"controller's": of.rig.X_of_controller, "physical": of.rig.X}
                    lines.append(scored(of, options, flanges))
            for flange, lines in found.items():
                yield {"arm": arm, "setup": setup, "flange": flange, **means(lines)}
            done(1)


def of_population(full: bool) -> Iterator[dict[str, object]]:
    """Arms as the population of theory T13, measured about as well as by a laser tracker, with an error of no model."""
    cells = [(15, "local"), (30, "local"), (30, "anywhere")] if full else [(15, "local")]
    with progress_bar("population", len(cells), "cells") as done:
        for number, (n, where) in enumerate(cells):
            found: dict[str, list[dict[str, float]]] = {"estimated": [], "no joints": []}
            for k in range(SETS if full else 1):
                rng = np.random.default_rng([SEED, 20 + number, k])
                spread = FACTOR ** rng.standard_normal(1 + len(INDUSTRIAL))
                scales = dict(zip(INDUSTRIAL, spread[1:] * list(INDUSTRIAL.values()), strict=True))
                joint_sd = float(JOINT_NOISE * spread[0])
                case = Case("irb120_like", "eye-to-hand", scales, joint_sd, TRACKER, n, where, UNMODELLED)
                of = drawn(case, rng)
                found["estimated"].append(scored(of, {"kinematics": of.rig.kinematics, **CLEAN}))
                found["no joints"].append(scored(of, CLEAN))
            for way, lines in found.items():
                yield {"poses": n, "where": where, "way": way, **means(lines)}
            done(1)


def of_real(folder: Path, full: bool) -> Iterator[dict[str, object]]:
    for name, (setup, kind) in REAL.items():
        of = recorded(folder / name, setup)
        errors = uq.KinematicErrors(robot_class=kind)
        sizes = [("local", 15), ("local", 30), ("anywhere", 15), ("anywhere", 30), ("anywhere", 60)]
        for where, n in sizes if full else sizes[2:3]:
            found: dict[str, list[dict[str, float]]] = {"joints": [], "no joints": []}
            rng = np.random.default_rng([SEED, n, where == "local"])
            for chosen, others in subsets(of, where, n, SUBSETS if full else 1, rng):
                with_arm = {"kinematics": of.kinematics, "kinematic_errors": errors}
                ways: tuple[dict[str, Any], ...] = (with_arm, {})
                for lines, options in zip(found.values(), ways, strict=True):
                    result = calibrated(of.poses(chosen), **options)
                    lines.append(
                        {"refused": 1.0}
                        if result is None or result.posterior is None
                        else {"refused": 0.0}
                        | predicted("held out", result, of.kinematics, of.q[others], of.camera[others])
                    )
            for way, lines in found.items():
                yield {"arm": name, "where": where, "poses": n, "way": way, **means(lines)}


def of_touches(folder: Path, full: bool) -> Iterator[dict[str, object]]:
    """Touches at random of sockets that are known, and of all sockets of a tool position that is new."""
    kinematics = uq.Kinematics.from_urdf(folder / "model.urdf")
    errors = uq.KinematicErrors(robot_class="cobot")
    for arm in TOUCHED if full else TOUCHED[-1:]:
        of = read_touches(folder / arm)
        every, positions = np.arange(len(of.q)), np.unique(of.positions)
        for what, n in (("known socket", 30), ("known socket", 60), ("new tool position", 40)):
            found = []
            for k in range((len(positions) if what.startswith("new") else 8) if full else 1):
                rng = np.random.default_rng([SEED, n, k])
                if what == "known socket":
                    order = rng.permutation(every)
                    chosen, others = order[:n], order[n:]
                    others = others[np.isin(of.sockets[others], of.sockets[chosen])]
                else:
                    others = np.flatnonzero(of.positions == positions[k])
                    chosen = rng.permutation(np.setdiff1d(every, others))[:n]
                model, plain = fitted(kinematics, of.rows(chosen), errors), nominal(kinematics, of.rows(chosen))
                judge = "known" if what == "known socket" else "new"
                residuals, covariances = model.judged(judge, of.rows(others))
                found.append(score(residuals, covariances, INSIDE[3]))
                found[-1] |= {"nominal mm": rms(1e3 * plain.judged(judge, of.rows(others))[0]), "refused": 0.0}
            yield {"arm": arm, "held out": what, "poses": n, **means(found)}


def measure(full: bool) -> Tables:
    tables = {
        "simulated": pd.DataFrame(of_simulated(full)),
        "flange": pd.DataFrame(of_flange(full)),
        "population": pd.DataFrame(of_population(full)),
    }
    if folder := os.environ.get("UQ_HANDEYE_DATA"):
        tables |= {
            "real": pd.DataFrame(of_real(Path(folder), full)),
            "touches": pd.DataFrame(of_touches(Path(folder) / "mukca_panda", full)),
        }
    return tables


STUDY = Study("kinematics", measure, findings, figures)
