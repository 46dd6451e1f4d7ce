"""Functions, files and packages that a command runs through: what a reader must hold to follow it.

    python -m studies.performance.traced

30 simulated poses are calibrated on the command line, once as two files and once as a rig of two cameras, and checked
by eight others. Counted are the functions of the package that were called at least once, but for those that imports
call; their files; and the packages that these are in. Prints a Markdown table.
"""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np

import uq_handeye as uq
from uq_handeye.cli.app import main as run
from uq_handeye.core.geometry.se3 import inverse

ROOT = Path(uq.__file__).parent
N_POSES, N_NEW = 30, 8
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
# A function has local variables in slots; bodies of modules and classes have not (`inspect.CO_OPTIMIZED`).
OPTIMIZED = 1


def traced(arguments: list[str]) -> tuple[int, int, int]:
    """Return the numbers of functions, files and packages that a command runs through."""
    codes: set[CodeType] = set()
    importing = 0

    def seen(frame: FrameType, event: str, _: Any) -> None:
        nonlocal importing
        code = frame.f_code
        if code.co_name == "<module>":
            importing += {"call": 1, "return": -1}.get(event, 0)
        elif event == "call" and not importing and code.co_flags & OPTIMIZED and not code.co_name.startswith("<"):
            codes.add(code)

    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        sys.setprofile(seen)
        try:
            run(arguments)
        except SystemExit as ended:
            if ended.code:
                raise
        finally:
            sys.setprofile(None)
    own = {code for code in codes if Path(code.co_filename).is_relative_to(ROOT)}
    files = {Path(code.co_filename) for code in own}
    return len(own), len(files), len({file.parent for file in files})


def main() -> None:
    """Print the counts of the command that is given, or the table of all."""
    if sys.argv[1:]:
        print(*traced(sys.argv[1:]))
        return
    drawn = uq.simulate(n_poses=N_POSES + N_NEW, noise=NOISE, seed=1)
    beside = np.eye(4)
    beside[0, 3] = 0.1  # m
    second = uq.simulate(n_poses=N_POSES + N_NEW, noise=NOISE, seed=2)
    assert drawn.truth is not None and second.truth is not None  # simulated poses carry it
    error = inverse(second.truth.camera) @ second.camera
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for start, part in (("", slice(0, N_POSES)), ("new_", slice(N_POSES, None))):
            uq.write_pose_file(folder / f"{start}robot.csv", drawn.robot[part])
            uq.write_pose_file(folder / f"{start}camera.csv", drawn.camera[part])
            uq.write_pose_file(folder / f"{start}right.csv", (inverse(beside) @ drawn.truth.camera @ error)[part])
        two = ["--camera", "left=camera.csv", "--camera", "right=right.csv"]
        new_two = ["--camera", "left=new_camera.csv", "--camera", "right=new_right.csv"]
        for arguments in (["robot.csv", "camera.csv", "-o", "one"], ["robot.csv", *two, "-o", "two"]):
            _counts(["calibrate", *arguments], folder)
        print("| command | functions | files | packages |\n| --- | --- | --- | --- |")
        for arguments in (
            ["calibrate", "robot.csv", "camera.csv"],
            ["calibrate", "robot.csv", *two],
            ["check", "one/result.json", "new_robot.csv", "new_camera.csv"],
            ["check", "two/result.json", "new_robot.csv", *new_two],
        ):
            print(f"| `{' '.join(arguments)}` | {' | '.join(_counts(arguments, folder))} |", flush=True)


def _counts(arguments: list[str], folder: Path) -> list[str]:
    """Return the counts of a command in a process of its own, in a folder."""
    paths = os.pathsep.join(map(str, (ROOT.parent, os.environ.get("PYTHONPATH", ""))))
    command = [sys.executable, "-m", "studies.performance.traced", *arguments]
    done = subprocess.run(
        command, cwd=folder, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


if __name__ == "__main__":
    main()
