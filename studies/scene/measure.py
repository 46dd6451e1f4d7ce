"""Measure X without a board: on simulated tracks by the adjustment alone, and on rendered pictures by `scene_poses`.

    python -m studies.scene.measure [--full] [--keep FOLDER] [--again] [ROW ...]

writes ``measured.json`` beside this file after each draw, and leaves out what is there already: a run that was stopped
goes on. Tracks are adjusted from near the truth, with f 1 % and the centre 3 px wrong; ``exact`` is X by the camera
poses with their joint covariance and declared robot noise, ``joint`` the same after the joint step with the robot,
``defaults`` X by `calibrate` as the command calls it. Pictures (1280 x 960) are rendered into a temporary folder. One
draw of each row, 3 of the tracks; 30 and, of pictures, 8 draws of the robot's noise with ``--full``. ``--keep`` renders
into a folder and takes the pictures that are there; ``--again`` measures rows again that are there. ``files/table``
is X by the camera poses of COLMAP alone, as files of an unknown scale, as they are and inverse.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import uq_handeye as uq
from studies.common.scores import errors
from studies.scene.sessions import (
    KINDS,
    ROBOT_SD_M,
    ROBOT_SD_RAD,
    Kind,
    Session,
    rendered,
    robot_csv,
    session,
    simulated_tracks,
    with_noise,
)
from uq_handeye.core.geometry.se3 import Array, difference, inverse, perturb
from uq_handeye.core.threads import one_thread
from uq_handeye.model.errors.joint_covariance import JointCovariance
from uq_handeye.model.poses.scene_facts import SceneFacts
from uq_handeye.scene.adjust import Scene, adjust, reduce
from uq_handeye.scene.estimate import pull_of_robot
from uq_handeye.scene.lens import Lens
from uq_handeye.scene.poses import as_poses, similarity
from uq_handeye.scene.tracks import Tracks

FILE = Path(__file__).with_name("measured.json")
SEED = 50
DRAWS, FULL_DRAWS, ROBOT_DRAWS = 3, 30, 8
# Unit of the scene of a start, in m.
UNIT_M = 0.085
# Standard deviation of the scale where the robot's noise is declared.
OPEN_SCALE_SD = 0.01
START_RAD, START_M, START_POINT_M = 5e-3, 4e-3, 3e-3


@dataclass(frozen=True)
class Row:
    """A row of simulated tracks: the session, its tracks, and the robot's noise (rad, m)."""

    words: str
    kind: Kind
    tracks: Mapping[str, float] = field(default_factory=dict)
    robot: tuple[float, float] = (ROBOT_SD_RAD, ROBOT_SD_M)


TRACKS = {
    "table": Row("table with boxes", KINDS["table"]),
    "flat": Row("flat table only", KINDS["flat"]),
    "few_features": Row("51 features a picture", KINDS["table"], {"per_picture": 51}),
    "many_features": Row("577 features a picture", KINDS["table"], {"per_picture": 577}),
    "eight": Row("8 pictures", KINDS["eight"]),
    "narrow": Row("narrow lens, f 2600", KINDS["narrow"]),
    "wide": Row("wide lens, f 620", KINDS["wide"]),
    "bad_robot": Row("robot 0.1 deg, 0.5 mm", KINDS["table"], {}, (float(np.radians(0.1)), 5e-4)),
    "small_motions": Row("tilts and rolls a third as large", KINDS["small_motions"]),
    "two_axes": Row("two axes (tilts)", KINDS["two_axes"]),
    "noise": Row("0.6 px of noise", KINDS["table"], {"core": 0.6, "tails": 0.0}),
    "wrong_matches": Row("5 % wrong matches", KINDS["table"], {"wrong": 0.05}),
    "shift": Row("0.1 px shift of each picture", KINDS["table"], {"shift": 0.1}),
    "optical": Row("optical axes all parallel", KINDS["optical"]),
    "one_axis": Row("one horizontal axis", KINDS["one_axis"]),
}
PICTURES = (
    "table", "flat", "wide", "narrow", "noisy", "eight", "twelve", "weak", "tiles", "blur", "moved", "wrong",
    "shuffled", "gripper", "dull", "halves", "in_hand", "optical", "one_axis", "sixty",
)  # fmt: skip
EXACT, JOINT, DEFAULTS = "exact", "joint", "defaults"


# ------------------------------------------------------------------------------------------- tracks


def start_of(made: Session, rng: np.random.Generator, **of_tracks: Any) -> tuple[Scene, Scene]:
    """Return the scene of simulated tracks at the truth (m), and a start near it in another unit."""
    seen = simulated_tracks(made, rng, **of_tracks)
    names = tuple(f"img{k:02d}.png" for k in range(made.kind.n))
    tracks = Tracks(seen.picture, seen.point, seen.pixels, names, made.camera.size)
    lens = Lens.of(made.camera.size)
    truth = Scene(tracks, made.camera_T_scene, seen.points, lens.at(made.camera.parameters))
    wrong = made.camera.parameters * np.array([1.01, 1.01, *[1.0] * 10]) + np.array([0, 0, 3, -3, *[0.0] * 8])
    near = perturb(truth.poses, np.repeat([START_RAD, START_M], 3) * rng.normal(size=(made.kind.n, 6)))
    points = seen.points + START_POINT_M * rng.normal(size=seen.points.shape)
    return truth, Scene(tracks, near, points, lens.at(wrong)).scaled(1.0 / UNIT_M)


