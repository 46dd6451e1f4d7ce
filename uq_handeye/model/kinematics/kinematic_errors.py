r"""Assumed kinematic errors of an arm, and their effects at the poses of one data set.

The errors e of an arm (`chain.Kinematics.errors`) are drawn once and shared by all of its poses. Those of a group, such
as the offsets of its joints, have one standard deviation. A few poses of one region do not determine it (theory T13):
its prior comes from arms of the kind, their *population*, within a factor:

- ``declared``: the standard deviations are exactly those given;
- ``estimate``: those given are the smallest that are assumed; the data may show larger ones, with a prior of the
  logarithm that falls off like a Gaussian with ``log(factor)`` as its standard deviation;
- ``exact``: the arm is its model; poses come from its joints, without errors.

Joint noise is drawn again for every pose and rotates joint k by ``N(0, joint_sd^2)``: encoder, backlash, servo.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from ...core.presentation.units import parse_angle, parse_length
from ...errors import InputError
from ..errors.key import ErrorKey, Kind, Owner
from ..errors.keys import JOINT_NOISE
from ..errors.sizes import SIZES, Size
from ..errors.term import ErrorTerm
from .chain import Kinematics
from .errors import LENGTHS, OFFSETS, SAG, TILTS, TRANSMISSION
from .forward import LEVER_M
from .workspace_gauge import aligned_columns, aligned_poses, counting, frame_columns

ESTIMATE, DECLARED, EXACT = "estimate", "declared", "exact"
HOW = (ESTIMATE, DECLARED, EXACT)
WORKSPACE, CONTROLLER, PHYSICAL = "workspace", "controller", "physical"
FLANGES = (WORKSPACE, CONTROLLER, PHYSICAL)

# Standard deviations (rad along the joints) of the elbow of an arm of seven axes whose joints are found by its poses:
# where it is at all poses; and per rad that poses are turned from each other, along each of six directions in which
# they differ, and at each pose. Pandas have 0.5, 0.2 and 0.35 with poses of one region, 0.35, 0.15 and 0.5 anywhere.
ELBOW_SD_RAD, ELBOW_SD_ALONG, ELBOW_SD_OF_POSE = 0.5, 0.2, 0.35

# Unit of the sizes of each group.
UNITS = dict.fromkeys((OFFSETS, TILTS, TRANSMISSION, SAG), "rad") | {LENGTHS: "m"}
# The field of `KinematicErrors` that declares each group.
DECLARED_AS = {
    OFFSETS: "offset_sd",
    TILTS: "tilt_sd",
    LENGTHS: "length_sd",
    TRANSMISSION: "transmission_sd",
    SAG: "sag_sd",
}


class Population(NamedTuple):
    """Standard deviations that arms of a kind have at least, rad and m, and the factor within which they are known."""

    offset_sd: float
    tilt_sd: float
    length_sd: float
    transmission_sd: float
    sag_sd: float
    joint_sd: float
    factor: float


# By class; docs/explanation/kinematics.md has the sources.
POPULATIONS = {
    "industrial": Population(3e-3, 0.9e-3, 0.3e-3, 0.4e-3, 1.5e-3, 0.2e-3, 2.0),
    "cobot": Population(7e-3, 1.8e-3, 0.3e-3, 0.4e-3, 1.0e-3, 0.2e-3, 2.0),
    "hobby": Population(20e-3, 10e-3, 1e-3, 10e-3, 10e-3, 3e-3, 2.0),
    "calibrated": Population(0.15e-3, 0.08e-3, 0.03e-3, 0.03e-3, 0.15e-3, 0.1e-3, 3.0),
}
# The kind of arm that is assumed where none is given, and the one that is taken where the poses make it more probable.
USUAL, ACCURATE = "industrial", "calibrated"


@dataclass(frozen=True)
class KinematicErrors:
    """Knowledge about the errors of an arm before the data: see the module.

    Parameters
    ----------
    how : "estimate", "declared" or "exact"
    offset_sd, tilt_sd, transmission_sd, sag_sd : float (rad), text with a unit such as "0.02deg", or None
        Standard deviations of the offsets of the joints, the tilts of their axes, the errors of transmissions (first
        and second harmonic of each joint angle) and the give of each joint under the largest torque of gravity.
    length_sd : float (m), text such as "0.2mm", or None
        Of each of the three lengths from joint to joint.
    joint_sd : float (rad), text or None
        Standard deviation of the joint noise of each pose, as it is; None: it is estimated, and 0 for declared errors
        with noise that is given.
    robot_class : "industrial", "cobot", "hobby", "calibrated" or None
        Where a standard deviation is None: that of the population of such arms; None: of industrial ones, or of
        calibrated ones where the poses make these much more probable, but where some are declared, the others are 0.
    flange : "workspace", "controller" or "physical"
        Which flange X is of. ``workspace``: the frames of base and flange in which the arm moves as nearly as can be as
        its model says, over its whole workspace (`workspace_gauge`). The errors of the first joint, the offset of
        the last one and its length along the axis are the same as other base and flange frames.
        ``controller``: they are left out, the flange is where the controller's numbers put it. ``physical``: they are
        declared errors like the others.

    Raises
    ------
    InputError
        Unknown names, negative or infinite standard deviations.

    Examples
    --------
    >>> KinematicErrors("declared", offset_sd="0.02deg", length_sd="0.2mm").standard_deviations["link lengths"]
    0.0002
    """

    how: str = ESTIMATE
    offset_sd: float | str | None = None
    tilt_sd: float | str | None = None
    length_sd: float | str | None = None
    transmission_sd: float | str | None = None
    sag_sd: float | str | None = None
    joint_sd: float | str | None = None
    robot_class: str | None = None
    flange: str = WORKSPACE

    def __post_init__(self) -> None:
        for name, known in (("how", HOW), ("flange", FLANGES)):
            if getattr(self, name) not in known:
                raise InputError(f"Expected `{name}` to be one of {', '.join(known)}, got {getattr(self, name)!r}.")
        if self.robot_class is not None and self.robot_class not in POPULATIONS:
            raise InputError(f"Expected `robot_class` to be one of {', '.join(POPULATIONS)}, got {self.robot_class!r}.")
        for field in fields(self):
            if field.name.endswith("_sd") and (given := getattr(self, field.name)) is not None:
                parse = parse_length if field.name == "length_sd" else parse_angle
                value = parse(given, f"`{field.name}`")
                if not 0 <= value < np.inf:
                    raise InputError(f"Expected `{field.name}` to be finite and >= 0, got {given!r}.")
                object.__setattr__(self, field.name, value)

    @property
    def is_exact(self) -> bool:
        """True if nothing of the arm is uncertain, not even its joints."""
        return self.how == EXACT and not self.joint_sd

    @property
    def class_is_open(self) -> bool:
        """True if the class of the arm is left to the data."""
        declared = any(getattr(self, field.name) is not None for field in fields(self) if field.name.endswith("_sd"))
        return self.how == ESTIMATE and self.robot_class is None and not declared

    @property
    def population(self) -> Population:
        """Population of the robot's class, or the usual one."""
        return POPULATIONS[self.robot_class or USUAL]

    @property
    def standard_deviations(self) -> dict[Kind, float]:
        """Standard deviations by group, rad or m; see ``robot_class``."""
        if self.how == EXACT:
            return dict.fromkeys(DECLARED_AS, 0.0)
        given = {group: getattr(self, name) for group, name in DECLARED_AS.items()}
        alone = self.how == DECLARED and self.robot_class is None and any(sd is not None for sd in given.values())
        usual = {group: 0.0 if alone else getattr(self.population, name) for group, name in DECLARED_AS.items()}
        return {group: usual[group] if sd is None else sd for group, sd in given.items()}

    def terms(
        self, kinematics: Kinematics, q: Array, e: Array | None = None, by_poses: bool = False
    ) -> tuple[ErrorTerm, ...]:
        """Return the errors of measured robot poses at joints q (n, L): one term of each group, and the joint noise.

        Derived at errors e (m,) of the arm where these are not 0. ``by_poses``: the joints are those that reach the
        poses; of more than six the elbow may be elsewhere.
        """
        if self.flange == WORKSPACE:
            counts, F = counting(kinematics), aligned_columns(kinematics, q, e)
        else:
            counts = np.array([self.flange == PHYSICAL or not error.gauge for error in kinematics.errors])
            F = kinematics.columns(q, e)
        by_elbow, moved, own = None, np.zeros((0, len(q))), 0.0
        if by_poses and q.shape[-1] > 6:
            by_elbow = _by_elbow(kinematics, q, self.flange)
            moved, own = _elbow_moves(kinematics.poses(q))
        found = []
        for group, sd in self.standard_deviations.items():
            of = [k for k, error in enumerate(kinematics.errors) if error.group == group and counts[k]]
            if not of or not sd:
                continue
            columns, keys, block = [F[..., of]], [kinematics.errors[k].key for k in of], None
            if self.flange == WORKSPACE:
                columns.append(frame_columns(kinematics, q, group))
                keys += [frame_key(group, k) for k in range(12)]
            if by_elbow is not None:
                D = by_elbow[..., of]
                K = _principal(np.concatenate([D * move[:, None, None] for move in moved], axis=-1), kinematics.reach)
                columns.append(K)
                keys += [ErrorKey(Owner.ROBOT, group, f"elbow elsewhere {k + 1}") for k in range(K.shape[-1])]
                block = own * D
            size = Size(sd, 1.0 if self.how == DECLARED else self.population.factor, UNITS[group])
            together = -np.concatenate(columns, axis=-1)
            found.append(ErrorTerm(ErrorKey(Owner.ROBOT, group), "robot", size, together, block, tuple(keys)))
        size = SIZES[JOINT_NOISE]
        if self.joint_sd is not None:
            size = Size(float(self.joint_sd), 1.0, "rad", "declared")
        if size.median > 0:
            found.append(ErrorTerm(JOINT_NOISE, "robot", size, block=kinematics.jacobian(q, e)))
        return tuple(found)


