"""Results and times of the present program beside those of an earlier commit, on one machine in one run.

    python -m studies.performance.against_commit [COMMIT] [--sets NAME ...] [--results | --times] [--rounds 7]

The earlier commit (default: the one before issue 42) is checked out in a temporary work tree. Both programs run in
processes of their own, with one kernel of OpenBLAS and one thread.

Results: every set of poses in the folder that UQ_HANDEYE_DATA names, the commands in the READMEs of its field cases
among them, and simulated sets. X, W, their covariances and the codes and values of all findings are compared, each
value by itself; the largest relative difference of each set is printed. A covariance counts in units of its standard
deviations, a pose in units of its largest number. Values may differ by 1e-9. Some amplify rounding, such as the
distance of a rejected pose or a p-value far in a tail: where a set has a larger difference, the earlier program is run
again with the last digit of NumPy's linear algebra changed at random, and a value may differ by ten times as much as
that changes it. Any other difference is printed and ends with exit status 1. Commands with an option that the present
program does not have are named and not compared.

Times: CPU time of `uq-handeye calibrate` of 30 simulated poses as a process, and of `calibrate` of 114 poses of a real
arm and of 60 simulated ones, in turns with the earlier commit; medians over rounds, and the last one over the time of
one call of Tsai's method in OpenCV 4 at 30 poses.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shlex
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

Json: TypeAlias = "bool | float | str | list[Json] | dict[str, Json] | None"

BEFORE = "cf48eec9"
MAX_DIFFERENCE = 1e-9
# A value may differ by this many times its change by rounding.
MAX_ROUNDING_RATIO = 10.0
# Keys of a result that are compared; of a rig its poses and their joint covariance.
COMPARED = ("status", "X", "W", "covariance", "covariance_W", "poses", "findings")
# Kernel of OpenBLAS. Another one changes more than rounding: signs of eigenvectors, on which random projections depend.
KERNEL = "Haswell"
# What a process runs first: this tree's package, whatever is installed.
FROM_TREE = """
import sys, importlib.machinery
sys.path.insert(0, sys.argv.pop(1))
sys.meta_path.insert(0, importlib.machinery.PathFinder)
"""
RUN = "from uq_handeye.__main__ import main; main()"
# Changes numbers of NumPy's linear algebra by -1, 0 or 1 in the last digit.
OTHER_ROUNDING = """
import numpy
drawn = numpy.random.default_rng(0)
def nudged(x):
    return x * (1.0 + numpy.finfo(float).eps * drawn.integers(-1, 2, numpy.shape(x)))
def with_nudge(function):
    def call(*values, **options):
        found = function(*values, **options)
        return type(found)(*map(nudged, found)) if isinstance(found, tuple) else nudged(found)
    return call
for name in ("cholesky", "eigh", "inv", "qr", "solve", "svd"):
    setattr(numpy.linalg, name, with_nudge(getattr(numpy.linalg, name)))
"""
SIMULATE = """
import uq_handeye as uq
noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
def simulated(n): return uq.simulate(n_poses=n, noise=noise, seed=1)
"""
# Seconds of CPU of a call, median over repeats in a warm process.
CALLS = (
    FROM_TREE
    + SIMULATE
    + """
import os, statistics, time, warnings
warnings.simplefilter("ignore")
def seconds(call, repeats):
    call()
    times = []
    for _ in range(repeats):
        start = time.process_time(); call(); times.append(time.process_time() - start)
    return statistics.median(times)
poses, thirty = simulated(60), simulated(30)
print("calibrate, 60 poses:", seconds(lambda: uq.calibrate(poses), 15))
if folder := os.environ.get("UQ_HANDEYE_DATA"):
    arm = uq.read_poses(f"{folder}/fr3_philnad/robot.csv", f"{folder}/fr3_philnad/camera.csv")
    print("calibrate, 114 poses of the FR3:", seconds(lambda: uq.calibrate(arm), 1))
try:
    from cv2 import CALIB_HAND_EYE_TSAI, calibrateHandEye
