"""The command ``uq-handeye sync``: two streams with clocks of their own, put on one clock."""

from pathlib import Path
from typing import Annotated

from ..delivery import deliver
from ..messages import LOG, timed
from ..options import JsonOption, emit, flag, folder_option, made_of, one_of, option
from ..pose_files import StreamFiles

INTERPOLATIONS = ("so4", "geodesic")


@made_of(files=StreamFiles)
def sync_command(
    files: "StreamFiles",
    max_offset: Annotated[
        float | None,
        option(
            "--max-offset",
            metavar="SECONDS",
            help="Look for the offset within +- so much. Left out: a quarter of what the streams have in common; inf "
            "for clocks that have nothing to do with each other.",
        ),
    ] = None,
    still: Annotated[
        bool, flag("--still", help="One averaged pose pair for each stop, for robots that stop for each picture.")
    ] = False,
    max_gap: Annotated[
        float | None,
        option(
            "--max-gap",
            metavar="SECONDS",
            help="Nothing is interpolated across longer gaps. Left out: three times the median interval.",
        ),
    ] = None,
    interpolation: Annotated[
        str, option("--interpolation", of=INTERPOLATIONS, metavar="NAME", help="so4 or geodesic.")
    ] = INTERPOLATIONS[0],
    seed: Annotated[int, option("--seed", help="Seed of random subsets.")] = 0,
    as_json: JsonOption = False,
    output: Annotated[
        Path | None,
        folder_option("Write robot.csv and camera.csv, paired by row, sync.json, sync.png and sync.svg here."),
    ] = None,
) -> None:
    """Poses at the same moments from two streams, and the offset of their clocks.

    Example: uq-handeye sync robot.csv camera.csv -o paired/

    The streams need timestamps in seconds and no common clock: the offset is
    found from the motion. uq-handeye calibrate --pair async does the same and
    goes on; there the uncertainty of the offset enters that of X, which it does
    not from the files written here.
    """
    kind = one_of(interpolation, "--interpolation", INTERPOLATIONS)
    with timed("synchronising"):
        found = files.synchronised(max_offset=max_offset, still=still, max_gap=max_gap, interpolation=kind, seed=seed)
    said = ""
    if output is not None:
        from ...io import pose_text

        written = {
            "robot.csv": pose_text(found.poses.robot, found.poses.timestamps),
            "camera.csv": pose_text(found.poses.camera, found.poses.timestamps),
            "sync.json": found.to_json(),
        }
        said = deliver(output, written, {"sync": found.figure()})
        if found.offset_std > 0:
            LOG.info("The files hold no uncertainty of the offset; uq-handeye calibrate --pair async takes it in.")
    emit(found.to_json() if as_json else found.summary() + said)
