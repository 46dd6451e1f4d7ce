"""The function `scene_poses`: camera poses from pictures of a scene, with the robot in it.

A scene is a target that stands still, whose size is not known and whose points are found from the same pictures. After
a first X the robot places all pictures: their points are triangulated again and adjusted with what the robot says, so
that pictures that were left out and parts that share no match come in, and wrong matches are judged by a geometry that
the robot holds.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core.files.open import StrPath, as_path, opened, shown
from ..core.geometry.frames import SETUPS
from ..core.geometry.se3 import Array, inverse
from ..core.limits import MAX_TABLE_BYTES
from ..core.threads import one_thread
from ..errors import InputError, InputWarning, NotConvergedError, require_one_of
from ..findings import Finding
from ..fit.diagnostics.row_order import DISAGREEMENT, angle_disagreement, find_order
from ..fit.graph.screws import scale_by_screws
from ..model.camera.picture_files import picture_paths
from ..model.errors.joint_covariance import JointCovariance, joint_of
from ..model.errors.models import PoseNoise, marginals
from ..model.poses.pose_pairs import PosePairs, frozen_poses
from ..model.poses.scene_facts import SceneFacts
from ..model.rig.description import require_left_out
from ..scene import colmap
from ..scene.adjust import Pull
from ..scene.colmap import Matched, Model, size_of
from ..scene.estimate import (
    MANY_STATIONARY,
    MIN_PICTURES_OF_SCENE,
    MIN_POINTS,
    Placed,
    adjusted,
    centred,
    lens_findings,
    lens_sd,
    measured_poses,
    no_scene,
    pull_of_robot,
)
from ..scene.known import known_scene, packed, place_pictures, unpacked
from ..scene.lens import NAMES, Lens
from ..scene.moved import moved_object
from ..scene.result import ScenePoses
from ..scene.views import scene_views
from .calibrate import calibrate

if TYPE_CHECKING:
    from .result import Calibration

# Times that the robot places all pictures, with the largest residual of an observation (px) of each.
ERRORS_OF_ROUNDS_PX = (6.0, 4.0)
Known = Mapping[str, float | tuple[float, float]]


def scene_poses(
    pictures: str | Iterable[StrPath],
    robot: ArrayLike | StrPath | None = None,
    *,
    setup: str = "eye-in-hand",
    intrinsics: Known | StrPath | None = None,
    mask: StrPath | None = None,
    result: Calibration | None = None,
    say: Callable[[str], None] | None = None,
) -> ScenePoses:
    """Estimate camera poses from pictures of a scene that stands still, without a board.

    Parameters
    ----------
    pictures : str or paths
        Files, a folder or a pattern such as ``"img/*.png"``, in the order of their names; six or more.
    robot : (n, 4, 4), path or None
        ``base_T_gripper`` of each picture. It tells the scale, places pictures that share too few matches, and judges
        matches. None: the poses have a unit of their own, and the largest part of the pictures is used.
    setup : "eye-in-hand" or "eye-to-hand"
        For eye-to-hand the gripper carries the scene: a rigid textured object.
    intrinsics : mapping, path or None
        Known intrinsics of the model brown, each a number (exact) or with its standard deviation; or their file. None:
        all are estimated.
    mask : path or None
        Picture that is black where pictures show what is not the scene.
    result : Calibration or None
        Result by pictures of this scene, in whose frame and unit the poses then are, with its intrinsics: for `check`.
        One picture is enough.
    say : function or None
        Takes the stage of the computation in words.

    Returns
    -------
    ScenePoses
        Its ``pairs`` are the data of `calibrate`.

    Raises
    ------
    InputError
        pycolmap is missing; pictures that make no scene, or that fit the robot poses in another order or not at all.
    """
    require_one_of("setup", setup, SETUPS)
    paths = picture_paths(pictures)
    if result is not None:
        require_left_out("of a result", intrinsics=intrinsics, mask=mask)
        return _later(paths, robot, result, say or silent)
    if len(paths) < MIN_PICTURES_OF_SCENE:
        raise InputError(
            f"A scene needs {MIN_PICTURES_OF_SCENE} pictures or more (15 to 20 are better), got {len(paths)}. Take "
            "more, or use a board."
        )
    poses = None if robot is None else robot_poses(robot, len(paths), setup)
    known = None if intrinsics is None else _known(intrinsics, paths)
    if mask is not None:
        _require_mask(as_path(mask), size_of(paths[0]))
    with TemporaryDirectory(prefix="uq-handeye-") as folder, one_thread():
        return _Run(paths, poses, setup, known, say or silent).run(
            Path(folder), None if mask is None else as_path(mask)
        )


def silent(text: str) -> None:
    """Say nothing."""


def _later(
    paths: list[Path], robot: ArrayLike | StrPath | None, result: Calibration, say: Callable[[str], None]
) -> ScenePoses:
    """Return camera poses of later pictures in the scene of a result."""
    facts: SceneFacts | None = getattr(result.data, "scene", None)
    if facts is None or not facts.known or result.setup is None:
        raise InputError(
            "The result holds no scene in which pictures could be placed: it is not by --scene, or from a folder of "
            "uq-handeye scene. Calibrate with --images PATTERN --scene."
        )
    if result.setup == "eye-to-hand":  # false alarms in 2 of 2 rendered sessions: an object is small in the picture
        raise InputError(
            "Later pictures of an object in the hand are not placed precisely enough for a check. Calibrate them with "
            "--scene, and compare both results: uq-handeye diff OLD NEW."
        )
    poses = None if robot is None else robot_poses(robot, len(paths), result.setup)
    known = unpacked(facts.known)
    with TemporaryDirectory(prefix="uq-handeye-") as folder, one_thread():
        found = place_pictures(known, paths, Path(folder), say)
    if not len(found.rows):
        raise InputError(
            f"None of {len(paths)} pictures shows the scene of the result (fewer than {MIN_POINTS} of its "
            f"{facts.points:,} points): it was rearranged, or is another one. Calibrate again by pictures of it."
        )
    findings = []
    if left := [found.names[k] for k in np.setdiff1d(np.arange(len(paths)), found.rows)]:
        values = {"names": left, "given": len(paths), "least": MIN_POINTS}
        findings.append(Finding("scene.left_out", "caution", values))
    t = known.scene.tracks
    return ScenePoses(
        found.poses,
        found.rows,
        found.covariance,
        dict(zip(NAMES, facts.lens, strict=True)),
        {name: sd for name, sd in zip(NAMES, facts.lens_sd, strict=True) if sd > 0},
        known.scene.points,
        tuple(findings),
        facts,
        t.image_size,
        tuple(shown(Path(name)) for name in found.names),
        found.shown,
        np.zeros((t.m, 3), np.uint8),
        poses,
        result.setup,
    )


def robot_poses(robot: ArrayLike | StrPath, n: int, setup: str) -> Array:
    """Return the robot poses (n, 4, 4) of n pictures."""
    if isinstance(robot, str | PathLike):
        from ..read.poses import read_robot

        poses = read_robot(robot, setup=setup)
    else:
        poses = frozen_poses(robot, "robot")
    if poses.ndim != 3 or len(poses) != n:
        raise InputError(
            f"Expected a robot pose for each of {n} pictures, got {len(poses)}. Remove pictures without a pose "
            "and poses without a picture."
        )
    return np.asarray(poses)


def _require_mask(mask: Path, size: tuple[int, int]) -> None:
    """Raise `InputError` where a mask is no picture of a size (width, height), or black everywhere."""
    from PIL import Image

    with opened(mask, MAX_TABLE_BYTES):
        pass
    try:
        with Image.open(mask) as picture:
            if picture.size != size:  # stated by the file: nothing larger is decoded
                raise InputError(
                    f"Expected {shown(mask)} (--mask) to have the size of the pictures, {size[0]} x {size[1]}, got "
                    f"{picture.width} x {picture.height}."
                )
            kept = np.asarray(picture.convert("L")) > 0
    except (OSError, Image.DecompressionBombError):
        raise InputError(f"{shown(mask)} (--mask) cannot be read as a picture.") from None
    if not kept.any():
        raise InputError(f"{shown(mask)} (--mask) is black everywhere: it is black where the gripper is, else white.")


def _known(intrinsics: Known | StrPath, paths: list[Path]) -> Known:
    if isinstance(intrinsics, Mapping):
        return intrinsics
    from ..model.camera.intrinsics_file import read_intrinsics

    known = read_intrinsics(str(intrinsics), "brown")
    return known.values


class _Run:
    """One run of `scene_poses`."""

    def __init__(
        self, paths: list[Path], robot: Array | None, setup: str, known: Known | None, say: Callable[[str], None]
    ) -> None:
        self.paths, self.robot, self.setup, self.known, self.say = paths, robot, setup, known, say
        self.findings: list[Finding] = []

    def run(self, folder: Path, mask: Path | None) -> ScenePoses:
        lens = None
        if self.known is not None:
            lens = Lens.of(size_of(self.paths[0]), self.known)
        seen = colmap.match(self.paths, folder, lens, mask, self.say)
        models = colmap.models(seen, lens, self.say)
        # What stands still for a fixed camera is the background of what is in the hand.
        gripper = seen.still_region() if self.setup == "eye-in-hand" else None
        if gripper is not None:
            self.findings.append(Finding("scene.gripper", "note", {"share": float(gripper.mean())}))
        if 2 * max((len(one.rows) for one in models), default=0) < len(self.paths):
            if gripper is not None:  # it may have nearly all of the strong features
                mask = colmap.write_mask(gripper, mask, folder / "mask.png")
            if gripper is not None or not seen.weak:
                seen = colmap.match(self.paths, folder, lens, mask, self.say, weak=True)
                models = colmap.models(seen, lens, self.say)
        if not models or len(models[0].rows) < 3:
            raise no_scene(seen, self.setup)
        share = seen.stationary_share()
        if share > MANY_STATIONARY and self.setup == "eye-in-hand" and gripper is None:
            self.findings.append(Finding("scene.stationary", "caution", {"share": share}))
        self.say("adjusting the scene")
        parts = [part for model in models if (part := self._adjusted(model)) is not None]
        if not parts:
            raise no_scene(seen, self.setup)
        main = parts[0]
        sd = lens_sd(main)
        by_pictures = lens_findings(main.scene.lens, sd)
        scale_sd = None
        pull = None
        if self.robot is None:
            if main.n < MIN_PICTURES_OF_SCENE:
                raise no_scene(seen, self.setup)
            main = centred(main)
        else:
            self._require_order(main, seen)
            main, scale_sd, pull = self._with_robot(seen, main, bool(by_pictures))
        sd = lens_sd(main, pull)
        self.findings += by_pictures or lens_findings(main.scene.lens, sd)
        if len(parts) > 1:
            joined = len(np.setdiff1d(parts[1].rows, main.rows)) == 0
            values = {"count": len(parts), "sizes": [part.n for part in parts], "joined": joined}
            self.findings.append(Finding("scene.models", "note" if joined else "caution", values))
        if (moved := moved_object(main, seen, scale_sd is not None)) is not None:
            self.findings.append(moved)
        return self._result(main, seen, sd, scale_sd)

    def _adjusted(self, model: Model) -> Placed | None:
        try:
            return adjusted(model)
        except (InputError, NotConvergedError, np.linalg.LinAlgError):
            return None

    @property
    def _G(self) -> Array:
        assert self.robot is not None
        return self.robot if self.setup == "eye-in-hand" else inverse(self.robot)

    def _require_order(self, main: Placed, seen: Matched) -> None:
        """Raise `InputError` where angles between pictures and between robot poses differ."""
        off = angle_disagreement(self._G[main.rows], main.scene.poses)
        if off <= DISAGREEMENT:
            return
        order = find_order(self._G, main.scene.poses)
        if order is None:
            raise InputError(
                f"The angles between pictures and between robot poses differ by {np.degrees(off):.0f} deg in the "
                "median: pictures and rows do not belong together, or the setup is another."
            )
        told = [
            f"{seen.names[k]} belongs to row {row}" for k, row in zip(main.rows, order.rows, strict=True) if row >= 0
        ]
        raise InputError(
            f"The pictures fit the robot poses in another order: {', '.join(told)}. Rename the pictures, or sort the "
            "rows."
        )

    def _with_robot(self, seen: Matched, main: Placed, stop: bool) -> tuple[Placed, float | None, Pull | None]:
        """Return the scene in metres with all pictures that the robot can place; and the deviation of the scale."""
        found = scale_by_screws(self._G[main.rows], main.scene.poses)
        if found is None:
            return centred(main), None, None
        main = centred(replace(main, scene=main.scene.scaled(found[0])))
        if stop or main.n < MIN_PICTURES_OF_SCENE:
            return main, found[1], None
        pull, scale_sd = None, found[1]
        for max_error in ERRORS_OF_ROUNDS_PX:
            if (result := self._calibrated(main)) is None:
                break
            assert result.camera_scale is not None
            scale_sd = result.camera_scale.std / result.camera_scale.factor
            self.say("placing all pictures by the robot")
            start, by_robot = self._start(main, result)
            model = colmap.triangulate(seen, np.arange(len(start)), start, main.scene.lens, max_error)
            try:
                again = adjusted(model, by_robot.of_pictures(model.rows))
            except (InputError, NotConvergedError, np.linalg.LinAlgError):
                break
            if again.n < main.n:
                break
            main, pull = centred(again), by_robot.of_pictures(again.rows)
        return main, scale_sd, pull

    def _calibrated(self, main: Placed) -> Calibration | None:
        assert self.robot is not None
        poses, covariance = measured_poses(main)
        data = PosePairs(
            self.robot[main.rows], poses, self.setup, camera_covariance=covariance, scene=_facts(main, 0, 0.0)
        )
        with warnings.catch_warnings(), suppress(InputError, NotConvergedError):
            warnings.simplefilter("ignore", InputWarning)
            return calibrate(data)
        return None

    def _start(self, main: Placed, result: Calibration) -> tuple[Array, Pull]:
        """Return camera poses of all pictures to start from, in the frame of the base, and what the robot says."""
        assert self.robot is not None and result.W is not None and result.camera_scale is not None
        n = len(self.robot)
        start = inverse(self._G @ result.X)
        seen = main.scene.scaled(result.camera_scale.factor).poses @ inverse(result.W)
        start[main.rows] = seen  # where the pictures say it themselves
        weights = np.ones(n)
        table, noise = result.table, result.noise
        if table is not None:
            weights[main.rows] = table.weight
        assert isinstance(noise, PoseNoise)
        zero = np.zeros((main.n, 6, 6))
        joint = joint_of(noise.robot)
        if joint is None:
            joint = JointCovariance.of_each(zero if noise.robot is None else zero + marginals(noise.robot))
        total = marginals(joint)  # pictures that are not placed yet have an error by themselves
        own = np.tile(np.median(total, axis=0), (n, 1, 1))
        own[main.rows] = joint.own
        shared = np.zeros((n, 6, joint.shared.shape[-1]))
        shared[main.rows] = joint.shared
        covariance = JointCovariance(0.5 * (own + own.mT), shared)
        return start, pull_of_robot(self.robot, result.X, covariance, weights, self.setup == "eye-to-hand")

    def _result(self, main: Placed, seen: Matched, sd: Array, scale_sd: float | None) -> ScenePoses:
        poses, covariance = measured_poses(main)
        lens = main.scene.lens
        free = lens.names
        of = dict(zip(free, sd.tolist(), strict=True))
        left = [seen.names[k] for k in np.setdiff1d(np.arange(len(seen.names)), main.rows)]
        if left:
            values = {"names": left, "given": len(seen.names), "least": MIN_POINTS}
            self.findings.append(Finding("scene.left_out", "caution", values))
        facts = _facts(main, len(seen.names), of.get("fx", 0.0))
        same = ("points", "per_picture", "pixel_noise", "focal")
        told: dict[str, object] = {name: getattr(facts, name) for name in same}
        told |= {"pictures": main.n, "given": len(seen.names), "scale_sd": scale_sd}
        told["focal_sd"] = of.get("fx")
        facts = replace(
            facts,
            image_size=seen.image_size,
            known=packed(known_scene(main, poses, seen)),
            lens=tuple(lens.values[: len(NAMES)].tolist()),
            lens_sd=tuple(of.get(name, 0.0) for name in NAMES),
            views=scene_views(main.scene.tracks, [self.paths[row] for row in main.rows]),
        )
        self.findings.append(Finding("scene.found", "note", told))
        return ScenePoses(
            poses,
            np.asarray(main.rows, dtype=np.int64),
            covariance,
            dict(zip(NAMES, lens.values[: len(NAMES)].tolist(), strict=True)),
            of,
            main.scene.points,
            tuple(self.findings),
            facts,
            seen.image_size,
            tuple(shown(Path(name)) for name in seen.names),
            main.scene.tracks.per_picture,
            main.colours,
            self.robot,
            self.setup,
        )


def _facts(placed: Placed, given: int, focal_sd: float) -> SceneFacts:
    scene = placed.scene
    return SceneFacts(
        given,
        scene.tracks.m,
        len(scene.tracks) / max(scene.tracks.n, 1),
        placed.noise,
        float(scene.lens.values[0]),
        focal_sd,
    )
