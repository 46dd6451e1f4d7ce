r"""Description of a rig: arms, cameras and targets, the carrier of each, and the views of targets by cameras.

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
from numpy.typing import ArrayLike

from ...core.files.one_line import require_name
from ...core.files.tree_values import is_plain_number
from ...core.geometry.checks import as_numbers, as_transforms
from ...core.geometry.se3 import Array, logarithm
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError, require_type
from ..errors.pose_prior import PosePrior
from ..kinematics.against_controller import compare_with_controller
from ..kinematics.by_poses import joints_by_poses
from ..kinematics.chain import Kinematics
from ..kinematics.kinematic_errors import KinematicErrors
from ..kinematics.newton import postures_at

# Robot poses of one name that differ by more (rad, m) are two poses.
MAX_SAME_POSE = 1e-4
WORLD = "world"


@dataclass(frozen=True, eq=False)
class ArmPoses(ReadOnlyArrays):
    """Measured poses of one arm.

    Parameters
    ----------
    poses : (n, 4, 4)
        ``base_T_gripper``, m.
    names : (n,) hashable, or None
        Name of each pose, the same in the views and the other arms; None: 0, 1, 2, ...
    source : str
        Where they come from, for messages.
    kinematics : Kinematics or None
        Chain of the arm, whose errors take the place of those of an unknown arm; see `by_kinematics`.
    joints : (n, L) or None
        Joint values, rad or m, with ``kinematics``.
    errors : KinematicErrors
        What is known of the errors of ``kinematics`` beforehand.
    by_poses : bool
        Whether the joints follow from the poses by inverse kinematics.
    timed : bool
        Whether the names are times (s), also whole ones; fractions always are.

    Raises
    ------
    InputError
        Wrong shapes, joints without kinematics.
    """

    poses: Array
    names: tuple[Hashable, ...] = ()
    source: str = ""
    kinematics: Kinematics | None = None
    joints: Array | None = None
    errors: KinematicErrors = field(default_factory=KinematicErrors)
    by_poses: bool = False
    timed: bool = False

    def __post_init__(self) -> None:
        of = self.source or "the arm"
        poses = as_transforms(self.poses, f"poses{self.source and ' of ' + self.source}")
        if poses.ndim != 3:
            raise InputError(f"Expected `poses` of an arm to have shape (n, 4, 4), got {poses.shape}.")
        chain = self.kinematics
        if (self.joints is None) != (chain is None):
            raise InputError(f"Expected `joints` and `kinematics` of {of} together. See ArmPoses.by_kinematics.")
        if chain is not None:
            q = as_numbers(self.joints, f"joints of {of}")
            if q.shape != (len(poses), chain.n_joints):
                raise InputError(f"Expected `joints` of {of} to be ({len(poses)}, {chain.n_joints}), got {q.shape}.")
            object.__setattr__(self, "joints", q)
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "names", named(self.names, len(poses), of))
        super().__post_init__()

    @classmethod
    def by_kinematics(
        cls,
        kinematics: Kinematics,
        poses: ArrayLike | None = None,
        joints: ArrayLike | None = None,
        names: Sequence[Hashable] = (),
        source: str = "",
        errors: KinematicErrors | None = None,
        timed: bool = False,
    ) -> ArmPoses:
        """Build the poses of an arm from its joints (n, L), or its joints from the poses by inverse kinematics.

        With both, the chain gets the base frame and the tool of the poses. Raises `InputError` for poses that the arm
        does not reach, or that its joints contradict.
        """
        of, chain = source or "the arm", kinematics
        errors = KinematicErrors() if errors is None else errors
        T = None if poses is None else as_transforms(poses, f"poses of {of}")
        if joints is None:
            if T is None:
                raise InputError(f"Expected `poses` or `joints` of {of} beside `kinematics`, got neither.")
            try:
                return cls(T, tuple(names), source, chain, joints_by_poses(chain, T), errors, True, timed)
            except InputError as error:
                raise InputError(f"{of}: {error}") from error
        q = as_numbers(joints, f"joints of {of}")
        if q.ndim != 2 or q.shape[1] != chain.n_joints or (T is not None and len(q) != len(T)):
            expected = f"({'n' if T is None else len(T)}, {chain.n_joints})"
            raise InputError(f"Expected `joints` of {of} to have shape {expected}, got {q.shape}.")
        if T is None:
            return cls(chain.poses(q), tuple(names), source, chain, q, errors, timed=timed)
        against = compare_with_controller(chain, q, T)
        if not against.same_arm:
            raise InputError(f"{of}: {' '.join(map(str, against.findings))}")
        return cls(T, tuple(names), source, against.adapt(chain), q, errors, timed=timed)

    def like(self, new: ArmPoses) -> ArmPoses:
        """Return new poses of this arm, with its kinematics; missing joints are computed from the nearest posture."""
        chain, q = self.kinematics, new.joints
        if chain is None:
            return new if new.kinematics is None else ArmPoses(new.poses, new.names, new.source, timed=new.timed)
        if q is None:
            apart = np.linalg.norm(new.poses[:, None, :3] - self.poses[None, :, :3], axis=(-2, -1))
            found = postures_at(chain, new.poses, np.asarray(self.joints)[apart.argmin(axis=1)])
            if not found.reached.all():
                raise InputError(
                    f"{new.source or 'the arm'}: the arm {chain.name} does not reach {int((~found.reached).sum())} of "
                    f"{len(found.q)} poses. Give its joints."
                )
            q = found.q
        return ArmPoses(new.poses, new.names, new.source, chain, q, self.errors, self.by_poses, new.timed)

    def joined(self, other: ArmPoses) -> ArmPoses:
        """Return these poses with those of another file; raises `InputError` where the two disagree."""
        at = {name: k for k, name in enumerate(self.names)}
        for k, name in enumerate(other.names):
            if name not in at:
                continue
            turn, shift = _apart(self.poses[at[name]], other.poses[k])
            if max(turn, shift) > MAX_SAME_POSE:
                files = f"{self.source or 'The old poses'} and {other.source or 'the new ones'}"
                raise InputError(
                    f"{files} disagree on robot pose {name!s}: {np.degrees(turn):.3g} deg, {1e3 * shift:.3g} mm. "
                    "Remove it from one of them, or rename it."
                )
        new = [k for k, name in enumerate(other.names) if name not in at]
        joints = None
        if self.joints is not None and other.joints is not None:
            joints = np.concatenate([self.joints, other.joints[new]])
        poses, names = np.concatenate([self.poses, other.poses[new]]), (*self.names, *(other.names[k] for k in new))
        chain = None if joints is None else self.kinematics
        timed = self.timed and other.timed
        return ArmPoses(poses, names, self.source, chain, joints, self.errors, self.by_poses, timed)

    def has_others_at_names_of(self, other: ArmPoses) -> bool | None:
        """Return whether all poses of another file are other ones than those of the same names; None: of no such."""
        at = {name: k for k, name in enumerate(self.names)}
        both = [(self.poses[at[name]], other.poses[k]) for k, name in enumerate(other.names) if name in at]
        return all(max(_apart(*two)) > MAX_SAME_POSE for two in both) if both else None


def _by_time(moments: Sequence[Any], names: Sequence[Any]) -> str:
    """Return how views are matched whose times are nearly those of robot poses; nothing where they are not."""
    if not all(is_plain_number(one) for one in (*moments, *names)):
        return ""
    at, times = np.array(moments, dtype=float), np.unique(np.array(names, dtype=float))
    away = float(np.abs(at[:, None] - times).min(axis=1).max())
    if len(times) < 2 or away > 0.25 * float(np.diff(times).min()):
        return ""
    tolerance = np.ceil(1200.0 * away) / 1000.0
    return (
        f"Each is within {away:.2g} s of one: match them by time (--pair time --time-tolerance {tolerance:g}; in a rig "
        f"file tolerance = {tolerance:g} at its top)."
    )


def _apart(one: Array, two: Array) -> tuple[float, float]:
    """Return the angle (rad) and the distance (m) between two poses."""
    turn = float(np.linalg.norm(logarithm(one[:3, :3] @ two[:3, :3].T)))
    return turn, float(np.linalg.norm(one[:3, 3] - two[:3, 3]))


@dataclass(frozen=True, eq=False)
class View(ReadOnlyArrays):
    """Measured poses of one target in the frame of one camera.

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
        Effect of one standard deviation of each of q errors of the camera's calibration on these poses, in addition to
        ``covariance``; the same q errors in all views of the camera.
    scene : bool
        Whether the target is a scene (`scene_rig`): the q errors are common to all views of it, and its scale is not
        known.
    """

    camera: str
    target: str
    poses: Array
    at: tuple[Hashable, ...] | None = None
    covariance: Array | None = None
    source: str = ""
    intrinsics: Array | None = None
    scene: bool = False

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
    """Arms, cameras and targets with their carriers, and the views; checked once and never changed.

    Parameters
    ----------
    arms : mapping of names to (n, 4, 4) or ArmPoses
        Measured ``base_T_gripper`` of each arm. The world is the base of the first.
    cameras, targets : mapping of names to the name of an arm or "world"
        The carrier of each.
    views : sequence of View
    known : mapping of names to (pose (4, 4), covariance (6, 6)) or PosePrior, or None
        Priors of the poses of cameras, targets or bases of arms, in the frame of their carrier: measurements in
        addition to the views. Infinity on the diagonal of a covariance: not known.

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
    >>> result = uq.calibrate(rig, noise={"arm": ("0.5mrad", "0.3mm"), "left": ("1mrad", "0.5mm")})
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
        require_names(self.arms, self.cameras, self.targets)
        views = tuple(self.views)
        if not views or not all(isinstance(view, View) for view in views):
            raise InputError("Expected `views` to be one or more View.")
        object.__setattr__(self, "views", tuple(self._checked(view) for view in views))
        self._require_once()
        object.__setattr__(self, "known", self._known())
        super().__post_init__()

    def _checked(self, view: View) -> View:
        for what, name, listed in (
            ("camera", view.camera, self.cameras),
            ("target", view.target, self.targets),
        ):
            require_in_rig(name, what, listed, view.words)
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
                    f"{'' if len(lacking) == 1 else f' ({len(lacking)} such rows)'}. "
                    + (_by_time(lacking, self.arms[name].names) or "Correct the names, or add the poses.")
                )
        return view

    def _require_once(self) -> None:
        """Raise `InputError` for a view of one target by one camera at one robot pose that is there twice."""
        seen: dict[tuple[str, str, Hashable], int] = {}
        for k, view in enumerate(self.views):
            for moment in view.at or () if self.places(view) != (WORLD, WORLD) else ():
                if (before := seen.setdefault((view.camera, view.target, moment), k)) != k:
                    raise InputError(
                        f"{self.views[before].words} and {view.words} both have the view of {view.target} by "
                        f"{view.camera} at robot pose {moment!s}, which counts once. Remove one of them."
                    )

    def _known(self) -> dict[str, PosePrior]:
        found: dict[str, PosePrior] = {}
        for name, given in (self.known or {}).items():
            if name not in self.cameras and name not in self.targets and name not in list(self.arms)[1:]:
                raise InputError(
                    f"Expected `known` poses of cameras, targets or arms but the first, got {name!r}. "
                    + nearest_names(name, [*self.cameras, *self.targets, *list(self.arms)[1:]])
                )
            prior = given if isinstance(given, PosePrior) else PosePrior.of(given)
            assert prior is not None and prior.X is not None
            found[name] = prior
        return found

    def places(self, view: View) -> tuple[str, str]:
        """Carriers of camera and target of a view; where both are the same, there is no motion between them."""
        of_camera, of_target = self.cameras[view.camera], self.targets[view.target]
        return (WORLD, WORLD) if of_camera == of_target else (of_camera, of_target)

    def place(self, name: str) -> str:
        """Carrier of a camera, a target or the base of an arm."""
        return self.cameras.get(name) or self.targets.get(name) or WORLD

    @property
    def words(self) -> str:
        """The numbers of arms, cameras and targets."""
        counts = (("arm", self.arms), ("camera", self.cameras), ("target", self.targets))
        return ", ".join(f"{len(of)} {what}{'' if len(of) == 1 else 's'}" for what, of in counts)

    @property
    def moments(self) -> list[Hashable]:
        """Names of all moments: sorted if numbers, else as they come."""
        listed = list(
            dict.fromkeys(name for arm in self.arms.values() for name in arm.names)
            | dict.fromkeys(name for view in self.views for name in view.at or ())
        )
        if all(map(is_plain_number, listed)):
            listed.sort(key=float)
        return listed

    def joined(self, new: Rig) -> Rig:
        """Return the rig with the views of another one, too; robot poses of one name must be the same."""
        arms = {name: arm if new.arms[name] is arm else arm.joined(new.arms[name]) for name, arm in self.arms.items()}
        return replace(self, arms=arms, views=(*self.views, *new.views))

    @property
    def n_views(self) -> int:
        """Number of all views."""
        return sum(len(view.poses) for view in self.views)

    def __repr__(self) -> str:
        return f"Rig({self.words}, {self.n_views} views)"


