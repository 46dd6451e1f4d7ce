"""A simulated calibration session with known truth: rig, workspace, noise, seed."""

from __future__ import annotations

from collections.abc import Sequence
from types import NoneType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...core.geometry.checks import as_transforms
from ...core.geometry.frames import SETUPS
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, inverse, perturb, pose
from ...core.presentation.units import parse_angle, parse_length
from ...errors import InputError, keywords_of, require_integer, require_known, require_type
from ...model.errors.cholesky import factor
from ...model.errors.joint_covariance import JointCovariance
from ...model.errors.models import PoseNoise, is_joint, require_count
from ...model.poses.pose_pairs import PosePairs, Truth

# A camera bracket on a flange, and a board on the table in front of the arm.
_CAMERA_ON_GRIPPER = pose(Rotation.from_euler("ZYX", [90, 5, -10], degrees=True).as_matrix(), [0.03, -0.07, 0.05])
_BOARD_ON_TABLE = pose(Rotation.from_euler("z", 20, degrees=True).as_matrix(), [0.6, 0.1, 0.02])
# A camera on a tripod that looks at the arm, and a board screwed to the flange.
_CAMERA_ON_TRIPOD = pose(Rotation.from_euler("ZX", [80, -120], degrees=True).as_matrix(), [1.4, 0.2, 0.8])
_BOARD_ON_GRIPPER = pose(Rotation.from_euler("ZX", [10, 5], degrees=True).as_matrix(), [0.01, 0.02, 0.06])

RIGS = {"eye-in-hand": (_CAMERA_ON_GRIPPER, _BOARD_ON_TABLE), "eye-to-hand": (_CAMERA_ON_TRIPOD, _BOARD_ON_GRIPPER)}


class Scene(NamedTuple):
    """Rig and target of `simulate`, and where the camera looks from."""

    X: ArrayLike | None = None
    W: ArrayLike | None = None
    distance: tuple[str | float, str | float] = ("0.4m", "0.8m")
    tilt: str | float = "35deg"
    roll: str | float = "60deg"

    def rig(self, setup: str) -> list[Array]:
        """Return X and W (4, 4)."""
        return [
            default if given is None else as_transforms(given, name, stack=False)
            for given, default, name in zip((self.X, self.W), RIGS[setup], "XW", strict=True)
        ]

    def views(self, n: int, rng: np.random.Generator) -> Array:
        """``target_T_camera`` (n, 4, 4): back off along -z of a camera that looks at the target's face.

        The azimuth is undone about the line of sight, so that roll alone turns the picture.
        """
        if not isinstance(self.distance, tuple | list) or len(self.distance) != 2:
            raise InputError(f"Expected `distance` to be (nearest, farthest), got {self.distance!r}.")
        nearest, farthest = (parse_length(value, "distance") for value in self.distance)
        if not 0 < nearest <= farthest:
            raise InputError(
                f"Expected `distance` to be (nearest, farthest) with 0 < nearest <= farthest, got {self.distance}."
            )
        tilt, roll = parse_angle(self.tilt, "tilt"), parse_angle(self.roll, "roll")
        if not (0 <= tilt <= np.pi and 0 <= roll <= np.pi):
            raise InputError(
                f"Expected `tilt` and `roll` between 0 and 180 degrees, got {self.tilt!r} and {self.roll!r}."
            )
        away = rng.uniform(nearest, farthest, n)
        limits: tuple[tuple[float, float], ...] = ((-np.pi, np.pi), (0, tilt), (-np.pi, np.pi), (-roll, roll))
        angles = np.stack([rng.uniform(*ends, n) for ends in limits], axis=1)
        angles[:, 2] = -angles[:, 0] + angles[:, 3]
        looking = Rotation.from_euler("ZYZ", angles[:, :3]) * Rotation.from_euler("x", np.pi)
        aim = rng.uniform(-0.1, 0.1, (n, 3)) * away[:, None]
        return pose(looking.as_matrix(), aim - away[:, None] * looking.as_matrix()[..., 2])


