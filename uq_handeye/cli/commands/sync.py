"""Command ``sync``: two streams with unsynchronised clocks, put on one clock."""

from pathlib import Path
from typing import TYPE_CHECKING

from ..delivery import deliver_answer
from ..messages import LOG, timed
from ..pose_files import StreamFiles
from ..values import one_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


INTERPOLATIONS = ("so4", "geodesic")


def sync_command(
    files: StreamFiles,
    max_offset: float | None = None,
    still: bool = False,
    max_gap: float | None = None,
    interpolation: str = INTERPOLATIONS[0],
    seed: int = 0,
    as_json: bool = False,
    output: Path | None = None,
) -> None:
    """Put two unsynchronised pose streams on one clock.

    Examples:
      uq-handeye sync robot.csv camera.csv -o paired/
      # A robot that stops for each picture: one mean pose per stop
      uq-handeye sync robot.csv camera.csv --still -o paired/
      # Synchronise and calibrate in one command
      uq-handeye calibrate robot.csv camera.csv --pair async -o result/

    Writes pose pairs at the same moments, and the offset between the clocks.
    The streams need timestamps in seconds; the offset is found from the motion.

    The written files hold no uncertainty of the offset. Use uq-handeye
    calibrate --pair async to include it in the uncertainty of X.

    Options (Synchronisation):
      * --max-offset SECONDS: Largest clock offset (s) to search; inf for unrelated clocks. Default: a quarter of the
        overlap of the streams.
      * --still: One mean pose pair per stop, if the robot stops for each picture.
      * --max-gap SECONDS: Longest gap (s) that is interpolated. Default: three times the median interval.
      --interpolation NAME <INTERPOLATIONS>: Interpolation of poses: so4 or geodesic.
      --seed N: Seed of random subsets.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for the paired poses and figures. It holds robot.csv and camera.csv
        (paired by row), sync.json, sync.png and sync.svg.
    """
    kind = one_of(interpolation, "--interpolation", INTERPOLATIONS)
    with timed("synchronising"):
        found = files.synchronised(max_offset=max_offset, still=still, max_gap=max_gap, interpolation=kind, seed=seed)
    from ...read import pose_text

    def written() -> "dict[str, str | Figure]":
        sides = {"robot.csv": found.poses.robot, "camera.csv": found.poses.camera}
        tables = {name: pose_text(poses, found.poses.timestamps) for name, poses in sides.items()}
        return {**tables, "sync.json": found.to_json(), "sync": found.figure()}

    deliver_answer(found.to_json(), found.summary(), as_json, output, written)
    if output is not None and found.offset_std > 0:
        LOG.info("The files hold no uncertainty of the offset. uq-handeye calibrate --pair async includes it.")