def _by_elbow(kinematics: Kinematics, q: Array, flange: str) -> Array:
    """(n, 6, m) what the effects of the errors change by per rad that the elbow is elsewhere than at q (n, L).

    Along the motion of the joints that leaves the pose as it is, (L,) of length 1, the same way round at all poses.
    """
    along = np.linalg.svd(kinematics.jacobian(q))[2][..., -1, :]
    along = ELBOW_SD_RAD * along * np.where(along @ np.linalg.svd(along)[2][0] < 0, -1.0, 1.0)[:, None]
    less, more = (
        aligned_columns(kinematics, at) if flange == WORKSPACE else kinematics.columns(at)
        for at in (q - along, q + along)
    )
    return np.asarray(more - less) / (2.0 * ELBOW_SD_RAD)


def _elbow_moves(T: Array) -> tuple[Array, float]:
    """(k, n) how far (rad) the elbow may be elsewhere at poses (n, 4, 4), one standard deviation each; at one of them.

    The same way at all of them, and along the directions in which the poses differ.
    """
    R = Rotation.from_matrix(T[:, :3, :3])
    turn, place = (R.mean().inv() * R).as_rotvec(), T[:, :3, 3] - T[:, :3, 3].mean(axis=0)
    U, size, _ = np.linalg.svd(np.concatenate([turn, place / LEVER_M], axis=-1), full_matrices=False)
    along = np.sqrt(len(T)) * U[:, size > 1e-6 * max(size[0], 1.0)].T
    spread = float(np.sqrt((turn**2).sum(axis=-1).mean()))
    return np.concatenate(
        [np.full((1, len(T)), ELBOW_SD_RAD), ELBOW_SD_ALONG * spread * along]
    ), ELBOW_SD_OF_POSE * spread


