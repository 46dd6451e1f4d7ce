r"""Rig: arms, cameras and targets, what each of them is mounted on, and what the cameras saw.

A camera or a target is ``on`` an arm (its flange) or the world, which is the base of the first arm. A moment is one
measured robot pose, known by its name: an index, a number in a column, a time. Views of one moment share the errors of
that robot pose. Several arms have a pose each at the same moment, by the same name.

    P C = Q,      P = [B_a G_ak] X_c,   Q = [B_b G_bk] W_t

for each view of target t by camera c at moment k, with the brackets only for what an arm carries (T18).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Any

import numpy as np

from ..core.geometry.checks import as_transforms
from ..core.geometry.se3 import Array, logarithm
from ..core.runtime.read_only import ReadOnlyArrays
from ..errors import InputError
from ..model.noise.pose_prior import PosePrior

WORLD = "world"
# Poses of one name that differ by more (rad, m) are two poses.
SAME = (1e-4, 1e-4)


@dataclass(frozen=True, eq=False)
class ArmPoses(ReadOnlyArrays):
    """Measured poses of one arm.

    Parameters
    ----------
    poses : (n, 4, 4)
        ``base_T_gripper``, m.
    names : (n,) hashable, or None
        Name of each pose, in common with the views and the other arms; None: 0, 1, 2, ...
    source : str
        Where they come from, for messages.
    """

    poses: Array
    names: tuple[Hashable, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        poses = as_transforms(self.poses, f"poses{self.source and ' of ' + self.source}")
        if poses.ndim != 3:
            raise InputError(f"Expected `poses` of an arm to have shape (n, 4, 4), got {poses.shape}.")
        names = named(self.names, len(poses), self.source or "the arm")
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "names", names)
        super().__post_init__()

    def joined(self, other: ArmPoses) -> ArmPoses:
        """Return these poses with those of another file; raises `InputError` where the two disagree."""
        at = {name: k for k, name in enumerate(self.names)}
        for k, name in enumerate(other.names):
            if name not in at:
                continue
            one, two = self.poses[at[name]], other.poses[k]
            turn, shift = float(np.linalg.norm(logarithm(one[:3, :3] @ two[:3, :3].T))), one[:3, 3] - two[:3, 3]
            if turn > SAME[0] or float(np.linalg.norm(shift)) > SAME[1]:
                raise InputError(
                    f"{self.source} and {other.source} disagree on robot pose {name!s}: {np.degrees(turn):.3g} deg, "
                    f"{1e3 * float(np.linalg.norm(shift)):.3g} mm. Remove it from one of them, or rename it."
                )
        new = [k for k, name in enumerate(other.names) if name not in at]
        return ArmPoses(
            np.concatenate([self.poses, other.poses[new]]), (*self.names, *(other.names[k] for k in new)), self.source
        )


@dataclass(frozen=True, eq=False)
class View(ReadOnlyArrays):
    """Poses of one target as one camera saw it.

    Parameters
    ----------
    camera, target : str
        Names in the rig.
    poses : (m, 4, 4)
        ``camera_T_target``, m.
    at : (m,) hashable, or None
        Names of the moments, as those of the robot poses. None: the poses of the arm row by row, which needs as many.
    covariance : (6, 6), (m, 6, 6) or None
        Of these poses, in place of the noise of the camera.
    source : str
        Where they come from, for messages.
    intrinsics : (m, 6, q) or None
        What one standard deviation of each of q errors of the camera's calibration does to these poses, beside
        ``covariance``; the same q errors in all views of the camera.
    """

    camera: str
    target: str
    poses: Array
    at: tuple[Hashable, ...] | None = None
    covariance: Array | None = None
    source: str = ""
    intrinsics: Array | None = None

    def __post_init__(self) -> None:
        poses = as_transforms(self.poses, f"poses of {self.words}")
        if poses.ndim != 3:
            raise InputError(f"Expected `poses` of {self.words} to have shape (m, 4, 4), got {poses.shape}.")
        object.__setattr__(self, "poses", poses)
        if self.at is not None:
            object.__setattr__(self, "at", named(self.at, len(poses), self.words))
        if self.covariance is not None:
            S = np.asarray(self.covariance, dtype=float)
            if S.shape not in ((6, 6), (len(poses), 6, 6)):
                raise InputError(f"Expected the covariance of {self.words} to be (6, 6) or (m, 6, 6), got {S.shape}.")
            object.__setattr__(self, "covariance", S)
        if self.intrinsics is not None:
            F = np.asarray(self.intrinsics, dtype=float)
            if F.ndim != 3 or F.shape[:2] != (len(poses), 6) or self.covariance is None:
                raise InputError(
                    f"Expected the intrinsics of {self.words} to be (m, 6, q) beside a covariance, got {F.shape}."
                )
            object.__setattr__(self, "intrinsics", F)
        super().__post_init__()

    @property
    def words(self) -> str:
        """The file, or camera and target."""
        return self.source or f"the view of {self.target} by {self.camera}"


@dataclass(frozen=True, eq=False)
class Rig(ReadOnlyArrays):
    """Arms, cameras and targets with what they are on, and the views; checked once and never changed.

    Parameters
    ----------
    arms : mapping of names to (n, 4, 4) or ArmPoses
        Measured ``base_T_gripper`` of each arm. The world is the base of the first.
    cameras, targets : mapping of names to the name of an arm or "world"
        What each is mounted on.
    views : sequence of View
    known : mapping of names to (pose (4, 4), covariance (6, 6)) or PosePrior, or None
        Poses that are known beforehand, of cameras, targets or bases of arms, on what they are on: a measurement beside
        the views. Infinity on the diagonal of a covariance: not known.

    Raises
    ------
    InputError
        Names that occur twice, a view of an unknown camera or target, moments that an arm has no pose of.

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> poses = uq.simulate(n_poses=10, seed=1)
    >>> view = uq.View("left", "board", poses.camera)
    >>> rig = uq.Rig({"arm": poses.robot}, {"left": "arm"}, {"board": "world"}, [view])
    >>> result = uq.calibrate_rig(rig, noise={"arm": ("0.5mrad", "0.3mm"), "left": ("1mrad", "0.5mm")})
    >>> bool(np.allclose(result.cameras["left"].X, poses.truth.X, atol=1e-9))
    True
    """

    arms: Mapping[str, Any]
    cameras: Mapping[str, str]
    targets: Mapping[str, str]
    views: tuple[View, ...]
    known: Mapping[str, Any] | None = field(default=None)

    def __post_init__(self) -> None:
        arms = {}
        for name, given in _mapping(self.arms, "arms").items():
            arms[name] = given if isinstance(given, ArmPoses) else ArmPoses(given, source=f"arm {name}")
        if not arms:
            raise InputError("Expected at least one arm in `arms`, got none.")
        object.__setattr__(self, "arms", arms)
        for what in ("cameras", "targets"):
            object.__setattr__(self, what, dict(_mapping(getattr(self, what), what)))
        self._check_names()
        views = tuple(self.views)
        if not views or not all(isinstance(view, View) for view in views):
            raise InputError("Expected `views` to be one or more View.")
        object.__setattr__(self, "views", tuple(self._checked(view) for view in views))
        object.__setattr__(self, "known", self._known())
        super().__post_init__()

    def _check_names(self) -> None:
        places = (WORLD, *self.arms)
        names = [*places, *self.cameras, *self.targets]
        if twice := [name for name, count in Counter(names).items() if count > 1]:
            raise InputError(
                f"Expected names of arms, cameras and targets that differ, got {twice[0]!r} twice. Rename one."
            )
        for what, listed in (("camera", self.cameras), ("target", self.targets)):
            for name, place in listed.items():
                if not isinstance(place, str):
                    raise InputError(f"The {what} {name!r} is on two things: {place}. Name one of {', '.join(places)}.")
                if place not in places:
                    raise InputError(
                        f"The {what} {name!r} is on {place!r}, which is none of {', '.join(places)}. Correct the name."
                    )

    def _checked(self, view: View) -> View:
        for what, name, listed in (
            ("camera", view.camera, self.cameras),
            ("target", view.target, self.targets),
        ):
            if name not in listed:
                raise InputError(
                    f"{view.words} names the {what} {name!r}, which the rig does not have. {_near(name, listed)}"
                )
        arms = [place for place in self.places(view) if place != WORLD]
        if view.at is None:
            if not arms:
                return replace(view, at=tuple(f"{view.camera}, {view.target}: {k}" for k in range(len(view.poses))))
            arm = self.arms[arms[0]]
            if len(arm.names) != len(view.poses):
                raise InputError(
                    f"{view.words} has {len(view.poses)} poses and the arm {arms[0]!r} {len(arm.names)}. Name the "
                    "robot pose of each view (column `name` or timestamps); rows never match by order."
                )
            return replace(view, at=arm.names)
        for name in dict.fromkeys(arms):
            has = set(self.arms[name].names)
            if lacking := [moment for moment in view.at if moment not in has]:
                raise InputError(
                    f"{view.words} names robot pose {lacking[0]!s}, which the files of the arm {name!r} do not have"
                    f"{'' if len(lacking) == 1 else f' ({len(lacking)} such rows)'}. Correct the names, or add "
                    "the poses."
                )
        return view

    def _known(self) -> dict[str, PosePrior]:
        found: dict[str, PosePrior] = {}
        for name, given in (self.known or {}).items():
            if name not in self.cameras and name not in self.targets and name not in list(self.arms)[1:]:
                raise InputError(
                    f"Expected `known` poses of cameras, targets or arms but the first, got {name!r}. "
                    + _near(name, [*self.cameras, *self.targets, *list(self.arms)[1:]])
                )
            prior = given if isinstance(given, PosePrior) else PosePrior.of(given)
            assert prior is not None and prior.X is not None
            found[name] = prior
        return found

    def places(self, view: View) -> tuple[str, str]:
        """Carriers of camera and target of a view: nothing moves between them where both are the same."""
        of_camera, of_target = self.cameras[view.camera], self.targets[view.target]
        return (WORLD, WORLD) if of_camera == of_target else (of_camera, of_target)

    def place(self, name: str) -> str:
        """Carrier of a camera, a target or the base of an arm."""
        return self.cameras.get(name) or self.targets.get(name) or WORLD

    def __repr__(self) -> str:
        counts = (("arm", self.arms), ("camera", self.cameras), ("target", self.targets))
        words = ", ".join(f"{len(of)} {what}{'' if len(of) == 1 else 's'}" for what, of in counts)
        return f"Rig({words}, {sum(len(view.poses) for view in self.views)} views)"


def named(names: Any, count: int, whose: str) -> tuple[Hashable, ...]:
    """Names of ``count`` poses, 0, 1, ... if there are none; raises `InputError` for others and for doubles."""
    if names is None or len(names) == 0:
        return tuple(range(count))
    found = tuple(name.item() if isinstance(name, np.generic) else name for name in names)
    if len(found) != count:
        raise InputError(f"Expected {count} names of poses of {whose}, got {len(found)}.")
    if twice := [name for name, times in Counter(found).items() if times > 1]:
        raise InputError(f"{whose} has robot pose {twice[0]!s} twice. Remove one of the rows, or rename it.")
    return found


def _mapping(value: Any, name: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping) or not all(isinstance(key, str) and key for key in value):
        raise InputError(f"Expected `{name}` to be a mapping of names, got {type(value).__name__}.")
    return value


def _near(name: str, among: Iterable[str]) -> str:
    listed: Sequence[str] = list(among)
    near = get_close_matches(name, listed, 3, 0.4) or listed
    return f"Near it: {', '.join(near)}."
