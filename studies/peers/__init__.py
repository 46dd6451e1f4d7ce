"""Comparison with OpenCV, GTSAM, SymForce and scikit-surgerycalibration in error, covariance and time, in one run.

The paper compares methods in code of its own (Tables II and III); here the programs that people install from PyPI are
run beside the toolkit, on the same simulated poses of an eye-in-hand camera. Two noises at 30 poses, drawn again in
each trial: isotropic, robot 0.02 deg and 0.05 mm, camera 0.1 deg and 0.5 mm; and one that is weak in depth and tilt,
camera 3, 3, 0.5 mrad and 0.3, 0.3, 3 mm, robot 0.1 mrad and 0.1 mm. 1,000 trials (quick: 40), a tenth for the slow
ones. Seed 2019.

Error over bound: root mean square of the six errors of X, each in units of its Cramer-Rao bound; whether it is larger
than that of `ml` is judged on the same draws. NEES: mean of ``e^T Sigma^-1 e`` of the error e with the covariance that
the program gives itself; 6 if it is true. Time: median CPU time of the process for one data set of 10, 30, 100 and 300
poses, all programs in turn, one thread where that can be asked for. Not counted: building GTSAM's and SymForce's graph,
generating SymForce's code, and the start of both, 4DPA.

Every peer is optional, and named where it is not installed: pip install opencv-python-headless gtsam symforce
scikit-surgerycalibration scikit-surgerycore scikit-surgeryimage.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, NullLocator

import uq_handeye as uq
from studies.common.noises import diagonal
from studies.common.scores import errors, nees, true_means
from studies.common.study import Study, Tables
from studies.peers.findings import OURS, REFERENCE, findings
from studies.peers.programs import PEERS, Prepared, Program, installed
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.core.presentation.colours import BLUE, GREEN, GRID, INK, ORANGE, PURPLE, QUIET, SKY
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.progress import progress_bar
from uq_handeye.core.threads import one_thread
from uq_handeye.trials.simulation.rig import disturbed

SEED = 2019
POSES = 30
NOISES = {
    "isotropic": uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm")),
    "weak in depth and tilt": uq.PoseNoise(diagonal(0.1, 0.1), diagonal(3, 3, 0.5, 0.3, 0.3, 3)),
}
TRIALS, QUICK_TRIALS = 1_000, 40
COUNTS, QUICK_COUNTS = (10, 30, 100, 300), (10, 30)  # of poses, for the times
SECONDS, QUICK_SECONDS = 12.0, 0.5  # of measuring times per number of poses; at least 5 rounds (quick: 3)
COMPARED = 20  # trials in which X and covariance are held against those of `ml`


def measure(full: bool) -> dict[str, pd.DataFrame]:
    programs = [program for program in installed() if full or program.name != "SymForce"]  # its code takes seconds
    trials = TRIALS if full else QUICK_TRIALS
    total = len(NOISES) * sum(_trials(program, trials) for program in programs)
    quality: list[dict[str, Any]] = []
    equal: list[dict[str, Any]] = []
    with ExitStack() as stack:
        stack.enter_context(_one_thread_each())
        advance = stack.enter_context(progress_bar("peers", total, "trials"))
        for index, (label, noise) in enumerate(NOISES.items()):
            draws = _draws(index, noise, trials)
            found = {program.label: list(_found(program, draws, noise, trials, advance)) for program in programs}
            sd = np.sqrt(np.diag(uq.bound(draws[0], noise=noise)))
            quality += [
                {"noise": label} | _quality(p, found[p.label], found[REFERENCE], draws[0], sd) for p in programs
            ]
            equal += [{"noise": label} | row for row in _equal(programs, found)]
        times = list(_times(programs, COUNTS if full else QUICK_COUNTS, SECONDS if full else QUICK_SECONDS))
    left_out = "not in the quick run" if not full else None
    peers = [
        {
            "name": peer.name,
            "package": peer.package,
            "version": (left_out or peer.version) if peer.name == "SymForce" else _version(programs, peer.name),
            "gives": peer.gives,
        }
        for peer in PEERS
    ]
    tables = {"quality": quality, "times": times, "equal": equal, "peers": peers}
    return {name: pd.DataFrame(rows) for name, rows in tables.items()}


def _version(programs: list[Program], name: str) -> str:
    return next((program.version for program in programs if program.name == name), "not installed")


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Use one thread in linear algebra and in OpenCV."""
    with one_thread():
        if find_spec("cv2") is None:
            yield
            return
        cv2: Any = importlib.import_module("cv2")
        before = cv2.getNumThreads()
        cv2.setNumThreads(1)
        try:
            yield
        finally:
            cv2.setNumThreads(before)


