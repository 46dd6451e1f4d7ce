"""X from two odometries and the places that follow from it, with what each says of itself; the rows of the tables.

Model: `studies.laser_camera.rig`. The covariance of X takes in that of the clock offset: an offset that is wrong
by d moves X by ``g d``, so that (xi_X, offset) have the covariance ``[[C + v g g^T, v g], [v g^T, v]]``, v the variance
of the offset, C the covariance of X at a known one. Places along a walk move by ``J (xi_X, offset)`` to first order.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

import uq_handeye as uq
from studies.common.scores import errors, nees
from studies.laser_camera import rig as rig
from uq_handeye.core.geometry.se3 import Array, inverse, perturb
from uq_handeye.fit.graph.gauss_helmert import offset_sensitivity
from uq_handeye.trials.simulation.rig import disturbed

SEED = 2019
PAPER_SCALE = 1e5
WHITE, DRIFT = "white", "white and drift"
SENSORS = {WHITE: rig.Sensors(), DRIFT: rig.Sensors().drifting()}
PAPER, LIMIT, EFFICIENT, TOLD = "4dpa, d = 1e5", "4dpa, limit", "efficient", "efficient, told the drift"
METHODS = {WHITE: (PAPER, LIMIT, EFFICIENT), DRIFT: (PAPER, LIMIT, EFFICIENT, TOLD)}
AXES = ("X", "Y", "Z")
SCALES = (1e3, 1e4, 1e5, 1e6, 1e7)
DRIFTS = (0.0, 0.3, 1.0, 3.0)
STEP = 1e-4  # of central differences: rad, m, s
BLOCK = 50  # trials with a joint covariance that are held at once


class Estimate(NamedTuple):
    """X of one recording with what it says of itself."""

    X: Array  # (4, 4)
    exact: Array  # (6, 6): its covariance if the offset were known
    slope: Array  # (6,): d xi_X / d offset, rad/s and m/s

    def joint(self, offset_std: float) -> Array:
        """Covariance (7, 7) of xi_X and the offset."""
        v = offset_std**2
        S = np.empty((7, 7))
        S[:6, :6] = self.exact + v * np.outer(self.slope, self.slope)
        S[:6, 6] = S[6, :6] = v * self.slope
        S[6, 6] = v
        return S


def estimates(recorded: rig.Recording, sync: uq.Synchronised, sensors: rig.Sensors) -> Iterator[tuple[str, Estimate]]:
    """Yield the estimates of one recording by all methods; the last one is given the drift, if there is any."""
    poses, noise, timing = sync.poses, sync.noise, sync.poses.timing
    assert noise is not None and timing is not None and timing.side == "camera"
    motions = uq.relative_motions(poses)
    later, sooner = (
        uq.relative_motions(uq.PosePairs(poses.robot, perturb(poses.camera, sign * STEP * timing.rate)))
        for sign in (1.0, -1.0)
    )
    for name, scale in ((PAPER, PAPER_SCALE), (LIMIT, None)):
        solutions = [uq.solve(pairs.A, pairs.B, scale=scale) for pairs in (later, sooner)]
        slope = errors(solutions[0], solutions[1]) / (2 * STEP)
        X = uq.solve(motions.A, motions.B, scale=scale)
        yield name, Estimate(X, uq.propagate(motions, noise=noise, X=X, scale=scale), slope)
    told = {EFFICIENT: noise}
    if any(sensors.drift):
        told[TOLD] = with_drift(noise, recorded.path, recorded.start, recorded.scanner.timestamps, sensors.drift)
    for name, assumed in told.items():
        fit = uq.efficient(poses, assumed)
        yield name, Estimate(fit.X, fit.covariance_X, offset_sensitivity(fit, timing)[:6])


def with_drift(
    white: uq.PoseNoise, path: rig.Path, start: float, times: Array, drift: tuple[float, float]
) -> uq.PoseNoise:
    """White noise of the pairs and the joint covariance of the camera's drift."""
    assert white.camera is not None
    joint = rig.drift_covariance(path, start, times, drift)
    blocks = joint.reshape(len(times), 6, len(times), 6)
    row = np.arange(len(times))
    blocks[row, :, row] += white.camera
    return uq.PoseNoise(white.robot, joint)