def simulate(
    n_poses: int = 20,
    *,
    noise: PoseNoise | None = None,
    setup: str = "eye-in-hand",
    trials: int | None = None,
    seed: int | Sequence[int] | np.random.SeedSequence | np.random.Generator = 0,
    **scene: Any,
) -> PosePairs:
    """Poses of a robot that looks at a target from many sides, with noise, and their truth.

    The camera looks at the target within a cone about the target's z axis: distance and tilt of the line of
    sight, azimuth and roll about the optical axis are drawn uniformly; the line of sight misses the
    target's origin by up to a tenth of the distance. Measured poses are
    ``R = exp([theta]x) R_true``, ``t = t_true + tau`` with ``xi = (theta, tau)`` drawn from ``noise``.

    Parameters
    ----------
    n_poses : int
    noise : PoseNoise or None
        None is exact data.
    setup : "eye-in-hand" or "eye-to-hand"
    X : (4, 4) or None
        The rig: ``gripper_T_camera``, or ``base_T_camera`` for eye-to-hand.
    W : (4, 4) or None
        The target: ``base_T_target``, or ``gripper_T_target`` for eye-to-hand.
    distance : (nearest, farthest)
        Camera to target, metres or text with units.
    tilt : float or str
        Largest angle between line of sight and target normal, at most 180 degrees.
    roll : float or str
        Largest roll of the camera about its line of sight, either way.
    trials : int or None
        Number of independent noise draws on the same true poses, as a leading axis; None is one without it.
    seed : int, sequence of int, SeedSequence or numpy Generator

    Returns
    -------
    PosePairs with ``truth`` (X, W and the poses without noise).

    Raises
    ------
    InputError
        A number, range or noise model that cannot be used, with the name of the argument.
    """
    require_known("simulate", scene, Scene)
    taken = Scene(**scene)
    if setup not in SETUPS:
        raise InputError(f"Expected `setup` to be one of {', '.join(SETUPS)}, got {setup!r}.")
    require_integer("n_poses", n_poses, 1)
    if trials is not None:
        require_integer("trials", trials, 1)
    try:
        rng = np.random.default_rng(seed)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"Expected `seed` to be what numpy.random.default_rng takes, got {seed!r}: {error}."
        ) from error
    require_type("noise", noise, (PoseNoise, NoneType), "PoseNoise or None")
    X_true, W_true = taken.rig(setup)
    target_T_camera = taken.views(n_poses, rng)
    camera = inverse(target_T_camera)
    robot = W_true @ target_T_camera @ inverse(X_true)
    if setup == "eye-to-hand":
        robot = inverse(robot)
    truth = Truth(X_true.copy(), W_true.copy(), robot, camera)
    if noise is not None:
        batch = () if trials is None else (trials,)
        require_count(noise.robot, n_poses, "robot", "poses")
        require_count(noise.camera, n_poses, "camera", "poses")
        robot = disturbed(robot, noise.robot, batch, rng)
        camera = disturbed(camera, noise.camera, batch, rng)
    elif trials is not None:
        robot, camera = (np.broadcast_to(T, (trials, *T.shape)) for T in (robot, camera))
    return PosePairs(robot, camera, setup, np.arange(float(n_poses)), truth)


simulate.__signature__ = keywords_of(simulate, Scene)  # type: ignore[attr-defined]


def disturbed(
    T: Array, covariance: Array | JointCovariance | None, batch: tuple[int, ...], rng: np.random.Generator
) -> Array:
    """Exact poses or motions (n, 4, 4) with noise drawn on them (`PoseNoise`, `PairNoise`): (*batch, n, 4, 4)."""
    if covariance is None:
        return np.array(np.broadcast_to(T, (*batch, len(T), 4, 4)))
    if isinstance(covariance, JointCovariance):
        own = (factor(covariance.own) @ rng.standard_normal((*batch, len(T), 6, 1)))[..., 0]
        common = rng.standard_normal((*batch, covariance.shared.shape[-1])) @ covariance.flat.T
        errors = own + common.reshape(own.shape)
        return perturb(T, errors)
    return moved(T, factor(covariance), rng.standard_normal((*batch, 6 * len(T))))


def moved(T: Array, L: Array, z: Array) -> Array:
    """Poses or motions (n, 4, 4) with the errors ``L z`` of standard normal z (..., 6n): (..., n, 4, 4).

    L is a factor of the covariance of each, (6, 6) or (n, 6, 6), or of the joint one (6n, 6n).
    """
    by_item = (*z.shape[:-1], len(T), 6)
    xi = (z @ L.T).reshape(by_item) if is_joint(L) else (L @ z.reshape(*by_item, 1))[..., 0]
    return perturb(T, xi)
