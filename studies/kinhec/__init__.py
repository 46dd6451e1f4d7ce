"""The public benchmark KinHEC: its eleven reference solvers and `calibrate` on the same poses.

KinHEC (`kinhec` 1.1.0 on PyPI, MIT) makes sequences of robot and camera poses with their truth, in eight tracks: noise,
motion, temporal (unknown clock offset), outliers (up to half of the poses), monocular (unknown scale, odometry),
robot_error (joints, Denavit-Hartenberg), pnp (pixel noise) and mixed. Its factors are those of its tier "small" with
outliers of 30 %; its seed is this study's own. The reference solvers run by KinHEC's own protocol (keyframes, the true
clock offset); `calibrate` gets all poses with a measurement, no noise, no truth and no option: of two clocks by
`synchronise`, of an unknown scale with ``camera_scale="unknown"``.

Error: distance of the estimated position of KinHEC's X (the camera on the gripper, or the marker) from the truth.
Inside: the error of `calibrate`'s X (six numbers) is within the 95 % region of its covariance. `COUNT` sequences a
track (quick: 2, of 3 s at 10 Hz), each by seeds of its own. The same command continues a run that was interrupted.

Needs the extra `kinhec`: pip install -e '.[kinhec]'.
"""

from __future__ import annotations

import json
import time
from contextlib import suppress
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import uq_handeye as uq
from studies.common.study import Study, Tables, markdown
from uq_handeye.core.geometry.se3 import Array, logarithm
from uq_handeye.core.presentation.colours import BLUE, ORANGE, QUIET
from uq_handeye.core.presentation.figure_parts import TEXT, canvas, finished, plain
from uq_handeye.core.progress import progress_bar
from uq_handeye.core.threads import one_thread
from uq_handeye.errors import MissingExtraError

SEED = 31
TRACKS = ("noise", "motion", "temporal", "outliers", "monocular", "pnp", "robot_error", "mixed")
COUNT, QUICK_COUNT = 30, 2
QUICK_SECONDS, QUICK_HZ = 3, 10
ATTEMPTS = 5  # draws of a sequence whose arm cannot reach its poses
INSIDE = 12.59  # 95 % quantile of chi-square with 6 degrees of freedom
SOLVER = "solver "


def measure(full: bool, kept: Path | None = None) -> dict[str, pd.DataFrame]:
    """Return one row per sequence: what `calibrate` says, and the errors of all.

    ``kept``: file of the rows so far, one in a line, to which every row is added; those of the other size are not used.
    """
    count = COUNT if full else QUICK_COUNT
    lines = kept.read_text(encoding="utf-8").splitlines() if kept is not None and kept.exists() else []
    rows = [row for line in lines if (row := _whole(line)) is not None and row["full"] == full]
    done = {(row["track"], row["number"]) for row in rows}
    with progress_bar("kinhec", len(TRACKS) * count, "sequences") as advance, one_thread(), catch_warnings():
        simplefilter("ignore", uq.InputWarning)  # what is wrong is in the findings
        for number in range(count):
            for track in TRACKS:
                if (track, number) not in done:
                    row = {"full": full, "number": number} | row_of(sequence_of(track, number, full))
                    rows.append(row)
                    if kept is not None:
                        with kept.open("a", encoding="utf-8") as file:
                            file.write("\n" + json.dumps(row))  # after a line that was not finished
                advance(1)
    table = pd.DataFrame(rows).sort_values(["track", "number"], key=lambda of: of.map(_place)).drop(columns="full")
    return {"sequences": table.reset_index(drop=True)}


def _place(value: Any) -> int:
    return TRACKS.index(value) if isinstance(value, str) else int(value)


def _whole(line: str) -> dict[str, Any] | None:
    """Return a row; None of a line that an interrupted run did not finish."""
    try:
        row: dict[str, Any] = json.loads(line)
    except json.JSONDecodeError:
        return None
    return row


