"""The command in this process and in one of its own, for the tests of the command line."""

import io
import os
import subprocess
import sys
from contextlib import chdir, nullcontext, redirect_stderr, redirect_stdout
from types import SimpleNamespace

import pytest

import uq_handeye as uq
from uq_handeye.cli import app as cli
from uq_handeye.read import write_pose_file

NOISE = ("--robot-noise", "0.02deg,0.05mm", "--camera-noise", "0.1deg,0.5mm")
MODEL = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))  # of `NOISE`
PROGRAM = [sys.executable, "-m", "uq_handeye"]


def write_session(folder, n=12):
    """robot.csv and camera.csv of a simulated rig with `NOISE`; gives the poses."""
    poses = uq.simulate(n, noise=MODEL, seed=3)
    write_pose_file(folder / "robot.csv", poses.robot)
    write_pose_file(folder / "camera.csv", poses.camera)
    return poses


def run(*arguments, cwd=None):
    """The command in this process: returncode, stdout, stderr."""
    out, err = io.StringIO(), io.StringIO()
    status = None
    with nullcontext() if cwd is None else chdir(cwd), redirect_stdout(out), redirect_stderr(err):
        try:
            cli.main([str(argument) for argument in arguments])
        except SystemExit as end:
            status = end.code
    return SimpleNamespace(returncode=status, stdout=out.getvalue(), stderr=err.getvalue())


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


def run_as_on_terminal(*arguments, cwd=None, **environment):
    """`run_on_terminal` in this process: what depends on the streams and the environment alone."""
    seen = Terminal()
    status = None
    streams = redirect_stdout(seen), redirect_stderr(seen)
    with pytest.MonkeyPatch.context() as patch, chdir(cwd or os.curdir), streams[0], streams[1]:
        for name in ("NO_COLOR", "FORCE_COLOR", "GITHUB_ACTIONS", "COLUMNS"):
            patch.delenv(name, raising=False)
        for name, value in {"TERM": "xterm-256color", **environment}.items():
            patch.setenv(name, value)
        try:
            cli.main([str(argument) for argument in arguments])
        except SystemExit as end:
            status = end.code
    return status, seen.getvalue()


def run_process(*arguments, cwd=None, **environment):
    """The command in a process of its own, in pipes."""
    command = [*PROGRAM, *map(str, arguments)]
    plain = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR", "GITHUB_ACTIONS", "COLUMNS")}
    return subprocess.run(
        command, cwd=cwd, env={**plain, **environment}, capture_output=True, text=True, timeout=120, check=False
    )


def run_on_terminal(*arguments, cwd=None, columns=80, **environment):
    """The command on a pseudo terminal of xterm's kind: exit status and all that a person would see."""
    import fcntl
    import pty
    import struct
    import termios

    leader, follower = pty.openpty()
    fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    plain = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR", "GITHUB_ACTIONS", "COLUMNS")}
    process = subprocess.Popen(
        [*PROGRAM, *map(str, arguments)],
        cwd=cwd,
        env={**plain, "TERM": "xterm-256color", **environment},
        stdin=follower,
        stdout=follower,
        stderr=follower,
        start_new_session=True,
    )
    os.close(follower)
    seen = b""
    try:
        while True:
            try:
                part = os.read(leader, 65536)
            except OSError:  # the end of a pseudo terminal
                break
            if not part:
                break
            seen += part
        process.wait(timeout=60)
    finally:
        process.kill()
        process.wait()
        os.close(leader)
    return process.returncode, seen.decode()