def consistency(truth: Scene, s: float, found: Scene) -> float:
    """Return ``v^T S v`` of all poses and the lens against the truth, over its freedom (1 where S is right)."""
    lengths = [float(np.linalg.norm(np.diff(inverse(T)[:, :3, 3], axis=0))) for T in (found.poses, truth.poses)]
    unit = lengths[0] / lengths[1]
    at = reduce(found, s)
    v = difference(truth.scaled(unit).moved(_between(truth.scaled(unit), found)).poses, found.poses).ravel()
    v = np.concatenate([v, (truth.lens.values - found.lens.values)[found.lens.free]])
    # The similarity is the one that fits best.
    Q = np.pad(similarity(found.poses), ((0, len(v) - 6 * at.n), (0, 0)))
    v -= Q @ np.linalg.lstsq(Q.T @ at.S @ Q, Q.T @ at.S @ v, rcond=None)[0]
    return float(v @ at.S @ v) / (len(v) - 7)


def _between(truth: Scene, found: Scene) -> Array:
    """The frame of ``found`` in which the first camera of ``truth`` is the first camera of ``found``."""
    return np.asarray(inverse(found.poses)[0] @ truth.poses[0])


def of_tracks(row: Row, seed: int) -> dict[str, Any]:
    """Return the errors of X of one draw."""
    made = session(row.kind, seed, bodies=False)
    rng = np.random.default_rng([SEED, seed])
    robot = with_noise(made.base_T_gripper, rng, *row.robot)
    truth, start = start_of(made, rng, **row.tracks)
    found, s = adjust(start)
    line: dict[str, Any] = {"seed": seed, "per_picture": float(np.mean(truth.tracks.per_picture)), "noise_px": s}
    line["consistency"] = consistency(truth, s, found)
    covariance = np.diag(np.repeat(np.square(row.robot), 3))
    result = calibrated(robot, found, s)
    line[DEFAULTS] = scored(result, made.X)
    if result.camera_scale is None or result.W is None:
        return line
    found = found.scaled(result.camera_scale.factor)
    result = calibrated(robot, found, s, covariance)
    line[EXACT] = scored(result, made.X)
    each = JointCovariance.of_each(np.tile(covariance, (len(robot), 1, 1)))
    pull = pull_of_robot(robot, result.X, each, np.ones(len(robot)), eye_to_hand=False)
    # The start in the frame of the base: both have the first camera at one place.
    to_base = inverse(pull.poses)[0] @ found.poses[0]
    line[JOINT] = scored(calibrated(robot, *adjust(found.moved(to_base), pull), covariance), made.X)
    return line


def calibrated(robot: Array, scene: Scene, s: float, covariance: Array | None = None) -> uq.Calibration:
    """Return X by the camera poses of a scene: as the command has it, or in metres with a declared robot noise."""
    T = np.eye(4)
    T[:3, 3] = -np.median(scene.points, axis=0)
    scene = scene.moved(T)
    poses, J = as_poses(reduce(scene, s), scene.poses)
    data = uq.PosePairs(robot, poses, camera_covariance=J)
    facts = SceneFacts(scene.tracks.n, scene.tracks.m, float(np.mean(scene.tracks.per_picture)), s, 0.0, 0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        if covariance is None:
            return uq.calibrate(replace(data, scene=facts))
        scale = uq.SharedError.target_scale(OPEN_SCALE_SD)
        return uq.calibrate(data, noise=uq.PoseNoise(covariance, J), shared=[scale])


def scored(result: uq.Calibration, X: Array) -> dict[str, Any]:
    """Return error, stated deviation and squared distance of X, and the directions that are open."""
    e, S = errors(result.X, X), np.asarray(result.covariance)
    e_deg, e_mm = float(np.degrees(np.linalg.norm(e[:3]))), 1e3 * float(np.linalg.norm(e[3:]))
    with np.errstate(all="ignore"):
        d2 = float(e @ np.linalg.pinv(S, hermitian=True) @ e)
    stated = 1e3 * float(np.sqrt(np.trace(S[3:, 3:])))
    return {
        "mm": e_mm, "deg": e_deg, "stated_mm": stated if np.isfinite(stated) else -1.0, "d2": d2,
        "usable": bool(result.usable), "cautions": [one.code for one in result.findings if one.severity != "note"],
    }  # fmt: skip


# ------------------------------------------------------------------------------------------- pictures


@contextmanager
def pictures_of(made: Session, name: str, keep: Path | None) -> Iterator[list[Path]]:
    """Render the pictures of a row, unless they are in the folder ``keep``."""
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) if keep is None else keep / name
        found = sorted((folder / "img").glob("*.png"))
        yield found if len(found) == made.kind.n else rendered(made, folder)