class Calibrations(NamedTuple):
    """T recordings of one kind: what is true of them and what was made of them, by method."""

    offset_errors: Array  # (T,) s
    offset_stds: Array
    found: dict[str, list[Estimate]]
    failed: int

    def X(self, method: str) -> Array:
        return np.array([estimate.X for estimate in self.found[method]])

    def joint(self, method: str) -> Array:
        return np.array([e.joint(std) for e, std in zip(self.found[method], self.offset_stds, strict=True)])


def calibrations(rng: np.random.Generator, case: str, trials: int, done: Callable[[int], None]) -> Calibrations:
    sensors = SENSORS[case]
    offset_errors, stds, failed = [], [], 0
    found: dict[str, list[Estimate]] = {method: [] for method in METHODS[case]}
    for _ in range(trials):
        recorded = rig.recording(rng, sensors)
        done(1)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", uq.InputWarning)
                sync = uq.synchronise(recorded.scanner, recorded.camera, noise=sensors.white, max_offset=1.0)
        except (uq.InputError, uq.NotConvergedError):
            failed += 1
            continue
        if sync.poses.n < rig.SCANS:  # an offset so wrong that scans fall off the end
            failed += 1
            continue
        offset_errors.append(sync.offset - recorded.offset)
        stds.append(sync.offset_std)
        for name, estimate in estimates(recorded, sync, sensors):
            found[name].append(estimate)
    return Calibrations(np.array(offset_errors), np.array(stds), found, failed)


def rms(values: Array, axis: int | None = None) -> Any:
    return np.sqrt(np.mean(np.square(values), axis=axis))


def calibration_rows(experiment: int, case: str, of: Calibrations) -> Iterator[dict[str, Any]]:
    for method in METHODS[case]:
        e, S = errors(of.X(method), rig.X), of.joint(method)[:, :6, :6]
        exact = np.array([estimate.exact for estimate in of.found[method]])
        variances = np.diagonal(S, axis1=1, axis2=2)
        yield {
            "experiment": experiment,
            "noise": case,
            "method": method,
            "trials": len(e),
            "not synchronised": of.failed,
            "rotation error (mrad)": 1e3 * rms(e[:, :3]),
            "rotation sd (mrad)": 1e3 * np.sqrt(variances[:, :3].mean()),
            "translation error (mm)": 1e3 * rms(e[:, 3:]),
            "translation sd (mm)": 1e3 * np.sqrt(variances[:, 3:].mean()),
            "NEES": nees(e, S).mean(),
            "NEES offset taken as exact": nees(e, exact).mean(),
            "offset error (ms)": 1e3 * rms(of.offset_errors),
            "offset sd (ms)": 1e3 * rms(of.offset_stds),
            "offset z^2": np.mean((of.offset_errors / of.offset_stds) ** 2),
        }


def end_slopes(walk: rig.Walk) -> Array:
    """``d place / d (xi_X, offset)`` (m, 3, 7) at the truth, of exact streams, by central differences."""
    columns = []
    for k in range(7):
        places = []
        for sign in (1.0, -1.0):
            xi = np.zeros(6)
            xi[k : k + 1] = sign * STEP  # none for the offset
            late = -sign * STEP if k == 6 else 0.0  # an offset that is too large reads the camera too early
            places.append(rig.fused(walk.late(np.array(late)), walk.G, perturb(rig.X, xi)))
        columns.append((places[0] - places[1]) / (2 * STEP))
    return np.stack(columns, axis=-1)


class Ends(NamedTuple):
    """Places along a walk by T calibrations, and the sensors' share in their covariance."""

    exact: Array  # (T, m, 3) m: errors along the way if the sensors made none
    before: Array  # (T, m, 3): with the X of the drawing
    after: Array  # (T, m, 3)
    by_calibration: Array  # (T, m, 3, 3) covariance
    whole: Array  # (T, m, 3, 3) with the sensors' noise on the walk