except ImportError:
    pass
else:
    sides = [part for T in (thirty.robot, thirty.camera) for part in (T[:, :3, :3], T[:, :3, 3])]
    print("Tsai of OpenCV, 30 poses:", seconds(lambda: calibrateHandEye(*sides, method=CALIB_HAND_EYE_TSAI), 50))
"""
)


class Case(NamedTuple):
    """Commands that run one after the other in a copy of a folder; the last one writes the result."""

    name: str
    folder: Path
    commands: tuple[str, ...]


def real_cases(data: Path) -> Iterator[Case]:
    """Yield the sets of the folder, and the commands of its field cases."""
    still = "calibrate robot.csv camera.csv"
    by_joints = "calibrate camera.csv --joints joints.csv --urdf model.urdf"
    to_hand = f"{still} --setup eye-to-hand"
    commands = {
        "kuka_1": (still, "camera corners.csv --image-size 1928x1208 -o c/;calibrate robot.csv c/"),
        "synthetic_camera_2": (still, "camera corners.csv --image-size 1920x1080 -o c/;calibrate robot.csv c/"),
        "nguyen_pham": (f"{still} --only 0-59", f"{to_hand} --only 0-59"),
        "ethz_robot_arm_sync": (f"{still} --only {','.join(map(str, range(0, 1687, 20)))}",),
        "wu_2019_as_published": (still,),
        "fr3_philnad": (still, by_joints, f"{still} --only 0-37"),
        "industrial_kinematic": (to_hand, f"{by_joints} --setup eye-to-hand"),
        "industrial_grid_10x10": (still,),
        "metric_medium": (
            "calibrate robot.csv camera_1.csv --pair time --setup eye-to-hand",
            "calibrate robot.csv --camera a=camera_1.csv --camera b=camera_3.csv --setup eye-to-hand",
        ),
    }  # fmt: skip
    for name, several in commands.items():
        for line in several:
            yield Case(f"{name}: {line[:60]}", data / name, tuple(line.split(";")))
    for folder in sorted((data / "field_cases").glob("[0-9]*")):
        made: list[str] = []
        for line in re.findall(r"^ +uq-handeye ((?:camera|calibrate) .*)$", (folder / "README.md").read_text(), re.M):
            command = shlex.join(shlex.split(re.sub(r"[][]", "", line), comments=True))
            if command.startswith("camera "):
                made.append(command)
            else:
                yield Case(f"{folder.name}: {command[10:60]}", folder, (*made, command))


def simulated_cases(folder: Path, tree: Path, environment: dict[str, str]) -> Iterator[Case]:
    """Write simulated poses by the program of one tree and yield their sets."""
    noise = "--robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm"
    options = {
        "12": "--poses 12",
        "30": "--poses 30",
        "60": "--poses 60 --seed 3",
        "to hand": "--poses 25 --setup eye-to-hand",
        "exact": "--poses 15",
    }
    for name, option in options.items():
        where = folder / name.replace(" ", "_")
        run(tree, [*f"simulate -o {where} {option}".split(), *(noise.split() if name != "exact" else ())], environment)
        setup = " --setup eye-to-hand" if "to-hand" in option else ""
        line = f"calibrate robot.csv camera.csv{setup}"
        yield Case(f"simulated: {name}", where, (line,))
        if name == "30":
            for more in ("--method ml", "--method 4dpa", "--method park", noise, "--shared none"):
                yield Case(f"simulated: {name}, {more}", where, (f"{line} {more}",))


def run(
    tree: Path, arguments: list[str], environment: dict[str, str], folder: Path | None = None, prepare: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run a command of the program of one tree, after the code ``prepare``."""
    command = [sys.executable, "-c", FROM_TREE + prepare + RUN, str(tree), *arguments]
    return subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True)


