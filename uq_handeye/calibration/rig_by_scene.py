"""The function `scene_rig`: several cameras that see one scene without a board.

The pictures of all cameras make one scene, in which each camera has a lens of its own. Their poses have one joint
covariance and one unknown scale. The scale for a start is that of the camera whose screws agree best with the robot's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.files.open import StrPath, shown
from ..core.geometry.frames import SETUPS
from ..core.geometry.se3 import Array, inverse
from ..core.threads import one_thread
from ..errors import InputError, NotConvergedError, require_one_of
from ..findings import Finding, warn
from ..fit.diagnostics.row_order import DISAGREEMENT, angle_disagreement
from ..fit.graph.screws import scale_by_screws
from ..model.camera.picture_files import picture_paths
from ..model.rig.description import WORLD, ArmPoses, Rig, View
from ..scene import colmap
from ..scene.estimate import (
    MIN_PICTURES_OF_SCENE,
    MIN_POINTS,
    Placed,
    adjusted,
    centred,
    lens_findings,
    lens_sd,
    measured_poses,
    no_scene,
)
from ..scene.lens import NAMES, Lens, Lenses
from .by_scene import robot_poses, silent

# Names of arm and target of the rig.
ARM, SCENE = "arm", "scene"


class SceneRig(NamedTuple):
    """Rig of several cameras from pictures of one scene; `calibrate` takes its ``rig``."""

    rig: Rig
    intrinsics: dict[str, dict[str, float]]  # fx, fy, cx, cy, k1, k2, p1, p2 of the model brown, by camera
    sd: dict[str, dict[str, float]]  # their standard deviations
    image_sizes: dict[str, tuple[int, int]]
    findings: tuple[Finding, ...]


def scene_rig(
    pictures: Mapping[str, str | Iterable[StrPath]],
    robot: ArrayLike | StrPath,
    *,
    setup: str = "eye-in-hand",
    say: Callable[[str], None] | None = None,
) -> SceneRig:
    """Return the rig of several cameras from pictures of one scene that stands still, without a board.

    Parameters
    ----------
    pictures : mapping of names of cameras to str or paths
        Files, a folder or a pattern such as ``"left/*.png"``, in the order of their names; one per robot pose.
    robot : (n, 4, 4) or path
        ``base_T_gripper``.
    setup : "eye-in-hand" or "eye-to-hand"
        For eye-to-hand the gripper carries the scene: a rigid textured object.
    say : function or None
        Takes the stage of the computation in words.

    Returns
    -------
    SceneRig
        Its ``rig`` is for `calibrate`: the poses of all cameras with their joint covariance, and a scale that is one
        more unknown.

    Raises
    ------
    InputError
        pycolmap is missing; pictures that make no scene, that share no points, or that do not fit the robot poses.

    Warns
    -----
    InputWarning
        Pictures that are left out.
    """
    require_one_of("setup", setup, SETUPS)
    if len(pictures) < 2:
        raise InputError("Expected pictures of two cameras or more. Of one camera: scene_poses(pictures, robot).")
    say = silent if say is None else say
    groups = {name: picture_paths(of) for name, of in pictures.items()}
    for name, paths in groups.items():
        if len(paths) < MIN_PICTURES_OF_SCENE:
            raise InputError(
                f"A scene needs {MIN_PICTURES_OF_SCENE} pictures or more of each camera (15 to 20 are better), got "
                f"{len(paths)} of {name}. Take more, or use a board."
            )
    n = {name: len(paths) for name, paths in groups.items()}
    poses = robot_poses(robot, next(iter(n.values())), setup)
    if wrong := [name for name, count in n.items() if count != len(poses)]:
        raise InputError(
            f"Expected a picture of each camera at each of {len(poses)} robot poses, got {n[wrong[0]]} of {wrong[0]}."
        )
    G = poses if setup == "eye-in-hand" else inverse(poses)
    with TemporaryDirectory(prefix="uq-handeye-") as folder, one_thread():
        main, seen = _placed(groups, Path(folder), setup, say)
        camera = np.repeat(np.arange(len(n)), list(n.values()))[main.rows]
        row = main.rows % len(poses)
        main = in_metres(main, G, camera, row, list(n))
    lens = main.scene.lens
    parts = np.split(lens_sd(main), np.cumsum([one.f for one in lens.each])[:-1])
    sd = {
        name: dict(zip(one.names, of.tolist(), strict=True)) for name, one, of in zip(n, lens.each, parts, strict=True)
    }
    findings = _findings(main, seen, camera, sd, len(poses))
    if failures := [finding for finding in findings if finding.severity == "failure"]:
        raise InputError(str(failures[0]))
    warn(findings)
    rig = rig_of(main, poses, list(n), camera, setup, shown(Path(robot)) if isinstance(robot, str | Path) else "")
    values = {name: dict(zip(NAMES, one.values.tolist(), strict=False)) for name, one in zip(n, lens.each, strict=True)}
    sizes = {name: colmap.size_of(of[0]) for name, of in groups.items()}
    return SceneRig(rig, values, sd, sizes, tuple(findings))


def _placed(
    groups: Mapping[str, list[Path]], folder: Path, setup: str, say: Callable[[str], None]
) -> tuple[Placed, colmap.Matched]:
    """Return the scene of all pictures; raises `InputError` where the cameras make no common one."""
    paths = [path for of in groups.values() for path in of]
    counts = [len(of) for of in groups.values()]
    seen = colmap.match(paths, folder, None, None, say, counts=counts)
    camera = np.repeat(np.arange(len(counts)), counts)
    start = Lenses.of_cameras([Lens.of(colmap.size_of(of[0])) for of in groups.values()], camera)
    models = colmap.models(seen, start, say)
    say("adjusting the scene")
    for model in models:
        try:
            main = adjusted(model)
        except (InputError, NotConvergedError, np.linalg.LinAlgError):
            continue
        if main.n < MIN_PICTURES_OF_SCENE:
            break
        if lost := [name for k, name in enumerate(groups) if (camera[main.rows] == k).sum() < 3]:
            raise InputError(
                f"The pictures of {lost[0]} share no points with those of the other cameras. Let all cameras see one "
                "scene; or calibrate each camera alone."
            )
        return main, seen
    raise no_scene(seen, setup)


def in_metres(main: Placed, G: Array, camera: NDArray[np.intp], row: NDArray[np.intp], names: list[str]) -> Placed:
    """Return the scene in metres of the robot; raises `InputError` where a camera does not fit its poses."""
    found = []
    for k, name in enumerate(names):
        of = camera == k
        rows, poses = G[row[of]], main.scene.poses[of]
        off = angle_disagreement(rows, poses)
        if off > DISAGREEMENT:
            raise InputError(
                f"The angles between pictures of {name} and between robot poses differ by {np.degrees(off):.0f} deg in "
                "the median: pictures and rows do not belong together, or the setup is another."
            )
        if (scale := scale_by_screws(rows, poses)) is not None:
            found.append(scale)
    if not found:
        raise InputError(
            "The robot poses do not tell the scale of the scene. Rotate the cameras about two axes and move them, in "
            "6 poses or more."
        )
    factor = min(found, key=lambda one: one[1])[0]
    return centred(replace(main, scene=main.scene.scaled(factor)))


def rig_of(main: Placed, robot: Array, names: list[str], camera: NDArray[np.intp], setup: str, source: str = "") -> Rig:
    """Return the rig of a scene in metres; ``camera`` (n,) of its pictures, which are those of one camera after the
    other, each at the robot poses (N, 4, 4).
    """
    measured, covariance = measured_poses(main)
    row, views = main.rows % len(robot), []
    for k, name in enumerate(names):
        of = camera == k
        at, S = tuple(row[of].tolist()), covariance.own[of]
        views.append(View(name, SCENE, measured[of], at, S, f"pictures of {name}", covariance.shared[of], True))
    on, to = (ARM, WORLD) if setup == "eye-in-hand" else (WORLD, ARM)
    return Rig({ARM: ArmPoses(robot, source=source)}, dict.fromkeys(names, on), {SCENE: to}, tuple(views))


def _findings(
    main: Placed, seen: colmap.Matched, camera: NDArray[np.intp], sd: Mapping[str, Mapping[str, float]], given: int
) -> list[Finding]:
    """Return what is said of pictures and lenses; ``sd`` of the intrinsics of each camera."""
    found = []
    for k, (one, (name, spread)) in enumerate(zip(main.scene.lens.each, sd.items(), strict=True)):
        found += lens_findings(one, np.array(list(spread.values())))
        of = main.scene.tracks.per_picture[camera == k]
        values = {
            "pictures": len(of),
            "given": given,
            "points": main.scene.tracks.m,
            "per_picture": float(of.mean()),
            "pixel_noise": main.noise,
            "focal": float(one.values[0]),
            "focal_sd": spread.get(NAMES[0]),
            "scale_sd": None,
            "camera": name,
        }
        found.append(Finding("scene.found", "note", values))
    if left := [seen.names[k] for k in np.setdiff1d(np.arange(len(seen.names)), main.rows)]:
        found.append(
            Finding("scene.left_out", "caution", {"names": left, "given": len(seen.names), "least": MIN_POINTS})
        )
    return found