def _principal(K: Array, reach: float, left_out: float = 3e-3) -> Array:
    """(n, 6, r) principal columns of (n, 6, m), all but a share of their energy; half of the reach is one rad."""
    rows = (np.repeat([0.5 * reach, 1.0], 3)[:, None] * K).reshape(-1, K.shape[-1])
    energy, axes = np.linalg.eigh(rows.T @ rows)
    return np.asarray(K @ axes[:, energy > left_out * energy.sum()])


def frame_key(group: Kind, k: int) -> ErrorKey:
    """Return the key of a motion of base and flange that the errors of a group leave open (`frames_of`)."""
    return ErrorKey(Owner.ROBOT, group, f"frame {k + 1}")


def poses_with_errors(chain: Kinematics, q: Array, e: Array, flange: str) -> Array:
    """(..., 4, 4) poses at joints q (..., L) with the errors e (m,), in the frames that X is stated in."""
    return aligned_poses(chain, q, e) if flange == WORKSPACE else chain.poses(q, e)


def effects_of_errors(chain: Kinematics, q: Array, e: Array, flange: str) -> Array:
    """(..., 6, m) derivatives of `poses_with_errors` by e, left rotation and additive translation."""
    return aligned_columns(chain, q, e) if flange == WORKSPACE else chain.columns(q, e)
