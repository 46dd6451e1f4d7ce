"""The function `scene_rig`: several cameras that see one scene without a board.

The pictures of all cameras make one scene, in which each camera has a lens of its own. Their poses have one joint
covariance and one unknown scale. The scale for a start follows from the screws of the camera of most pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.files.open import StrPath, shown
from ..core.geometry.frames import SETUPS
from ..core.geometry.se3 import Array, inverse
from ..core.runtime.threads import one_thread
from ..errors import InputError, NotConvergedError, require_one_of
from ..findings import Finding, warn
from ..fit.input_checks.row_order import DISAGREEMENT, angle_disagreement
from ..fit.likelihood.screws import scale_by_screws
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
from .by_scene import robot_poses, silent, size_of

# Names of arm and target of the rig.
ARM, SCENE = "arm", "scene"


def scene_rig(
    pictures: Mapping[str, str | Iterable[StrPath]],
    robot: ArrayLike | StrPath,
    *,
    setup: str = "eye-in-hand",
    say: Callable[[str], None] | None = None,
) -> Rig:
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
        Takes the stage of the computation in words, and notes on what was found.

    Returns
    -------
    Rig
        For `calibrate`: the poses of all cameras with their joint covariance, and a scale that is one more unknown.

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
        main = _in_metres(main, G, camera, row, list(n))
        measured, covariance = measured_poses(main)
    findings = _findings(main, seen, camera, list(n), len(poses))
    if failures := [finding for finding in findings if finding.severity == "failure"]:
        raise InputError(str(failures[0]))
    warn(findings)
    for finding in findings:
        say(str(finding))
    views = []
    for k, name in enumerate(n):
        of = camera == k
        at = tuple(row[of].tolist())
        views.append(
            View(name, SCENE, measured[of], at, covariance.own[of], f"pictures of {name}", covariance.shared[of], True)
        )
    on, to = (ARM, WORLD) if setup == "eye-in-hand" else (WORLD, ARM)
    source = shown(Path(robot)) if isinstance(robot, str | Path) else ""
    return Rig({ARM: ArmPoses(poses, source=source)}, dict.fromkeys(n, on), {SCENE: to}, tuple(views))


def _placed(
    groups: Mapping[str, list[Path]], folder: Path, setup: str, say: Callable[[str], None]
) -> tuple[Placed, colmap.Matched]:
    """Return the scene of all pictures; raises `InputError` where the cameras make no common one."""
    paths = [path for of in groups.values() for path in of]
    counts = [len(of) for of in groups.values()]
    seen = colmap.match(paths, folder, None, None, say, counts=counts)
    camera = np.repeat(np.arange(len(counts)), counts)
    start = Lenses.of_cameras([Lens.of(size_of(of[0])) for of in groups.values()], camera)
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


def _in_metres(main: Placed, G: Array, camera: NDArray[np.intp], row: NDArray[np.intp], names: list[str]) -> Placed:
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


def _findings(
    main: Placed, seen: colmap.Matched, camera: NDArray[np.intp], names: list[str], given: int
) -> list[Finding]:
    """Return what is said of pictures and lenses."""
    lens, found = main.scene.lens, []
    ends = np.cumsum([one.f for one in lens.each])[:-1]
    for k, (name, one, sd) in enumerate(zip(names, lens.each, np.split(lens_sd(main), ends), strict=True)):
        found += lens_findings(one, sd)
        f, free = float(one.values[0]), dict(zip(one.names, sd.tolist(), strict=True))
        of = main.scene.tracks.per_picture[camera == k]
        values = {
            "pictures": len(of),
            "given": given,
            "points": main.scene.tracks.m,
            "per_picture": float(of.mean()),
            "pixel_noise": main.noise,
            "focal": f,
            "focal_sd": free.get(NAMES[0]),
            "scale_sd": None,
            "camera": name,
        }
        found.append(Finding("scene.found", "note", values))
    if left := [seen.names[k] for k in np.setdiff1d(np.arange(len(seen.names)), main.rows)]:
        values = {"names": left, "given": len(seen.names), "least": MIN_POINTS}
        found.append(Finding("scene.left_out", "caution", values))
    return found