def result_of(case: Case, tree: Path, environment: dict[str, str], prepare: str = "") -> dict[str, Json]:
    """Return the exit status and the compared part of the result of one case; of an unknown option the message."""
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(shutil.copytree(case.folder, Path(scratch) / "case"))
        for command in case.commands[:-1]:
            run(tree, shlex.split(command), environment, copy, prepare)
        last = shlex.split(case.commands[-1].replace("-o result/", ""))
        done = run(tree, [*last, "-o", "answer"], environment, copy, prepare)
        written = next(iter(sorted(copy.glob("answer/*.json"))), None)
        found: dict[str, Json] = {"status": float(done.returncode)}
        if absent := re.search(r"No such option: \S+", done.stderr):
            return found | {"absent": absent.group()}
        if written is not None:
            values: dict[str, Json] = json.loads(written.read_text())
            found |= {key: values[key] for key in COMPARED if key in values}
            if isinstance(found.get("poses"), dict):  # the table of one camera: residuals, distances, leverage
                del found["poses"]
        return found


def differences(before: Json, after: Json, place: str = "") -> Iterator[tuple[str, float]]:
    """Yield the place and the relative difference of each value; infinite where two results differ in kind."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in sorted(before.keys() | after.keys()):
            where = f"{place}.{key}" if place else key
            if key in before and key in after:
                yield from differences(before[key], after[key], where)
            else:
                yield where, np.inf
    elif isinstance(before, list) and isinstance(after, list):
        arrays = [numbers(values) for values in (before, after)]
        if arrays[0] is not None and arrays[1] is not None and arrays[0].shape == arrays[1].shape:
            yield place, array_difference(arrays[0], arrays[1])
        elif len(before) != len(after):
            yield place, np.inf
        else:
            for k, (one, other) in enumerate(zip(before, after, strict=True)):
                yield from differences(one, other, f"{place}[{k}]")
    elif isinstance(before, int | float) and isinstance(after, int | float):
        yield place, abs(before - after) / max(abs(before), abs(after), 1e-9)
    else:
        yield place, 0.0 if before == after else np.inf


def allowances(before: dict[str, Json], other_rounding: dict[str, Json]) -> dict[str, float]:
    """Return what each value may differ by, by its name (`name_of`), from a result with other rounding."""
    found: dict[str, float] = {}
    for place, size in differences(before, other_rounding):
        if size < np.inf:
            found[name_of(place)] = max(found.get(name_of(place), MAX_DIFFERENCE), MAX_ROUNDING_RATIO * size)
    return found


def disagreements(
    before: dict[str, Json], after: dict[str, Json], allowed: dict[str, float]
) -> list[tuple[str, float]]:
    """Return the places and the differences of all values that differ by more than is allowed."""
    found = differences(before, after)
    return [(place, size) for place, size in found if size > allowed.get(name_of(place), MAX_DIFFERENCE)]


def name_of(place: str) -> str:
    """The place of a value without its number in a list of one finding: values of the worst poses are alike.

    >>> name_of("findings[0].values.worst[3].distance2")
    'findings[0].values.worst.distance2'
    """
    return re.sub(r"(?<!^findings)\[\d+\]", "", place)


def numbers(values: list[Json]) -> np.ndarray | None:
    """Return the values as an array; None if they are not all numbers."""
    try:
        array = np.array(values)
    except ValueError:
        return None
    return array.astype(float) if array.dtype.kind in "if" and array.size else None


def array_difference(before: np.ndarray, after: np.ndarray) -> float:
    """Return the largest difference, of a covariance in units of its standard deviations, else of the largest value."""
    unit = np.full(before.shape, max(float(np.abs(before).max()), 1e-9))
    if before.ndim == 2 and len(before) % 6 == 0 and before.shape == before.T.shape and np.allclose(before, before.T):
        sd = np.sqrt(np.maximum(np.diag(before), 1e-12 * float(np.diag(before).max())))
        unit = np.maximum(np.outer(sd, sd), np.finfo(float).tiny)
    return float((np.abs(before - after) / unit).max())


def compare_results(trees: tuple[Path, Path], environment: dict[str, str], only: list[str]) -> bool:
    """Print the largest difference of each case and return whether all agree."""
    agree = True
    with tempfile.TemporaryDirectory() as folder:
        cases = list(simulated_cases(Path(folder), trees[0], environment))
        if data := environment.get("UQ_HANDEYE_DATA"):
            cases += real_cases(Path(data))
        for case in cases:
            if only and not any(word in case.name for word in only):
                continue
            before, after = (result_of(case, tree, environment) for tree in trees)
            if "absent" in after:
                print(f"{case.name:62} {after['absent']}", flush=True)
                continue
            place, largest = max(differences(before, after), key=lambda one: one[1])
            beyond = disagreements(before, after, {})
            if beyond:
                rounded = result_of(case, trees[0], environment, OTHER_ROUNDING)
                beyond = disagreements(before, after, allowances(before, rounded))
            agree &= not beyond
            print(f"{case.name:62} exit {before['status']:.0f}  {largest:8.1e} {place}", flush=True)
            for place, size in beyond:
                print(f"    differs by more than rounding: {size:8.1e} {place}", flush=True)
    return agree


def compare_times(trees: tuple[Path, Path], environment: dict[str, str], rounds: int) -> None:
    """Print medians of CPU times of both programs, measured in turns."""
    times: dict[str, tuple[list[float], list[float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder) / "30"
        next(case for case in simulated_cases(Path(folder), trees[0], environment) if case.folder == files)
        for number in range(rounds + 1):
            for k, tree in enumerate(trees):
                start = resource.getrusage(resource.RUSAGE_CHILDREN)
                run(tree, ["calibrate", str(files / "robot.csv"), str(files / "camera.csv")], environment)
                end = resource.getrusage(resource.RUSAGE_CHILDREN)
                found = {"process, 30 poses": end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime}
                called = subprocess.run(
                    [sys.executable, "-c", CALLS, str(tree)],
                    env=environment,
                    capture_output=True,
                    text=True,
                    check=True,
                )
                for line in called.stdout.splitlines():
                    name, _, value = line.partition(":")
                    found[name] = float(value)
                if number:  # the first round compiles
                    for name, seconds in found.items():
                        times.setdefault(name, ([], []))[k].append(seconds)
    print(f"{'CPU time':34} {'before':>10} {'now':>10} {'ratio':>7}")
    for name, both in times.items():
        before, now = map(statistics.median, both)
        print(f"{name:34} {1e3 * before:7.1f} ms {1e3 * now:7.1f} ms {now / before:7.2f}")
    if "Tsai of OpenCV, 30 poses" in times:
        tsai, sixty = times["Tsai of OpenCV, 30 poses"], times["calibrate, 60 poses"]
        ratios = [statistics.median(b) / statistics.median(a) for a, b in zip(tsai, sixty, strict=True)]
        print(f"{'calibrate, 60 poses, in calls of Tsai':34} {ratios[0]:10.1f} {ratios[1]:10.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("commit", nargs="?", default=BEFORE)
    parser.add_argument(
        "--sets", nargs="*", default=[], help="words in the names of the sets to compare (default: all)"
    )
    parser.add_argument("--results", action="store_true", help="results only")
    parser.add_argument("--times", action="store_true", help="times only")
    parser.add_argument("--rounds", type=int, default=7)
    asked = parser.parse_args()
    here = Path(__file__).resolve().parents[2]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    environment |= {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "MKL", "OMP")}
    environment["OPENBLAS_CORETYPE"] = KERNEL
    agree = True
    with tempfile.TemporaryDirectory() as folder:
        tree, environment["PYTHONPYCACHEPREFIX"] = Path(folder) / "before", str(Path(folder) / "compiled")
        subprocess.run(["git", "-C", here, "worktree", "add", "--quiet", "--detach", tree, asked.commit], check=True)
        try:
            if not asked.times:
                agree = compare_results((tree, here), environment, asked.sets)
            if not asked.results:
                compare_times((tree, here), environment, asked.rounds)
        finally:
            subprocess.run(["git", "-C", here, "worktree", "remove", "--force", tree], check=True)
    sys.exit(0 if agree else 1)


if __name__ == "__main__":
    main()
