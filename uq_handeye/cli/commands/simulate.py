"""Commands ``simulate``, pose files of a simulated rig, and ``codegen``, the closed forms as code."""

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import InputError
from ..messages import LOG
from ..noise import NoiseOptions, exact_beside, require_of_poses
from ..options import SETUP_NAMES, emit, one_of

MAX_POSES = 1_000_000  # about 1 GB of memory


@dataclass(frozen=True)
class SimulatedNoise(NoiseOptions):
    """Options of the noise that is simulated.

    Options (Noise):
      * --robot-noise ROT,TRANS: Robot noise (1 sigma). Standard deviations of one pose per axis, e.g. 0.02deg,0.05mm.
        Default: none.
      * --camera-noise ROT,TRANS: Camera noise (1 sigma). Standard deviations of one pose per axis, e.g. 0.1deg,0.5mm.
        Default: none.
    """

    robot_noise: str | None = None
    camera_noise: str | None = None


def simulate_command(
    options: SimulatedNoise,
    output: Path,
    n_poses: int = 20,
    setup: str = SETUP_NAMES[0],
    distance: str = "0.4m,0.8m",
    tilt: str = "35deg",
    roll: str = "60deg",
    seed: int = 0,
) -> None:
    r"""Simulate a rig and write its pose files.

    Examples:
      uq-handeye simulate -o sim/ --poses 30 --robot-noise 0.02deg,0.05mm \
          --camera-noise 0.1deg,0.5mm
      # Camera fixed in the cell, no noise
      uq-handeye simulate -o sim/ --setup eye-to-hand

    Writes robot.csv, camera.csv and the true X, truth.csv.

    Options (Output):
      * -o, --output DIR: Folder to write.

    Options (Rig):
      * n_poses = --poses, -n N: Number of poses.
      * --setup NAME <SETUP_NAMES>: Camera mount: eye-in-hand or eye-to-hand.
      * --distance NEAR,FAR: Distances of camera and target.
      * --tilt ANGLE: Largest angle of line of sight to target normal.
      * --roll ANGLE: Largest roll about the line of sight.
      * --seed N: Seed of the random numbers.
    """
    from ...core.geometry.frames import SETUPS
    from ...read import pose_text, read_shared_errors, write_files
    from ...trials.simulation.rig import simulate

    given, known = options.read()
    noise = require_of_poses(given, "simulate") if known is None else exact_beside(known)  # nothing is drawn beside
    if options.noise is not None and read_shared_errors(options.noise):
        raise InputError(f"simulate draws independent noise for each pose. Remove [shared] from {options.noise}.")
    if seed < 0:
        raise InputError(f"Expected --seed to be 0 or more, got {seed}.")
    if not 1 <= n_poses <= MAX_POSES:
        raise InputError(f"Expected --poses to be from 1 to {MAX_POSES}, got {n_poses}.")
    near, _, far = distance.partition(",")
    poses = simulate(n_poses, noise=noise, setup=setup, distance=(near, far or near), tilt=tilt, roll=roll, seed=seed)
    if poses.truth is None or poses.timestamps is None:
        raise RuntimeError("simulate() gave poses without truth or times")
    files = {
        "robot.csv": pose_text(poses.robot, poses.timestamps),
        "camera.csv": pose_text(poses.camera, poses.timestamps),
        "truth.csv": pose_text(poses.truth.X[None]),
    }
    write_files(output, files)
    emit(f"Wrote robot.csv, camera.csv and truth.csv ({SETUPS[setup]}) to {output}\n")


# Names of symbolic.codegen.COMMENTS, repeated here so that help and completion load quickly.
LANGUAGE_NAMES = ("c", "cpp", "octave", "julia", "rust", "fortran", "javascript", "python", "latex")


def codegen_command(
    names: list[str] | None = None,
    language: str | None = None,
    matrix: list[str] | None = None,
    every: bool = False,
    list_names: bool = False,
    output: Path | None = None,
) -> None:
    """Generate the closed forms as code in other languages.

    Examples:
      # Names of all matrices and functions
      uq-handeye codegen --list
      uq-handeye codegen --language c --matrix solve_4dpa -o generated/

    The matrices of the paper and their derivatives are available in every
    language, the functions solve_4dpa and covariance_4dpa in c, cpp, octave and
    python.

    Arguments:
      names = NAME: Names of matrices and functions, as for --matrix.

    Options:
      * --language NAME <LANGUAGE_NAMES>: Language: {LANGUAGE_NAMES}.
      * --matrix NAME: Matrix or function of --list. Repeatable.
      * every = --all: All matrices and functions of the language.
      * list_names = --list: List the available functions and exit.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for the code. Default: standard output.
    """
    from ..._version import __version__
    from ...read import write_files

    if list_names:
        emit(_generator().listing())
        return
    if language is None:
        raise InputError(f"Expected --language, one of {', '.join(LANGUAGE_NAMES)}.")
    language = one_of(language, "--language", LANGUAGE_NAMES)
    given = [part.strip() for text in [*(matrix or []), *(names or [])] for part in text.split(",") if part.strip()]
    if every == bool(given):
        raise InputError("Expected either --matrix NAME or --all; see codegen --list for the names.")

    codegen = _generator()
    lacking = [] if language in codegen.WRITTEN_IN else list(codegen.FUNCTIONS)
    if every:
        given = [name for name in codegen.NAMES if name not in lacking]
        if lacking:
            LOG.info("%s are not written in %s, but in %s.", _listed(lacking), language, _listed(codegen.WRITTEN_IN))
    for name in given:
        if name not in codegen.NAMES:
            raise InputError(
                f"Expected --matrix to be a name of codegen --list, got {name!r}.{_near(name, codegen.NAMES)}"
            )
        if name in lacking:
            raise InputError(
                f"{name} is not written in {language}, but in {_listed(codegen.WRITTEN_IN)}; "
                f"{language} has the matrices."
            )
    texts = codegen.files(language, given, __version__)
    if output is None:
        emit(codegen.one_text(language, texts))
    else:
        write_files(output, texts)
        what = ", ".join(texts) if len(texts) <= 6 else f"{len(texts)} files"
        emit(f"Wrote {what} to {output}\n")


def _generator() -> Any:
    """Import the generator, which with SymPy takes half a second."""
    from ...symbolic import codegen

    return codegen


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _near(name: str, names: Sequence[str]) -> str:
    """Return up to three similar names, in any case."""
    small = {known.lower(): known for known in sorted(names)}
    same = [known for known in names if known.lower() == name.lower()]
    near = same or [small[found] for found in difflib.get_close_matches(name.lower(), small, n=3, cutoff=0.5)]
    return f" Did you mean {' or '.join(near)}?" if near else ""