def named(names: Sequence[Hashable], count: int, whose: str) -> tuple[Hashable, ...]:
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
    require_type(name, value, Mapping, "a mapping of names")
    for key in value:
        require_type(name, key or None, str, "a mapping of names")
    return value  # type: ignore[no-any-return]


def later_name(name: str, since: Hashable) -> str:
    """Name a camera or target that moved, from a moment on."""
    return f"{name.partition('@')[0]}@{since}"


def require_left_out(where: str, **options: Any) -> None:
    """Raise `InputError` for arguments of one camera that were given."""
    if given := [name for name, value in options.items() if value is not None]:
        raise InputError(f"`{given[0]}` is not an argument for the result {where}. Leave it out.")


def require_names(arms: Iterable[str], cameras: Mapping[str, str], targets: Mapping[str, str]) -> None:
    """Raise `InputError` for a name that occurs twice, a part without a carrier, with two, or on an unknown arm."""
    places = (WORLD, *arms)
    for name in (*arms, *cameras, *targets):
        require_name(name)
    if twice := [name for name, count in Counter([*places, *cameras, *targets]).items() if count > 1]:
        raise InputError(
            f"Expected names of arms, cameras and targets that differ, got {twice[0]!r} twice. Rename one."
        )
    for what, listed in (("camera", cameras), ("target", targets)):
        for name, place in listed.items():
            if not isinstance(place, str):
                raise InputError(f"The {what} {name!r} is on two things: {place}. Name one of {', '.join(places)}.")
            if place not in places:
                raise InputError(
                    f"The {what} {name!r} is on {place!r}, which is none of {', '.join(places)}. Correct the name."
                )


def require_in_rig(name: str, what: str, listed: Iterable[str], words: str) -> None:
    """Raise `InputError` for a camera or a target that the rig does not have."""
    if name not in listed:
        raise InputError(
            f"{words} names the {what} {name!r}, which the rig does not have. {nearest_names(name, listed)}"
        )


def nearest_names(name: str, among: Iterable[str]) -> str:
    """Return the names that are near one, in words."""
    listed: Sequence[str] = list(among)
    near = get_close_matches(name, listed, 3, 0.5)
    return f"Near it: {', '.join(near)}." if near else f"There are {', '.join(listed)}."
