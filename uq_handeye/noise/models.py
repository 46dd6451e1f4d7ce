r"""Noise models: PairNoise on the motions, PoseNoise on the poses.

Both say: the error ``xi = (theta, tau)`` (rotation first, left rotation, additive translation, rad and m)
of each motion or pose is Gaussian with zero mean and the covariance given, 6x6, independent between robot and
camera. The frames are those of the quantity itself: for ``base_T_gripper`` the base, for
``camera_T_target`` the camera, for ``A`` the gripper, for ``B`` the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..formatting.units import parse_deviations
from ..geometry.se3 import Array
from .camera_noise import CameraNoise
from .joint_covariance import JointCovariance
from .pose_prior import PosePrior
from .square_roots import weighted

Deviations = tuple[str | float, str | float]


def checked_covariance(value: Any, name: str, joint: bool) -> Array:
    """A covariance (6, 6), (n, 6, 6) or, if ``joint``, (6n, 6n): finite, symmetric, positive semidefinite.

    Rounding is forgiven relative to the variances (asymmetry 1e-6 of ``sqrt(S_ii S_jj)``, eigenvalues of the
    correlation matrix down to -1e-8), and removed from what is returned.
    """
    shapes = "(6, 6), (n, 6, 6) or (6n, 6n)" if joint else "(6, 6) or (N, 6, 6)"
    try:
        S = np.array(value, dtype=float, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"Expected the covariance `{name}` to be an array of numbers {shapes}.") from error
    per_item = S.ndim in (2, 3) and S.shape[-2:] == (6, 6) and S.size > 0
    whole = joint and S.ndim == 2 and S.shape[0] == S.shape[1] and S.shape[0] % 6 == 0 and S.shape[0] > 0
    if not (per_item or whole):
        raise InputError(f"Expected the covariance `{name}` to have shape {shapes}, got {S.shape}.")
    if not np.isfinite(S).all():
        raise InputError(f"Expected the covariance `{name}` to be finite, got NaN or infinity.")
    variances = np.diagonal(S, axis1=-2, axis2=-1)
    if (variances < 0).any():
        raise InputError(f"Expected the variances of `{name}` to be >= 0, got {variances.min():.3g}.")
    deviations = np.sqrt(variances)
    if (np.abs(S).max(axis=-1)[deviations == 0] > 0).any():
        raise InputError(
            f"Expected the covariance `{name}` to be positive semidefinite, got a variance of 0 beside a covariance "
            "that is not 0."
        )
    unit = np.where(deviations > 0, deviations, 1.0)
    correlation = S / (unit[..., :, None] * unit[..., None, :])
    asymmetry = np.abs(correlation - correlation.mT).max()
    if asymmetry > 1e-6:
        raise InputError(
            f"Expected the covariance `{name}` to be symmetric, got entries that differ from their mirror images "
            f"by {asymmetry:.2g} of the standard deviations."
        )
    smallest = np.linalg.eigvalsh(0.5 * (correlation + correlation.mT)).min()
    if smallest < -1e-8:
        raise InputError(
            f"Expected the covariance `{name}` to be positive semidefinite, got a correlation matrix with the "
            f"eigenvalue {smallest:.3g}."
        )
    S = np.asarray(0.5 * (S + S.mT))
    S.flags.writeable = False
    return S


def _checked_joint(value: JointCovariance, name: str) -> JointCovariance:
    """Check as `checked_covariance`."""
    if value.own.ndim != 3 or value.shared.ndim != 3:
        raise InputError(f"Expected the covariance `{name}` to be that of one set of poses, got {value.shape}.")
    if not np.isfinite(value.shared).all():
        raise InputError(f"Expected the covariance `{name}` to be finite, got NaN or infinity.")
    return replace(value, own=checked_covariance(value.own, name, joint=False))


@dataclass(frozen=True, eq=False)
class PairNoise:
    """Independent noise on each motion: covariances of ``A`` and ``B``, 6x6 or (N, 6, 6); None is exact.

    ``prior``: what is known of X beforehand, which is a measurement beside the motions (`PosePrior`).
    """

    A: Array | None = None
    B: Array | None = None
    prior: PosePrior | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("A", "B"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, checked_covariance(getattr(self, name), name, joint=False))
        if self.A is None and self.B is None:
            raise InputError("Expected PairNoise to be given at least one of `A` and `B`.")
        _require_prior(self.prior)
        if self.prior is not None and self.prior.W is not None:
            raise InputError("Expected PairNoise to have no prior of W: motions know nothing of W.")

    @cached_property
    def factors(self) -> tuple[Array | None, Array | None]:
        """L with ``A = L L^T`` and the same for B."""
        return (None if self.A is None else factor(self.A), None if self.B is None else factor(self.B))

    def rows(self, index: NDArray[Any]) -> PairNoise:
        """Return the noise of some of the motions, by their numbers or a mask."""
        return replace(self, A=rows_of(self.A, index), B=rows_of(self.B, index))

    def weighted(self, weights: Array) -> PairNoise:
        """Return the noise with the covariance of each motion divided by its weight (N,)."""
        A, B = (None if S is None else np.asarray(weighted(S, weights)) for S in (self.A, self.B))
        return replace(self, A=A, B=B)

    @classmethod
    def isotropic(cls, A: Deviations | None = None, B: Deviations | None = None) -> PairNoise:
        """Build noise from standard deviations (rotation, translation) per axis, e.g. ``A=("0.02deg", "0.05mm")``."""
        return cls(_isotropic(A, "A"), _isotropic(B, "B"))


@dataclass(frozen=True, eq=False)
class PoseNoise:
    """Noise on the absolute poses ``robot = base_T_gripper`` and ``camera = camera_T_target``.

    Either is 6x6 (the same for every pose), (n, 6, 6) (per pose), or (6n, 6n): the joint covariance of all
    poses, pose by pose, for errors that poses share; a `JointCovariance` is such a one whose cost grows with n only.
    None means exact. ``camera`` may be a `CameraNoise`: that which `calibrate` estimates the pixel noise of, and the
    robot's if it is None, unless its ``pixel_sd`` is known.

    ``prior``: what is known of X and W beforehand, which is a measurement beside the poses (`PosePrior`).
    """

    robot: Any = None  # array or JointCovariance
    camera: Any = None  # also CameraNoise, of unknown pixel noise
    prior: PosePrior | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if isinstance(self.camera, CameraNoise) and self.camera.pixel_sd is not None:
            object.__setattr__(self, "camera", self.camera.covariance())
        for name in ("robot", "camera"):
            value = getattr(self, name)
            if value is not None and not (name == "camera" and isinstance(value, CameraNoise)):
                checked = (
                    _checked_joint if isinstance(value, JointCovariance) else partial(checked_covariance, joint=True)
                )
                object.__setattr__(self, name, checked(value, name))
        if self.robot is None and self.camera is None:
            raise InputError("Expected PoseNoise to be given at least one of `robot` and `camera`.")
        _require_prior(self.prior)

    def rows(self, index: NDArray[Any]) -> PoseNoise:
        """Return the noise of some of the poses, by their numbers or a mask; of a joint covariance its marginal."""
        return replace(self, robot=rows_of(self.robot, index), camera=rows_of(self.camera, index))

    def weighted(self, weights: Array) -> PoseNoise:
        """Return the noise with the covariance of each pose, of a joint one its own part, divided by its weight
        (n,).
        """
        robot, camera = (None if S is None else weighted(S, weights) for S in (self.robot, self.camera))
        return replace(self, robot=robot, camera=camera)

    def dense(self) -> PoseNoise:
        """The same with arrays in place of `JointCovariance`: where all of (6n, 6n) is needed."""
        robot, camera = (np.asarray(S) if isinstance(S, JointCovariance) else S for S in (self.robot, self.camera))
        return replace(self, robot=robot, camera=camera)

    @classmethod
    def isotropic(cls, robot: Deviations | None = None, camera: Deviations | None = None) -> PoseNoise:
        """Build noise from standard deviations (rotation, translation) per axis.

        >>> noise = PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("1mrad", "0.5mm"))
        >>> bool(np.allclose(np.sqrt(np.diag(noise.camera)), [1e-3] * 3 + [0.5e-3] * 3))
        True
        """
        return cls(_isotropic(robot, "robot"), _isotropic(camera, "camera"))


Noise = PairNoise | PoseNoise


def _require_prior(prior: Any) -> None:
    if prior is not None and not isinstance(prior, PosePrior):
        raise InputError(f"Expected `prior` of the noise to be a PosePrior or None, got {type(prior).__name__}.")


def with_prior(noise: Noise, prior: PosePrior | None) -> Noise:
    """The noise with what is known of X and W beside it, of motions X alone; as it is where that is None."""
    if prior is None:
        return noise
    known = prior.without_W() if isinstance(noise, PairNoise) else prior
    return replace(noise, prior=known)


def without_prior(noise: Noise) -> Noise:
    """The noise of the data alone."""
    return replace(noise, prior=None)


def _isotropic(value: Deviations | None, name: str) -> Array | None:
    if value is None:
        return None
    rotation, translation = parse_deviations(value, name)
    return np.diag([rotation**2] * 3 + [translation**2] * 3)


def is_joint(covariance: Any) -> bool:
    """Return whether a covariance is the joint one of several poses."""
    return isinstance(covariance, JointCovariance) or (covariance.ndim == 2 and covariance.shape[0] > 6)


def marginals(covariance: Any) -> Array:
    """The covariance of each pose: the diagonal blocks of a joint one, else as it is."""
    if not is_joint(covariance):
        return np.asarray(covariance)
    if isinstance(covariance, JointCovariance):
        return np.asarray(covariance.blocks)
    n = len(covariance) // 6
    return np.asarray(covariance.reshape(n, 6, n, 6)[np.arange(n), :, np.arange(n), :])


def rows_of(covariance: Any, index: NDArray[Any]) -> Any:
    """The covariance of some poses or motions: their own, or their part of a joint one."""
    if covariance is None or covariance.shape == (6, 6):
        return covariance
    if isinstance(covariance, JointCovariance | CameraNoise):
        return covariance.rows(index)
    if not is_joint(covariance):
        return np.asarray(covariance[index])
    n = len(covariance) // 6
    numbers = np.arange(n)[index]
    size = 6 * len(numbers)
    return np.asarray(covariance.reshape(n, 6, n, 6)[numbers][:, :, numbers].reshape(size, size))


def require_count(covariance: Any, count: int, name: str, what: str) -> None:
    """Raise unless ``covariance`` fits ``count`` poses or motions."""
    if isinstance(covariance, CameraNoise):
        covariance = covariance.covariance()  # which says what to do where its pixel noise is not known
    if covariance is None or covariance.shape == (6, 6):
        return
    found = covariance.shape[0] // 6 if covariance.ndim == 2 else covariance.shape[0]
    if found != count:
        raise InputError(f"Expected the covariance `{name}` to cover {count} {what}, got {found}.")


def factor(covariance: Any) -> Array:
    """L with ``covariance = L L^T``, also for singular covariances; (..., k, k) -> (..., k, k)."""
    covariance = np.asarray(covariance)
    try:
        return np.asarray(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:  # only semidefinite
        values, vectors = np.linalg.eigh(covariance)
        return np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None))[..., None, :])