def _draws(index: int, noise: uq.PoseNoise, trials: int) -> list[uq.PosePairs]:
    """The exact poses first, which carry their truth, then so many with noise."""
    exact = uq.simulate(POSES, seed=SEED)
    rng = np.random.default_rng([SEED, index])
    robot = disturbed(exact.robot, noise.robot, (trials,), rng)
    camera = disturbed(exact.camera, noise.camera, (trials,), rng)
    return [exact, *(uq.PosePairs(G, C) for G, C in zip(robot, camera, strict=True))]


def _trials(program: Program, trials: int) -> int:
    return max(4, trials // 10) if program.slow else trials


def _found(
    program: Program, draws: list[uq.PosePairs], noise: uq.PoseNoise, trials: int, advance: Callable[[int], None]
) -> Iterator[tuple[Array, Array | None] | None]:
    """X and covariance of each trial; None where there is none, or where it is not finite."""
    for poses in draws[1 : 1 + _trials(program, trials)]:
        try:
            X, S = program.prepare(poses, noise)()
        except (ValueError, RuntimeError, ArithmeticError, np.linalg.LinAlgError):  # InputError and cv2.error are these
            yield None
        else:
            finite = np.isfinite(X).all() and (S is None or np.isfinite(S).all())
            yield (X, S) if finite else None
        advance(1)


def _quality(
    program: Program,
    found: list[tuple[Array, Array | None] | None],
    reference: list[tuple[Array, Array | None] | None],
    exact: uq.PosePairs,
    sd: Array,
) -> dict[str, Any]:
    """Error in units of the bound ``sd`` (6,) and NEES; and what its square exceeds that of ``reference`` by.

    The excess is over the same draws, in units of the bound's variance, with its Monte Carlo error.
    """
    assert exact.truth is not None
    both = [(one, other) for one, other in zip(found, reference, strict=False) if one is not None and other is not None]
    row: dict[str, Any] = {
        "program": program.name,
        "version": program.version,
        "method": program.method,
        "told the noise": program.told,
        "poses": POSES,
        "trials": len(both),
        "failed": len(found) - len(both),
    }
    if len(both) < 2:
        return row
    X = exact.truth.X
    e, theirs = (errors(np.array([pair[which][0] for pair in both]), X) for which in (0, 1))
    squares = np.mean((e / sd) ** 2, axis=1)
    excess = squares - np.mean((theirs / sd) ** 2, axis=1)
    root = np.sqrt(len(both))
    row["error over bound"] = np.sqrt(squares.mean())
    row["standard error"] = squares.std() / root / (2 * row["error over bound"])
    row["excess"], row["excess standard error"] = excess.mean(), excess.std() / root
    covariances = [one[1] for one, _ in both if one[1] is not None]
    if len(covariances) == len(both):
        row["NEES"] = nees(e, np.array(covariances)).mean()
    return row


def _equal(
    programs: list[Program], found: dict[str, list[tuple[Array, Array | None] | None]]
) -> Iterator[dict[str, Any]]:
    """X and covariance of those that have one against `ml`: distance in standard deviations, and |eigenvalue - 1|,
    largest.
    """
    reference = found[REFERENCE]
    for program in programs:
        distances, spreads = [], []
        for one, other in zip(found[program.label][:COMPARED], reference, strict=False):
            if one is None or other is None or one[1] is None:
                continue
            assert other[1] is not None
            e = errors(one[0][None], other[0])
            distances.append(np.sqrt(nees(e, other[1])[0]))
            spreads.append(np.abs(np.linalg.eigvals(np.linalg.solve(other[1], one[1])).real - 1).max())
        if distances and program.label != REFERENCE:
            yield {
                "program": program.name,
                "method": program.method,
                "trials": len(distances),
                "largest distance": max(distances),
                "largest covariance difference": max(spreads),
            }


def _times(programs: list[Program], counts: tuple[int, ...], seconds: float) -> Iterator[dict[str, Any]]:
    of_times = "isotropic"
    noise = NOISES[of_times]
    for n in counts:
        poses = uq.simulate(n, noise=noise, seed=SEED)
        runs = [program.prepare(poses, noise) for program in programs]
        medians, rounds = interleaved(runs, seconds, 5 if seconds > 1 else 3)
        ours = medians[[program.label for program in programs].index(OURS)]
        for program, taken in zip(programs, medians, strict=True):
            yield {
                "noise": of_times,
                "program": program.name,
                "method": program.method,
                "poses": n,
                "rounds": rounds,
                "ms": taken,
                "times efficient": taken / ours,
            }


def interleaved(runs: list[Prepared], seconds: float, least: int) -> tuple[list[float], int]:
    """Median CPU time in ms, each run once per round, and the number of rounds."""
    for run in runs:
        run()
    taken: list[list[float]] = [[] for _ in runs]
    end = time.perf_counter() + seconds
    while time.perf_counter() < end or len(taken[0]) < least:
        for run, times in zip(runs, taken, strict=True):
            began = time.process_time()
            run()
            times.append(1e3 * (time.process_time() - began))
    return [float(np.median(times)) for times in taken], len(taken[0])


# ---------------------------------------------------------------------------------------------------- figures

LOOKS = {
    "OpenCV": (SKY, "-"),
    "scikit-surgerycalibration": (PURPLE, "--"),
    "GTSAM": (ORANGE, "-"),
    "SymForce": (GREEN, "-."),
    "uq-handeye": (BLUE, "-"),
}
MARKERS = "ovsPX^D*ph"


def figures(tables: Tables) -> dict[str, Figure]:
    times, quality = tables["times"], tables["quality"]
    order = list(dict.fromkeys(zip(quality.program, quality.method, strict=True)))
    looks = {}
    for name, (colour, line) in LOOKS.items():
        own = [key for key in order if key[0] == name]
        for marker, key in zip(MARKERS, own, strict=False):
            look: dict[str, Any] = {"color": colour, "linestyle": line, "marker": marker}
            looks[key] = look | {"markersize": 4.5, "linewidth": 1.1, "markerfacecolor": "none"}
    figure = canvas(6.6)
    above, below = np.ravel(np.array(figure.subfigures(2, 1, height_ratios=(1.1, 1))))
    top = above.subplots()
    for key in order:
        rows = times[(times.program == key[0]) & (times.method == key[1])]
        top.plot(rows.poses, rows.ms, **looks[key], label=", ".join(key))
    top.set_xscale("log")
    top.set_yscale("log")
    counts = sorted(set(times.poses))
    top.set_xticks(counts, [f"{n:,}" for n in counts])
    top.xaxis.set_minor_locator(NullLocator())
    top.yaxis.set_major_formatter(lambda y, _: f"{y:g}")
    top.yaxis.set_minor_formatter(NullFormatter())
    top.set_xlabel("poses", fontsize=TEXT)
    top.set_ylabel("CPU time of one data set, ms", fontsize=TEXT)
    top.set_title("a", fontsize=TEXT, loc="left", color=INK)
    plain(top)
    top.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=SMALL, frameon=False, handlelength=3)
    noises = list(dict.fromkeys(quality.noise))
    left, right = below.subplots(1, 2)
    for row, key in enumerate(order):
        for side, noise in enumerate(noises):
            one = quality[(quality.program == key[0]) & (quality.method == key[1]) & (quality.noise == noise)]
            look = looks[key] | {"linestyle": "", "markerfacecolor": looks[key]["color"] if side else "none"}
            at = row + (0.18 if side else -0.18)
            left.errorbar(
                one["error over bound"], [at] * len(one), xerr=3 * one["standard error"], **look, elinewidth=0.8
            )
            right.plot(one["NEES"], [at] * len(one), **look)
            if len(one) and one["NEES"].notna().all():
                right.hlines(at, *true_means(int(one.trials.iloc[0])), color=QUIET, linewidth=0.8)
            elif side:
                where = right.get_yaxis_transform()
                plate = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
                look = {"fontsize": SMALL, "color": QUIET, "va": "center", "ha": "center", "bbox": plate}
                right.text(0.5, row, "no covariance", transform=where, **look)
    for axis, label, middle, panel in (
        (left, "error / bound", 1.0, "b"),
        (right, "mean NEES", 6.0, "c"),
    ):
        axis.axvline(middle, color=QUIET, linewidth=0.8, zorder=0)
        axis.set_xlabel(label, fontsize=TEXT)
        axis.set_title(panel, fontsize=TEXT, loc="left", color=INK)
        axis.set_ylim(len(order) - 0.5, -0.5)
        plain(axis)
        axis.grid(axis="y", color=GRID, linewidth=0.4)
    short = [
        name if name == method else f"{'surgery' if 'surgery' in name else name}, {method}" for name, method in order
    ]
    left.set_yticks(range(len(order)), short)
    right.set_yticks(range(len(order)), [])
    low, high = right.get_xlim()
    right.set_xlim(min(low, 5.0), max(high, 7.0))
    left.set_xscale("log")
    ticks = [x for x in (1, 1.5, 2, 3, 4, 5, 7, 10, 15, 20) if x <= 1.02 * left.get_xlim()[1]]
    left.set_xticks(ticks, [f"{x:g}" for x in ticks])
    left.xaxis.set_minor_locator(NullLocator())
    return {"peers": finished(figure)}


STUDY = Study(
    "peers",
    measure,
    findings,
    figures,
    packages=("opencv-python-headless", "gtsam", "symforce", "scikit-surgerycalibration"),
)
