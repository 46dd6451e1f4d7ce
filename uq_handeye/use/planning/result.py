"""Result of `plan`: the poses to take next, and the covariance of X after each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...calibration.tolerance import Tolerance
from ...core.files.csv_text import csv_text
from ...core.files.json_values import JsonObject
from ...core.files.records import attributes
from ...core.geometry.conventions import CONVENTION
from ...core.geometry.frames import SETUPS
from ...core.geometry.se3 import Array
from ...core.presentation.shown import Shown
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError
from ...formats.controllers.forms import CONTROLLERS
from ...formats.controllers.written import SINGLE, WRITTEN, written_poses
from ...model.errors.models import PoseNoise
from ...read import pose_text, write_atomically
from .weak_prior import WEAK_PRIOR_SD

# Formats in which several poses can be written.
FORMS = tuple(name for name in WRITTEN if name not in SINGLE)


@dataclass(frozen=True, eq=False)
class Plan(ReadOnlyArrays, Shown):
    """The next k poses in the order in which to take them, and the covariance of X predicted after each.

    Predicted to first order, for the noise and the shared errors that are named; nothing else that is systematic. Of a
    rig each is one view: the robot poses, and the camera and target of which a view is taken there.
    """

    chosen: NDArray[np.intp]  # (k,) rows of the candidates, from 0
    views: tuple[tuple[str, str], ...]  # (k,) camera and target
    robots: dict[str, Array]  # (k, 4, 4) base_T_gripper of each arm
    camera: Array  # (k, 4, 4) camera_T_target that the camera should see there
    cameras: tuple[str, ...]  # whose poses the covariances are of
    of_cameras: Array  # (k + 1, cameras, 6, 6) from the poses so far, and after each
    criterion: str
    criterion_before: float
    criterion_values: Array  # (k,) after each: m^2, or the logarithm of rad^6 m^6
    length: float | None  # m, of criterion trace
    point: Array | None  # (3,) m, camera coordinates, of criterion point
    X: Array  # (4, 4) from the poses so far; of a rig that of the first camera
    W: Array  # (4, 4); of the first target
    setup: str | None  # of one camera
    n_poses: int  # so far; of a rig views
    n_candidates: int
    sampled: bool  # the candidates were drawn, not given
    noise: PoseNoise | None  # 6x6, of each new pose; None of a rig, whose noise is by arm and camera
    noise_estimated: bool  # from the poses so far
    open_directions: Array  # (r, 6) unit vectors of xi_X/prior that the poses so far leave to the weak prior
    shared: tuple[str, ...] = ()  # errors that all poses share, also the new ones, by name
    joints: Array | None = None  # (k, L) rad, m, where the plan is one of joints
    joint_names: tuple[str, ...] = ()  # (L)
    joint_units: tuple[str, ...] = ()  # (L) rad or m
    joint_noise: float = 0.0  # rad, of each joint of each new pose
    task: Array | None = None  # (t, L) joints at which predictions are to be good, of criterion prediction
    task_given: bool = False  # or spread over the joint limits
    tolerance: Tolerance | None = None  # which X is to meet
    needed: int | None = None  # more poses until it does (PASS); None: not by any number that was tried
    form: str | None = None  # a name of `FORMS`: how the robot's poses are written; None: m and quaternion
    contradictions: tuple[str, ...] = ()  # reasons why X of the poses so far cannot be used

    @property
    def frame(self) -> str:
        """``gripper_T_camera`` or ``base_T_camera``; of a rig the cameras."""
        return ", ".join(self.cameras) if self.setup is None else SETUPS[self.setup]

    @property
    def robot(self) -> Array:
        """(k, 4, 4) base_T_gripper of the first arm."""
        return next(iter(self.robots.values()))

    @property
    def covariance_before(self) -> Array:
        """(6, 6) of X, or of the first camera, from the poses so far."""
        return np.asarray(self.of_cameras[0, 0])

    @property
    def covariances(self) -> Array:
        """(k, 6, 6) of X, or of the first camera, after each pose."""
        return np.asarray(self.of_cameras[1:, 0])

    @property
    def std(self) -> Array:
        """Standard deviations (k + 1, 6) of (theta, tau), rad and m: before, and after each pose; first camera."""
        return np.sqrt(np.diagonal(self.of_cameras[:, 0], axis1=-2, axis2=-1))

    @property
    def worst(self) -> Array:
        """Standard deviations (k + 1, 2) of rotation (rad) and translation (m), worst camera and axis."""
        blocks = self.of_cameras
        largest = [np.linalg.eigvalsh(part)[..., -1] for part in (blocks[..., :3, :3], blocks[..., 3:, 3:])]
        return np.asarray(np.sqrt(np.maximum(np.stack(largest, axis=-1).max(axis=1), 0.0)))

    def __repr__(self) -> str:
        return f"Plan({len(self.chosen)} poses after {self.n_poses}, criterion {self.criterion})"

    @property
    def unfolded(self) -> int:
        """The sentence and the table."""
        return 2

    @property
    def prior_std(self) -> float | None:
        """Standard deviation (rad, m) of the weak prior, where there is one."""
        return WEAK_PRIOR_SD if len(self.open_directions) else None

    def to_dict(self) -> JsonObject:
        """Everything as plain numbers, lists and text."""
        named = attributes(
            self,
            "frame setup cameras n_poses n_candidates sampled noise noise_estimated shared X W criterion length point "
            "prior_std open_directions",
        )
        if self.joints is not None:
            named |= attributes(self, "joint_names joint_units joint_noise")
            named["task"] = self.task.tolist() if self.task is not None and self.task_given else None
        if self.tolerance is not None:
            named |= {"tolerance": str(self.tolerance), "poses_until_pass": self.needed}
        where = [
            {"candidate": row, **({} if self.joints is None else {"joints": self.joints[k].tolist()})}
            | {"view": list(self.views[k]), "robot": self.robot[k].tolist(), "camera": self.camera[k].tolist()}
            | ({"robots": {name: T[k].tolist() for name, T in self.robots.items()}} if len(self.robots) > 1 else {})
            for k, row in enumerate(self.chosen.tolist())
        ]
        after = [
            {
                "covariance": (S[0] if len(S) == 1 else S).tolist(), "std": std.tolist(),
                "worst_rotation": float(worst[0]), "worst_translation": float(worst[1]), "criterion": float(value),
            }
            for S, std, worst, value in zip(
                self.of_cameras, self.std, self.worst, [self.criterion_before, *self.criterion_values], strict=True
            )
        ]  # fmt: skip
        steps = [place | numbers for place, numbers in zip(where, after[1:], strict=True)]
        about = {"format": "uq-handeye plan 2", "convention": CONVENTION,
                 "units": {"rotation": "rad", "translation": "m"}}  # fmt: skip
        return about | named | {"before": after[0], "steps": steps}

    def to_csv(self, path: str | Path | None = None, arm: str | None = None) -> str:
        """The poses of an arm (None: the first) as a pose file (m), in order, numbered 0, 1, ...; also to ``path``.

        A plan of joints is a file of joints (rad, m) under their names, as `kinematics.joints_file` reads.
        """
        if self.joints is None:
            text = pose_text(self.robot if arm is None else self.robots[arm])
        else:
            head = [f"{name} [{unit}]" for name, unit in zip(self.joint_names, self.joint_units, strict=True)]
            text = csv_text([head, *([f"{value:.9g}" for value in q] for q in self.joints)])
        if path is not None:
            write_atomically(path, text)
        return text

    def to_controller(self, path: str | Path | None = None) -> str:
        """The robot poses as the controller of `form` writes them (P1, P2, ...), or as matrices; also to ``path``.

        Raises `InputError` without a form.
        """
        if self.form is None:
            raise InputError("The plan has no form of a controller. Read the poses by `format`, or name one (--as).")
        maker = CONTROLLERS.get(self.form)
        writer = f"as {maker.maker} writes them" if maker is not None else f"in the format {self.form}"
        comment = f"The next poses of the robot (base_T_gripper) in order, {writer}."
        names = [f"P{k}" for k in range(1, len(self.robot) + 1)]
        text = written_poses(self.robot, self.form, names, [comment])
        if path is not None:
            write_atomically(path, text)
        return text