def sensors_share(walk: rig.Walk, sensors: rig.Sensors, rng: np.random.Generator, draws: int) -> Array:
    """Covariance (m, 3, 3) of the places along a walk with the true X, by simulation."""
    e = rig.fused(*rig.walked(walk, sensors, rng, draws), rig.X) - walk.G[:, :3, 3]
    return np.asarray(np.einsum("tmi,tmj->mij", e, e) / draws)


def ends(of: Calibrations, walk: rig.Walk, method: str, said: tuple[Array, Array], share: Array) -> Ends:
    """``said`` V and G by `rig.walked`, one walk for each calibration; ``share`` by `sensors_share`."""
    X, late, J = of.X(method), -of.offset_errors, end_slopes(walk)
    true = walk.G[:, :3, 3]
    by_calibration = J @ of.joint(method)[:, None] @ J.mT
    return Ends(
        rig.fused(walk.late(late), walk.G, X) - true,
        rig.fused(*said, rig.NOMINAL) - true,
        rig.fused(*said, X) - true,
        by_calibration,
        by_calibration + share,
    )


def end_rows(experiment: int, case: str, method: str, of: Ends) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    head = {"experiment": experiment, "noise": case, "method": method, "trials": len(of.after)}
    sd = np.sqrt(np.diagonal(of.whole[:, -1], axis1=1, axis2=2))
    by_axis = [
        {
            **head,
            "axis": axis,
            "before, first repeat (m)": abs(of.before[0, -1, k]),
            "after, first repeat (m)": abs(of.after[0, -1, k]),
            "before, RMS (m)": rms(of.before[:, -1, k]),
            "after, RMS (m)": rms(of.after[:, -1, k]),
            "sd by calibration (m)": np.sqrt(of.by_calibration[:, -1, k, k].mean()),
            "sd (m)": rms(sd[:, k]),
            "inside 2 sd": int((np.abs(of.after[:, -1, k]) < 2 * sd[:, k]).sum()),
        }
        for k, axis in enumerate(AXES)
    ]
    distances = nees(of.after[:, -1], of.whole[:, -1])
    return by_axis, {
        **head,
        "NEES by calibration": nees(of.exact[:, -1], of.by_calibration[:, -1]).mean(),
        "NEES": distances.mean(),
        "inside 95 %": int((distances < chi2.ppf(0.95, 3)).sum()),
    }


def path_rows(experiment: int, method: str, walk: rig.Walk, of: Ends) -> Iterator[dict[str, Any]]:
    """The first repeat along the way, for the figure."""
    for k, time in enumerate(walk.times):
        x, y = walk.G[k, :2, 3]
        S = of.whole[0, k, :2, :2]
        yield {
            "experiment": experiment,
            "method": method,
            "time (s)": time,
            "X (m)": x,
            "Y (m)": y,
            **{
                f"{axis} {name} (m)": here + error[0, k, j]
                for name, error in (("before", of.before), ("after", of.after))
                for j, (axis, here) in enumerate((("X", x), ("Y", y)))
            },
            "var X (m^2)": S[0, 0],
            "cov X Y (m^2)": S[0, 1],
            "var Y (m^2)": S[1, 1],
        }


def point_rows(experiment: int, of: Ends) -> Iterator[dict[str, Any]]:
    for repeat, place in enumerate(of.after[:, -1]):
        yield {"experiment": experiment, "repeat": repeat} | {f"{axis} (m)": place[k] for k, axis in enumerate(AXES)}