def of_files(name: str, keep: Path | None) -> list[dict[str, Any]]:
    """Return the errors of X by camera poses of COLMAP, taken as poses of an unknown scale."""
    made, lines = session(name), []
    with pictures_of(made, name, keep) as paths, TemporaryDirectory() as folder:
        poses = uq.scene_poses(paths).poses
        robot = Path(folder) / "robot.csv"
        robot.write_text(robot_csv(made.robot), encoding="utf-8")
        for inverted in (False, True):
            camera = Path(folder) / "camera.csv"
            camera.write_text(robot_csv(inverse(poses) if inverted else poses), encoding="utf-8")
            line: dict[str, Any] = {"inverted": inverted}
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", uq.InputWarning)
                try:
                    result = uq.calibrate(uq.read_poses(robot, camera), camera_scale="unknown")
                except (uq.InputError, uq.DegenerateMotionError, uq.NotConvergedError) as error:
                    lines.append(line | {"refused": str(error)})
                    continue
            scale = result.camera_scale
            line |= scored(result, made.X) | {
                "failures": [str(one) for one in result.findings if one.severity == "failure"]
            }
            lines.append(line | {"scale": None if scale is None else [scale.factor, scale.std]})
    return lines


def memory_mb() -> float:
    """Return the largest memory of this process so far."""
    # the largest of this program: what `resource` tells counts the process that started it
    return int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 1024


def of_pictures(name: str, full: bool, keep: Path | None) -> list[dict[str, Any]]:
    """Return the errors of X from the rendered pictures of a row, or the words that refuse them."""
    made = session(name)
    with pictures_of(made, name, keep) as paths:
        started = time.process_time()
        lines: list[dict[str, Any]] = []
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", uq.InputWarning)
                found = uq.scene_poses(paths, made.robot, setup=made.setup)
        except (uq.InputError, uq.DegenerateMotionError, uq.NotConvergedError) as error:
            text = str(error)
            return [
                {"draw": 0, "refused": text, "in_order": in_order(text, made), "cpu": time.process_time() - started}
            ]
        seconds = time.process_time() - started
        for draw in range(ROBOT_DRAWS if full else 1):
            pairs = found.pairs
            if draw:
                again = made.robot.copy()
                kept = np.arange(made.kind.n) != made.kind.wrong  # a wrong pose stays
                again[kept] = with_noise(made.base_T_gripper, np.random.default_rng([SEED, 7, draw]))[kept]
                pairs = replace(pairs, robot=again[found.rows])
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", uq.InputWarning)
                result = uq.calibrate(pairs)
            line = {"draw": draw, "pictures": found.n, "of": made.kind.n, "points": len(found.points), "cpu": seconds}
            line["mb"] = memory_mb()
            line |= scored(result, made.X)
            rows = [int(found.rows[k]) for k in np.flatnonzero(result.table.weight < 0.5)] if result.table else []
            lines.append(line | {"rejected": rows, "findings": [one.code for one in found.findings]})
    return lines


def in_order(text: str, made: Session) -> int:
    """Count the pictures that a refusal assigns to their rows."""
    return sum(f"img{k:02d}.png belongs to row {row}" in text for k, row in enumerate(made.row_of))


# ------------------------------------------------------------------------------------------- the command


def stored() -> dict[str, Any]:
    """Return what was measured so far."""
    if FILE.exists():
        found: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
        return found
    return {"pycolmap": "", "tracks": {}, "pictures": {}, "files": {}}


def keep(group: str, name: str, lines: list[dict[str, Any]]) -> None:
    """Add lines to a row and write the file."""
    found = stored()
    found["pycolmap"] = metadata.version("pycolmap")
    found.setdefault(group, {}).setdefault(name, []).extend(lines)
    FILE.write_text(json.dumps(found, indent=0, default=float) + "\n", encoding="utf-8")


def drop(group: str, name: str) -> None:
    """Leave out a row that was measured."""
    found = stored()
    found.get(group, {}).pop(name, None)
    FILE.write_text(json.dumps(found, indent=0, default=float) + "\n", encoding="utf-8")


def main() -> None:
    """Measure the rows that are named, all of them otherwise."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--keep", type=Path, metavar="FOLDER")
    parser.add_argument("--again", action="store_true")
    parser.add_argument("rows", nargs="*", metavar="ROW", help="tracks/NAME, pictures/NAME or files/NAME")
    options = parser.parse_args()
    every = [*(f"tracks/{name}" for name in TRACKS), *(f"pictures/{name}" for name in PICTURES), "files/table"]
    for row in options.rows or every:
        group, _, name = row.partition("/")
        if options.again:
            drop(group, name)
        done = stored().get(group, {}).get(name, [])
        if group == "tracks":
            for seed in range(len(done), FULL_DRAWS if options.full else DRAWS):
                with one_thread():
                    line = of_tracks(TRACKS[name], seed)
                keep(group, name, [line])
                print(row, json.dumps(line, default=float), flush=True)
        elif not done:
            lines = of_files(name, options.keep) if group == "files" else of_pictures(name, options.full, options.keep)
            keep(group, name, lines)
            print(row, json.dumps(lines[0], default=float), flush=True)


if __name__ == "__main__":
    main()