def sequence_of(track: str, number: int, full: bool) -> Any:
    """Return a sequence of a track, as KinHEC reads it; each by seeds of its own.

    The configurations of the track are taken in a random order; once all were, again with other seeds.
    """
    try:
        from kinhec import plans
        from kinhec.generator import GenerationError, generate_sequence
        from kinhec.io import Sequence
    except ImportError as error:
        raise MissingExtraError("The study needs KinHEC. Install it: pip install -e '.[kinhec]'.") from error
    tier = plans.load_tier("small")
    tier["tracks"]["outliers"] |= {
        "fraction": [0.0, 0.05, 0.2, 0.3, 0.5],
        "model": ["random_pose", "planar_flip", "gross"],
    }
    planned = plans.build_plan(tier, [track])[track]
    order = np.random.default_rng([SEED, TRACKS.index(track)]).permutation(len(planned))
    for attempt in range(ATTEMPTS):  # where the arm does not reach the poses they are drawn again, then others
        configuration = planned[order[(number + attempt // 3) % len(planned)]]
        configuration.seed = int(
            np.random.default_rng([SEED, TRACKS.index(track), number, attempt]).integers(2**31 - 1)
        )
        if not full:
            limits = {"duration_s": QUICK_SECONDS, "camera_rate_hz": QUICK_HZ}
            sampling = configuration.sampling
            sampling |= {name: min(limits[name], sampling[name] or limits[name]) for name in limits}
        with suppress(GenerationError):
            found = generate_sequence(configuration)
            return Sequence(found.manifest, found.robot_table, found.camera_table)
    raise RuntimeError(f"KinHEC made no sequence {number} of the track {track}.")


def row_of(sequence: Any) -> dict[str, Any]:
    """Return what `calibrate` and the reference solvers find of a sequence."""
    from kinhec import benchmark

    found = ours(sequence)
    reference = benchmark.evaluate_sequence(sequence, list(benchmark.SOLVERS), "oracle")
    by_solver = {SOLVER + row["solver"]: row.get("X_trans_err_mm", np.nan) for row in reference}
    about = {"track": sequence.manifest["track"], "level": sequence.manifest["level"]}
    return about | found | by_solver


def ours(sequence: Any) -> dict[str, Any]:
    """Calibrate a sequence and return error, d^2, status, flagged rows and seconds of CPU."""
    setup = "eye-in-hand" if sequence.eye_in_hand else "eye-to-hand"
    measured = np.isfinite(sequence.camera.T_cam_target_meas).all(axis=(1, 2))
    camera = sequence.camera.T_cam_target_meas[measured]
    options = {"camera_scale": "unknown"} if sequence.manifest["track"] == "monocular" else {}
    nothing: dict[str, Any] = {"error_mm": np.nan, "d2": np.nan, "good": 0, "flagged": 0}
    start = time.process_time()
    try:
        if sequence.synchronous:
            poses = uq.PosePairs(sequence.robot.T_base_ee_meas[measured], camera, setup)
        else:
            robot = uq.Stream(sequence.robot.t, sequence.robot.T_base_ee_meas)
            poses = uq.synchronise(robot, uq.Stream(sequence.camera.t[measured], camera), setup=setup).poses
        result = uq.calibrate(poses, **options)
    except (uq.InputError, uq.NotConvergedError, uq.DegenerateMotionError) as error:
        why = f"{type(error).__name__}: {str(error).split('.')[0]}"
        return nothing | {"status": "refused", "why": why, "seconds": time.process_time() - start}
    seconds = time.process_time() - start
    assert isinstance(result, uq.Calibration) and result.W is not None
    X, W = (sequence.X, sequence.Y) if sequence.eye_in_hand else (sequence.Y, sequence.X)
    off = (X if sequence.eye_in_hand else W)[:3, 3] - (result.X if sequence.eye_in_hand else result.W)[:3, 3]
    failures = [one.code for one in result.findings if one.severity == "failure"]
    status = "unusable" if failures else "usable" if result.opened is None else "open"
    row = {"status": status, "why": ", ".join(failures), "seconds": seconds, "error_mm": 1e3 * np.linalg.norm(off)}
    if result.covariance is not None and result.opened is None:
        row["d2"] = _d2(result.X, X, result.covariance)
    table = result.table
    if table is not None and sequence.synchronous and len(table) == measured.sum():
        good = ~sequence.camera.outlier[measured]
        row |= {"good": int(good.sum()), "flagged": int((np.array(table.flag) != "kept")[good].sum())}
    return nothing | row


def _d2(found: Array, true: Array, covariance: Array) -> float:
    xi = np.concatenate([logarithm(true[:3, :3] @ found[:3, :3].T), true[:3, 3] - found[:3, 3]])
    return float(xi @ np.linalg.solve(covariance, xi))


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one line per track."""
    solvers = [name for name in map(str, rows) if name.startswith(SOLVER)]
    lines = []
    for track in rows.track.unique():
        of = rows[rows.track == track]
        usable = of[of.status == "usable"]
        medians = of.loc[usable.index, solvers].median()
        best = str(medians.idxmin())
        told = usable[usable.d2.notna()]
        clean = of[of.good > 0]
        lines.append({
            "track": track,
            "sequences": len(of),
            "usable": len(usable),
            "error_mm": usable.error_mm.median(),
            "best_mm": medians[best],
            "best": best.removeprefix(SOLVER),
            "inside": (told.d2 <= INSIDE).mean() if len(told) else np.nan,
            "d2": told.d2.median(),
            "flagged": clean.flagged.sum() / max(clean.good.sum(), 1),
            "seconds": of.seconds.median(),
        })  # fmt: skip
    return pd.DataFrame(lines)


def findings(tables: Tables) -> str:
    rows: Any = tables["sequences"]
    lines: Any = summary(rows)
    shown = [
        {
            "track": one.track,
            "usable": f"{one.usable} of {one.sequences}",
            "calibrate, median": f"{one.error_mm:.2f} mm",
            "best solver, median": f"{one.best_mm:.2f} mm ({one.best})",
            "inside 95 %": f"{100 * one.inside:.0f} %" if np.isfinite(one.inside) else "-",
            "median d^2": f"{one.d2:.1f}" if np.isfinite(one.d2) else "-",
            "good rows flagged": f"{100 * one.flagged:.2f} %",
            "CPU time": f"{one.seconds:.2f} s",
        }
        for one in lines.itertuples()
    ]
    why = rows[rows.status.isin(["refused", "unusable"])].groupby(["track", "status", "why"]).size()
    refused = [f"- {track}, {status}: {count} ({text})" for (track, status, text), count in why.items()]
    opened = rows[rows.status == "open"].groupby("track").size()
    refused += [f"- {track}: {count} leave directions of X open, and say so" for track, count in opened.items()]
    better = sum(one.error_mm < one.best_mm for one in lines.itertuples())
    return "\n\n".join([
        f"`calibrate` has the smallest median error on {better} of {len(lines)} tracks. Medians are of the sequences "
        "whose X it calls usable; the best solver is the one of the eleven with the smallest median on these.",
        markdown(list(shown[0]), [list(line.values()) for line in shown]),
        "Not usable, refused or open:" if refused else "None was refused.",
        "\n".join(refused),
    ])  # fmt: skip


def figures(tables: Tables) -> dict[str, Figure]:
    rows: Any = tables["sequences"]
    lines: Any = summary(rows)
    solvers = [name for name in rows if name.startswith(SOLVER)]
    figure = canvas(3.6)
    axis = figure.subplots()
    for k, one in enumerate(lines.itertuples()):
        of = rows[(rows.track == one.track) & (rows.status == "usable")]
        medians = of[solvers].median()
        axis.plot(np.full(len(medians), k), np.clip(medians, 1e-2, 1e4), "_", color=QUIET, ms=14)
        best = "" if k else "best of the eleven solvers"
        axis.plot(k, medians.min(), "_", color=ORANGE, ms=18, mew=2.5, label=best)
        axis.plot(k, one.error_mm, "o", color=BLUE, ms=7, label="calibrate" if not k else "")
    plain(axis)
    axis.set_yscale("log")
    axis.set_xticks(range(len(lines)), lines.track, fontsize=TEXT, rotation=20)
    axis.set_ylabel("median error of X (mm)", fontsize=TEXT)
    axis.legend(fontsize=TEXT, frameon=False)
    return {"kinhec": finished(figure)}


STUDY = Study("kinhec", measure, findings, figures, packages=("kinhec",), resumes=True)