def scale_rows(rng: np.random.Generator, trials: int) -> Iterator[dict[str, Any]]:
    """Yield the effect of d on the place at the end of experiment 3: exact offset and walk, so that nothing else
    matters.
    """
    walk = rig.walk(3)
    motions, _, _ = drawn(rng, SENSORS[WHITE], trials)
    X = uq.solve(motions.A, motions.B)
    places = {d: rig.fused(walk.V, walk.G, uq.solve(motions.A, motions.B, scale=d))[:, -1] for d in SCALES}
    limit = rig.fused(walk.V, walk.G, X)[:, -1]
    for d, place in places.items():
        after, apart = rms(place - walk.G[-1, :3, 3], 0), np.abs(place - limit).max()
        row = {"d": d, "trials": trials, "farthest from the limit (m)": apart}
        yield row | {f"{axis}, RMS (m)": after[k] for k, axis in enumerate(AXES)}


class Drawn(NamedTuple):
    """Trials on one path with the offset known: consecutive motions, poses, and the exact poses."""

    motions: uq.Motions
    poses: uq.PosePairs
    exact: uq.PosePairs


def drawn(rng: np.random.Generator, sensors: rig.Sensors, trials: int) -> Drawn:
    path, times = drift_path()
    V = inverse(path(np.zeros(1))) @ path(times)
    G = rig.X @ inverse(V[:1]) @ V @ inverse(rig.X)
    fine = np.arange(0.0, times[-1] + 0.5 / rig.DRIFT_STEPS, 1.0 / rig.DRIFT_STEPS)
    whole = rig.drifted(inverse(path(fine[:1])) @ path(fine), fine, sensors.drift, rng, trials)
    at = np.rint(times * rig.DRIFT_STEPS).astype(int)
    camera = disturbed(inverse(whole[:, at]).reshape(-1, 4, 4), sensors.white.camera, (), rng)
    poses = uq.PosePairs(disturbed(G, sensors.white.robot, (trials,), rng), camera.reshape(trials, -1, 4, 4))
    return Drawn(uq.relative_motions(poses), poses, uq.PosePairs(G, inverse(V)))


def drift_path() -> tuple[rig.Path, Array]:
    """One way to wave the rig, and when it is scanned; the camera starts at 0."""
    return rig.waved(np.random.default_rng(SEED), rig.SCANS), 2.0 + np.arange(rig.SCANS) / rig.SCANNER_RATE


def drift_rows(times: float, rng: np.random.Generator, trials: int) -> Iterator[dict[str, Any]]:
    """NEES of X by how the data are used and what of the noise is known; the offset is exact."""
    sensors = rig.Sensors().drifting(times)
    motions, poses, exact = drawn(rng, sensors, trials)
    white = sensors.white
    path, scans = drift_path()
    told = with_drift(white, path, 0.0, scans, sensors.drift) if times else white
    every = uq.relative_motions(poses, "all")
    for name, pairs, estimate in (
        ("consecutive motions", "consecutive", uq.solve(motions.A, motions.B)),
        ("all motions", "all", uq.solve(every.A, every.B)),
    ):
        e, at = errors(estimate, rig.X), uq.relative_motions(exact, pairs)
        for what, noise, kind in (
            ("white, pairs independent", white, "pairs"),
            ("white, shared poses", white, "poses"),
            ("white and drift, shared poses", told, "poses"),
        ):
            yield _drift_row(times, f"4dpa, {name}", what, e, uq.propagate(at, noise=noise, kind=kind))
    for what, noise in (("white, shared poses", white), ("white and drift, shared poses", told)):
        parts = [
            uq.efficient(uq.PosePairs(poses.robot[k : k + BLOCK], poses.camera[k : k + BLOCK]), noise)
            for k in range(0, trials, BLOCK)
        ]
        e = errors(np.concatenate([part.X for part in parts]), rig.X)
        S = np.concatenate([np.broadcast_to(part.covariance_X, (len(part.X), 6, 6)) for part in parts])
        yield _drift_row(times, "efficient", what, e, S)


def _drift_row(times: float, method: str, assumed: str, e: Array, S: Array) -> dict[str, Any]:
    return {
        "drift": times,
        "method": method,
        "noise assumed": assumed,
        "trials": len(e),
        "rotation error (mrad)": 1e3 * rms(e[:, :3]),
        "translation error (mm)": 1e3 * rms(e[:, 3:]),
        "NEES": nees(e, S).mean(),
    }
