"""Command ``simulate``: pose files of a simulated rig with known truth."""

from dataclasses import dataclass
from pathlib import Path

from ...errors import InputError
from ..names import SETUP_NAMES
from ..noise import NoiseOptions, exact_other_side, require_of_poses, without_poses
from ..printing import emit

MAX_SIMULATED_POSES = 1_000_000  # about 1 GB of memory


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
    noise = (
        require_of_poses(without_poses(given, "simulate"), "simulate") if known is None else exact_other_side(known)
    )  # no further noise is drawn
    if options.noise is not None and read_shared_errors(options.noise):
        raise InputError(f"simulate draws independent noise for each pose. Remove [shared] from {options.noise}.")
    if seed < 0:
        raise InputError(f"Expected --seed to be 0 or more, got {seed}.")
    if not 1 <= n_poses <= MAX_SIMULATED_POSES:
        raise InputError(f"Expected --poses to be from 1 to {MAX_SIMULATED_POSES}, got {n_poses}.")
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
