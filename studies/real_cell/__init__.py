"""Test of estimated noise, robust estimation and the tests of a result on simulated sets whose truth is known.

Model: ``G X C = W``; every robot and camera pose has a Gaussian error, left rotation, additive translation, of one
standard deviation for rotations and one for translations on each side, which are not told: everything goes through
`uq.calibrate` without any noise model. Geometry: `uq.simulate`, seed 2026; 500 sets per row of the tables of coverage,
100 per row of the table of outliers (quick: 4 and 1). Outliers: some camera poses are rotated by half a turn of
the board, moved by 5 cm, or replaced. Rendered images with known truth are looked for in the folder named by
UQ_HANDEYE_DATA. The paper takes the noise as known, (70).
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import binom

import uq_handeye as uq
from studies.common.scores import CERTAIN, errors, nees
from studies.common.study import Study, Tables, markdown
from uq_handeye.calibration.analysis import Analysis
from uq_handeye.calibration.by_published import reference_of
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.core.presentation.colours import BLUE, GRID, ORANGE, SKY
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.progress import progress_bar
from uq_handeye.fit.diagnostics.resampled import resampled
from uq_handeye.read import read_pose_file

SEED = 2026
CELLS = {
    "robot 0.02 deg, 0.05 mm; camera 0.1 deg, 0.5 mm": (("0.02deg", "0.05mm"), ("0.1deg", "0.5mm")),
    "robot 0.1 deg, 0.1 mm; camera 0.1 deg, 0.3 mm": (("0.1deg", "0.1mm"), ("0.1deg", "0.3mm")),
}
KINDS = ("model", "sandwich", "bootstrap")
CASES = (("eye-in-hand", 15), ("eye-in-hand", 30), ("eye-to-hand", 30))
WRONG = ((40, 4), (20, 1), (10, 1), (6, 1))  # poses, wrong ones among them
SPOILT = ("half turn of the board", "5 cm", "anything")
Row = dict[str, Any]


def sets(n: int, cell: str, setup: str, count: int) -> Iterator[uq.PosePairs]:
    robot, camera = CELLS[cell]
    noise = uq.PoseNoise.isotropic(robot=robot, camera=camera)
    seed = np.random.default_rng([SEED, n, list(CELLS).index(cell), len(setup)])
    many = uq.simulate(n, noise=noise, setup=setup, trials=count, seed=seed)
    assert many.truth is not None
    for robot_poses, camera_poses in zip(many.robot, many.camera, strict=True):
        yield uq.PosePairs(robot_poses, camera_poses, setup, truth=many.truth)


def calibrated(poses: uq.PosePairs, **options: Any) -> uq.Calibration:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        only_noise: dict[str, Any] = {"shared": [], "correlation": "none"}
        return uq.calibrate(poses, **(only_noise | options))


def true_components(cell: str) -> dict[str, float]:
    robot, camera = CELLS[cell]
    S = uq.PoseNoise.isotropic(robot=robot, camera=camera)
    assert S.robot is not None and S.camera is not None
    v = {
        f"{side} {what}": of[k, k]
        for side, of in (("robot", S.robot), ("camera", S.camera))
        for what, k in (("rotation", 0), ("translation", 3))
    }
    for what in ("rotation", "translation"):
        v[f"{what}, robot and camera together"] = v[f"robot {what}"] + v[f"camera {what}"]
    return {name: float(np.sqrt(value)) for name, value in v.items()}


COVERED = ("rotation, robot and camera together", "robot rotation", "camera rotation")
TRANSLATION = "translation, robot and camera together"


def coverage(n: int, cell: str, setup: str, count: int) -> tuple[dict[str, float], dict[str, float]]:
    """Shares of sets in which 95 % intervals and ellipsoids hold the truth, and split halves agree at 95 %.

    Then those in which the 95 % ellipsoid of each covariance holds it, as `calibrate(covariance=)` would give it.
    """
    truth = true_components(cell)
    hits: dict[str, list[bool]] = {name: [] for name in (*COVERED, TRANSLATION, "ellipsoid of X", "split halves")}
    of_kinds: dict[str, list[bool]] = {kind: [] for kind in KINDS}
    for poses in sets(n, cell, setup, count):
        result = calibrated(poses)
        assert result.noise_estimate is not None and result.covariance is not None and poses.truth is not None
        for name in (*COVERED, TRANSLATION):
            component = result.noise_estimate[name]
            assert component.high is not None
            hits[name].append(component.low <= truth[name] <= component.high)
        for kind in KINDS:
            of_kinds[kind].append(bool(distance2(result, poses.truth.X, kind) <= 1))
        hits["ellipsoid of X"].append(of_kinds["model"][-1])
        hits["split halves"].append(bool(result.split_half.passed))
    shares = [{name: float(np.mean(values)) for name, values in of.items()} for of in (hits, of_kinds)]
    return shares[0], shares[1]


def distance2(result: uq.Calibration, truth: Array, kind: str) -> float:
    """d^2 of the truth with one of the covariances, as a multiple of what 95 % stay below."""
    S, limit = result.covariance, result.quantile(0.95)
    if kind != "model":
        analysis = result.analysis
        assert isinstance(analysis, Analysis)
        found = resampled(analysis.data, analysis.method, kind, fit=analysis.fit, seed=analysis.seed)
        S, limit = found.covariance_X, reference_of(found).quantile(0.95)
    assert S is not None
    return float(nees(errors(result.X, truth)[None], S)[0]) / limit


def spoilt(poses: uq.PosePairs, wrong: NDArray[np.int64], kind: str, rng: np.random.Generator) -> uq.PosePairs:
    camera = poses.camera.copy()
    for k in wrong:
        if kind == "half turn of the board":
            camera[k, :3, :3] = camera[k, :3, :3] @ Rotation.from_rotvec([0, 0, np.pi]).as_matrix()
        elif kind == "5 cm":
            direction = rng.normal(size=3)
            camera[k, :3, 3] += 0.05 * direction / np.linalg.norm(direction)
        else:
            camera[k, :3, :3] = Rotation.random(rng=rng).as_matrix()
            camera[k, :3, 3] += rng.normal(scale=0.1, size=3)
    return uq.PosePairs(poses.robot, camera, poses.setup, truth=poses.truth)


def outliers(n: int, bad: int, kind: str, count: int) -> Row:
    """Sets with X within 1.2 times its error without the outliers, the largest ratio, sets in which all outliers
    were rejected, and how many good ones were flagged."""
    rng = np.random.default_rng([SEED, n, bad, len(kind)])
    ratios, found, flagged = [], 0, 0
    for poses in sets(n, next(iter(CELLS)), "eye-in-hand", count):
        assert poses.truth is not None
        wrong = rng.choice(n, bad, replace=False)
        result = calibrated(spoilt(poses, wrong, kind, rng))
        clean = calibrated(poses.rows(np.setdiff1d(np.arange(n), wrong)))
        size, least = (np.linalg.norm(errors(X, poses.truth.X)[3:]) for X in (result.X, clean.X))
        ratios.append(float(size / least))
        assert result.table is not None
        found += set(wrong.tolist()) <= set(result.table.rejected)
        flagged += len(set(result.table.flagged) - set(wrong.tolist()))
    return {
        "poses": n,
        "wrong": bad,
        "kind": kind,
        "sets": count,
        "within_1.2": sum(ratio <= 1.2 for ratio in ratios),
        "largest_ratio": max(ratios),
        "all_found": found,
        "good_flagged_percent": 100 * flagged / (count * (n - bad)),
    }


def rendered(folder: Path) -> Iterator[Row]:
    """The truth of rendered images under noise that is estimated as independent per pose."""
    poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv")
    truth = read_pose_file(folder / "truth.csv")[1][0]
    for robust in (True, False):
        result = calibrated(poses, robust=robust)
        assert result.covariance is not None
        xi = errors(result.X, truth)
        yield {
            "poses": poses.n,
            "robust": robust,
            "d2": nees(xi[None], result.covariance)[0],
            "d2_of_95_percent": result.quantile(0.95),
            "X_off_mm": 1e3 * np.linalg.norm(xi[3:]),
            "halves_agree": bool(result.split_half.passed),
        }


def measure(full: bool) -> Tables:
    count, of_wrong = (500, 100) if full else (4, 1)
    tables: dict[str, list[Row]] = {"coverage": [], "covariances": [], "wrong_poses": []}
    first = next(iter(CELLS))
    with progress_bar("cells", len(CELLS) * len(CASES) + len(WRONG) * len(SPOILT), "rows") as advance:
        for cell in CELLS:
            for setup, n in CASES:
                about = {"noise": cell, "setup": setup, "poses": n, "sets": count}
                shares, of_kinds = coverage(n, cell, setup, count)
                tables["coverage"] += [{**about, "quantity": name, "share": share} for name, share in shares.items()]
                if cell == first and setup == "eye-in-hand":
                    tables["covariances"] += [
                        {**about, "covariance": name, "share": share} for name, share in of_kinds.items()
                    ]
                advance(1)
        for n, bad in WRONG:
            for kind in SPOILT:
                tables["wrong_poses"].append(outliers(n, bad, kind, of_wrong))
                advance(1)
    if "UQ_HANDEYE_DATA" in os.environ:
        tables["rendered"] = list(rendered(Path(os.environ["UQ_HANDEYE_DATA"]) / "synthetic_camera_2"))
    return {name: pd.DataFrame(rows) for name, rows in tables.items()}


def band(sets: int) -> tuple[float, float]:
    """Return the band that holds 99.9 % of the shares if 95 % is true."""
    low, high = (float(binom.ppf(share, sets, 0.95)) / sets for share in ((1 - CERTAIN) / 2, (1 + CERTAIN) / 2))
    return low, high


def judged(table: pd.DataFrame) -> str:
    """Count the shares that are within `band`, and those below (too sure) or above (too cautious)."""
    low, high = band(int(table["sets"].iloc[0]))
    named = [
        (float(row["share"]), f"{row[what]}, {row['poses']} poses, {row['setup']} ({row['share']:.3f})")
        for what in ("quantity", "covariance")
        if what in table
        for row in table.to_dict("records")
    ]
    below = [name for share, name in named if share < low]
    above = [name for share, name in named if share > high]
    inside = len(named) - len(below) - len(above)
    parts = [f"{inside} of {len(named)} shares differ from 95 % by no more than chance"]
    parts += [f"{len(of)} {word}: {'; '.join(of)}" for word, of in (("below", below), ("above", above)) if of]
    return "; ".join(parts) + "."


def findings(tables: Tables) -> str:
    coverages, kinds, wrong = (tables[name] for name in ("coverage", "covariances", "wrong_poses"))
    sets = int(coverages["sets"].iloc[0])
    low, high = band(sets)
    names = list(dict.fromkeys(coverages["quantity"]))
    parts = [
        f"{sets} sets per row. Shares of sets in which the 95 % interval of the noise and the 95 % ellipsoid of X "
        "hold the "
        f"truth, and in which the halves agree; a true 95 % lies between {low:.3f} and {high:.3f} with probability "
        "99.9 %.",
        markdown(
            ["noise", "setup", "poses", *names],
            [
                [noise, setup, poses, *(f"{share:.3f}" for share in own["share"])]
                for (noise, setup, poses), own in coverages.groupby(["noise", "setup", "poses"], sort=False)
            ],
        ),
        judged(coverages),
        "The 95 % ellipsoid by each covariance, noise of the first rows:",
        markdown(
            ["poses", *dict.fromkeys(kinds["covariance"])],
            [[n, *(f"{share:.3f}" for share in own["share"])] for n, own in kinds.groupby("poses", sort=False)],
        ),
        judged(kinds),
        f"Wrong camera poses, sets per row: {int(wrong['sets'].iloc[0])}. Sets in which X is within 1.2 times the "
        "error that "
        "it has without them, the largest such ratio, and sets in which all of them were rejected.",
        markdown(
            ["poses", "wrong", "kind", "X within 1.2", "largest ratio", "all found", "good ones flagged"],
            [
                [
                    row["poses"],
                    row["wrong"],
                    row["kind"],
                    f"{row['within_1.2']} of {row['sets']}",
                    f"{row['largest_ratio']:.2f}",
                    f"{row['all_found']} of {row['sets']}",
                    f"{row['good_flagged_percent']:.2f} %",
                ]
                for row in wrong.to_dict("records")
            ],
        ),
        f"All wrong poses are found in {wrong['all_found'].sum():,} of {wrong['sets'].sum():,} sets; X is within 1.2 "
        "times "
        f"its error without them in {wrong['within_1.2'].sum():,}.",
    ]
    if "rendered" in tables:
        parts.append(of_rendered(tables["rendered"]))
    return "\n\n".join(parts)


def of_rendered(table: pd.DataFrame) -> str:
    said = [
        f"{row.d2:.0f} {'with robust estimation' if row.robust else 'without'} (95 % of true ones below "
        f"{row.d2_of_95_percent:.0f}, X off by {row.X_off_mm:.1f} mm)"
        for row in table.itertuples()
    ]
    sure = (table["d2"] > table["d2_of_95_percent"]).all()
    agree = table["halves_agree"].all()
    return (
        f"Rendered images of one camera, {int(table['poses'].iloc[0])} poses, noise estimated as independent per pose: "
        f"d^2 of the truth is {' and '.join(said)}. The covariance {'is too small' if sure else 'holds the truth'}; "
        "even "
        f"and odd rows {'agree' if agree else 'do not agree'}: what all poses share, such as the intrinsics, they "
        "cannot show."
    )


def figures(tables: Tables) -> dict[str, Figure]:
    panels = ((tables["coverage"], "quantity"), (tables["covariances"], "covariance"))
    figure = canvas(4.4)
    axes = figure.subplots(2, 1, sharex=True, height_ratios=(6, 5))
    looks = {
        ("eye-in-hand", 15): (BLUE, "o", -0.22),
        ("eye-in-hand", 30): (ORANGE, "s", 0.0),
        ("eye-to-hand", 30): (SKY, "D", 0.22),
    }
    for axis, (table, column) in zip(axes, panels, strict=True):
        plain(axis)
        names = list(dict.fromkeys(table[column]))
        axis.axvspan(*band(int(table["sets"].iloc[0])), color=GRID)
        for (setup, n), (colour, marker, shift) in looks.items():
            own = table[(table["setup"] == setup) & (table["poses"] == n)]
            y = np.array([names.index(name) for name in own[column]]) + shift
            look = {"color": colour, "marker": marker, "markersize": 4.5, "linestyle": "none"}
            axis.plot(own["share"], y, label=f"{n} poses, {setup}", markerfacecolor="none", markeredgewidth=1.3, **look)
        axis.set_ylim(len(names) - 0.5, -0.5)
        labels = [name.replace("robot and camera together", "both") for name in names]
        axis.set_yticks(range(len(names)), labels, fontsize=SMALL)
        axis.tick_params(axis="y", length=0)
    axes[0].set_title("intervals, ellipsoid of the model, split halves", fontsize=TEXT, loc="left")
    axes[1].set_title("95 % ellipsoid of X by covariance", fontsize=TEXT, loc="left")
    axes[1].set_xlabel("share of sets that hold the truth (true 95 %: band)", fontsize=TEXT)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=SMALL, frameon=False)
    return {"coverage": finished(figure)}


STUDY = Study("real_cell", measure, findings, figures)
