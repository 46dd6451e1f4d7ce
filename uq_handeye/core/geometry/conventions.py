r"""Covariances of a pose in the conventions of other libraries: one table, and the conversions that follow from it.

The toolkit: ``xi = (theta, tau)``, ``R = exp([theta]x) R_hat``, ``t = t_hat + tau``: rotation first, left
rotation, additive translation, rad and the length unit of t. To first order the coordinates of another library are
``J xi``, and their covariance is ``J S J^T``. J follows from five properties of a library (`Convention`):

- *order*: rotation or translation first;
- *axes* of the rotation: the parent's (left, ``exp([theta]x) R``), the child's (right, ``R exp([R^T theta]x)``), or
  the child's with the sign of the inverse rotation;
- *translation*: ``t + tau``, ``t + R tau``, or that of a left twist, ``Exp(xi) T``: ``rho = tau + [t]x theta``;
- *angle*: a rotation vector, half of one (the vector part of a quaternion), the change of the rotation vector of R
  itself, ``J_l(rvec)^-1 theta``, or of yaw, pitch and roll;
- *factor*: whether the numbers contain the noise of the data, or are those of a unit noise.

Libraries of the same J are one class: data cannot distinguish them, and each can be read by the name of the other. The
matrices J were measured on the libraries, in the versions of the table (`studies/conventions`). Conversions are
explicit, never implied.

The convention ``paper`` writes Sigma_R (58) and Sigma_t (59) of Wu et al. as diagonal blocks, ``Sigma_R = <dR dR^T> =
tr(Sigma_theta) I - Sigma_theta``, and ``<theta tau^T>`` beside them; it is the covariance of no six coordinates.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError, require_one_of
from ..rounding import SOLUTION_ROUNDING
from .checks import as_transforms, checked_covariance
from .se3 import Array, block, inverse, inverse_jacobian, left_jacobian, logarithm, skew

# In words, for files and reports: that of (theta, tau) in the parent frame of a pose, and that of X.
TOOLKIT = (
    "(theta, tau): R = exp([theta]x) R_hat, t = t_hat + tau; rotation first, left rotation, additive "
    "translation; rad and m; in the parent frame"
)
CONVENTION = f"xi = {TOOLKIT} of X"
# The six components of an error xi, for people.
COMPONENTS = ("rotation x", "rotation y", "rotation z", "translation x", "translation y", "translation z")
# Which pose a covariance is of: the pose itself, or its inverse.
OF_POSE = ("pose", "inverse")

_EYE = np.eye(3)
_SWAP = np.roll(np.eye(6), 3, axis=1)


class Convention(NamedTuple):
    """Meaning of the six numbers of a pose's error in a library, and the version in which that was measured."""

    name: str
    order: Literal["rotation, translation", "translation, rotation"]
    axes: Literal["parent", "child", "child, minus"]
    translation: Literal["t + tau", "t + R tau", "left twist"]
    angle: Literal["theta", "theta / 2", "rotation vector", "yaw, pitch, roll", "Sigma_R"] = "theta"
    factor: str = "as declared"
    source: str = ""  # library, version and function that it was measured with, or the definition
    has_noise: bool = False  # the numbers contain the noise of the data, and no `pixel_sd` multiplies them

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The properties that J follows from: equal for libraries of one class."""
        return self.order, self.axes, self.translation, self.angle

    @property
    def words(self) -> str:
        """Description of the six numbers, for people."""
        if self.name == "toolkit":
            return TOOLKIT
        first, second = self.order.split(", ")
        angle = {"theta": "theta in rad", "rotation vector": "the rotation vector of R in rad"}.get(
            self.angle, self.angle
        )
        own = "" if self.angle in ("rotation vector", "yaw, pitch, roll") else f" in the axes of the {self.axes}"
        return f"{self.name}: {first} first, then {second}; {angle}{own}; translation {self.translation} in m"

    def jacobian(self, T: Array) -> Array:
        """``d(coordinates) / d xi`` at ``T`` (..., 4, 4): (..., 6, 6)."""
        R, t = T[..., :3, :3], T[..., :3, 3]
        own = R.mT
        match self.angle:
            case "rotation vector":
                rotation = np.linalg.inv(left_jacobian(logarithm(R)))
            case "yaw, pitch, roll":
                rotation = _yaw_pitch_roll(R)
            case _:
                half = 0.5 if self.angle == "theta / 2" else 1.0
                rotation = half * {"parent": _EYE, "child": own, "child, minus": -own}[self.axes]
        twist = skew(t) if self.translation == "left twist" else 0.0
        J = block(rotation, 0.0, twist, own if self.translation == "t + R tau" else _EYE)
        J = np.broadcast_to(J, (*T.shape[:-2], 6, 6))
        return np.asarray(_SWAP @ J if self.order.startswith("translation") else J)


def _yaw_pitch_roll(R: Array) -> Array:
    """``d(yaw, pitch, roll) / d theta`` of ``R = Rz(yaw) Ry(pitch) Rx(roll)``: the axes of the three are the columns of
    its inverse.
    """
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    zero = np.zeros_like(yaw)
    z = np.broadcast_to([0.0, 0.0, 1.0], R.shape[:-1])
    axes = np.stack([z, np.stack([-np.sin(yaw), np.cos(yaw), zero], axis=-1), R[..., 0]], axis=-1)
    if (np.abs(np.linalg.det(axes)) < 1e-6).any():  # the cosine of the pitch
        raise InputError("Expected a pitch that is not 90 deg: there yaw and roll turn about one axis.")
    return np.asarray(np.linalg.inv(axes))


_FIRST_R: Final = "rotation, translation"
_FIRST_T: Final = "translation, rotation"
_UNIT_POINT = "variance of a point 1 m^2"

# Every convention by its name; the first of a class names it.
CONVENTIONS: dict[str, Convention] = {
    one.name: one
    for one in (
        Convention("toolkit", _FIRST_R, "parent", "t + tau", source="uq-handeye"),
        Convention("ros", _FIRST_T, "parent", "t + tau", source="PoseWithCovariance, tf2_geometry_msgs 0.7.6"),
        Convention("napa", _FIRST_T, "parent", "t + tau", source="napa-vision 0.4.1, camera_to_tag"),
        Convention("se3-right", _FIRST_R, "child", "t + R tau", source="T Exp(xi)"),
        Convention("gtsam", _FIRST_R, "child", "t + R tau", source="gtsam 4.3.0, Pose3"),
        Convention("small-gicp", _FIRST_R, "child", "t + R tau", "theta", _UNIT_POINT,
            "small_gicp 1.0.1, RegistrationResult.H", has_noise=True),
        Convention("manif", _FIRST_T, "child", "t + R tau", source="manif, SE3"),
        Convention("sophus", _FIRST_T, "child", "t + R tau", source="sophuspy 1.2.0, log"),
        Convention("jaxlie", _FIRST_T, "child", "t + R tau", source="jaxlie 1.5.0, SE3"),
        Convention("g2o", _FIRST_T, "child", "t + R tau", "theta / 2", source="g2o-python 0.0.12, EDGE_SE3:QUAT"),
        Convention("se3-left", _FIRST_R, "parent", "left twist", source="Exp(xi) T"),
        Convention("open3d", _FIRST_R, "parent", "left twist", "theta", _UNIT_POINT,
            "open3d 0.20.0, get_information_matrix_from_point_clouds", has_noise=True),
        Convention("pytransform3d", _FIRST_R, "parent", "left twist", source="pytransform3d 3.17.0, uncertainty"),
        Convention("pypose", _FIRST_T, "parent", "left twist", source="pypose 0.9.5, Retr"),
        Convention("symforce", _FIRST_R, "child", "t + tau", source="symforce 0.12.0, Pose3"),
        Convention("calibsense", _FIRST_R, "child", "t + tau", source="calibsense 0.1.0a1, both signs minus"),
        Convention("opencv", _FIRST_R, "parent", "t + tau", "rotation vector", "pixel noise included",
            "OpenCV 4.14 and 5.0, stdDeviationsExtrinsics", has_noise=True),
        Convention("pycolmap", _FIRST_R, "parent", "t + tau", "theta / 2", "pixel sd 1",
            "pycolmap 4.2.1, cov of cam_from_world"),
        Convention("factorama", _FIRST_T, "child, minus", "t + tau",
            source="factorama 1.1.1, PoseVariable as world_T_camera"),
        Convention("mrpt", _FIRST_T, "parent", "t + tau", "yaw, pitch, roll", source="MRPT 2.5.8, CPose3DPDFGaussian"),
        Convention("paper", _FIRST_R, "parent", "t + tau", "Sigma_R", source="Wu et al., equation 58"),
    )
}  # fmt: skip


def convention_of(name: str) -> Convention:
    """Return the convention of a name; raises `InputError` with the names there are."""
    if name not in CONVENTIONS:
        near = difflib.get_close_matches(str(name), CONVENTIONS, 1)
        guess = f" Did you mean {near[0]!r}?" if near else ""
        raise InputError(f"Unknown convention {name!r:.40}; expected one of {', '.join(CONVENTIONS)}.{guess}")
    return CONVENTIONS[name]


def same_class(name: str) -> list[str]:
    """Return the names of all conventions with the J of this one, in the order of the table.

    >>> same_class("small-gicp")
    ['se3-right', 'gtsam', 'small-gicp']
    """
    of = convention_of(name).coordinates
    return [one.name for one in CONVENTIONS.values() if one.coordinates == of]


def paper_from_theta(Sigma_theta: ArrayLike) -> Array:
    """``Sigma_R = <dR dR^T> = tr(Sigma_theta) I - Sigma_theta`` from the covariance of the rotation vector."""
    S = np.asarray(Sigma_theta, dtype=float)
    return np.asarray(np.trace(S, axis1=-2, axis2=-1)[..., None, None] * _EYE - S)


def theta_from_paper(Sigma_R: ArrayLike) -> Array:
    """``Sigma_theta = tr(Sigma_R)/2 I - Sigma_R``: the inverse of `paper_from_theta`."""
    S = np.asarray(Sigma_R, dtype=float)
    return np.asarray(0.5 * np.trace(S, axis1=-2, axis2=-1)[..., None, None] * _EYE - S)


@dataclass(frozen=True)
class CovarianceReading:
    """Reading of numbers as a covariance of poses: the convention, and whether they are of the inverse poses.

    ``information``: the numbers are the inverse of a covariance. ``pixel_sd``: the standard deviation of a pixel (px)
    where the numbers are those of a unit noise.
    """

    convention: str = "toolkit"
    inverse: bool = False
    information: bool = False
    pixel_sd: float | None = None

    def __post_init__(self) -> None:
        of = convention_of(self.convention)
        if self.pixel_sd is None:
            return
        if of.has_noise:
            raise InputError(
                f"Expected no `pixel_sd` beside the convention {of.name!r}, whose numbers have a factor of their own "
                f"({of.factor}). Remove it."
            )
        if not 0 < self.pixel_sd < np.inf:
            raise InputError(f"Expected `pixel_sd` to be a standard deviation above 0 px, got {self.pixel_sd!r}.")

    @classmethod
    def parse(cls, text: str) -> CovarianceReading:
        """Return the reading of a text ``NAME[,information][,inverse][,pixel_sd=0.2]``.

        >>> CovarianceReading.parse("g2o,information")
        CovarianceReading(convention='g2o', inverse=False, information=True, pixel_sd=None)
        """
        name, *rest = (part.strip() for part in text.split(","))
        pixel_sd: float | None = None
        for part in rest:
            key, _, value = part.partition("=")
            if key.strip() == "pixel_sd":
                try:
                    pixel_sd = float(value.strip().removesuffix("px"))
                except ValueError:
                    raise InputError(f"Expected pixel_sd to be a number of pixels, got {value!r:.40}.") from None
            elif part not in ("information", "inverse"):
                raise InputError(
                    f"Expected NAME, information, inverse and pixel_sd=0.2 with commas between, got {part!r:.40}."
                )
        return cls(name, "inverse" in rest, "information" in rest, pixel_sd)

    @property
    def is_plain(self) -> bool:
        """True if the numbers are of the coordinates of the toolkit, and of the pose itself."""
        return self.convention == "toolkit" and not self.inverse

    @cached_property
    def words(self) -> str:
        """The text that `parse` reads."""
        parts = [self.convention, *["information"] * self.information, *["inverse"] * self.inverse]
        return ",".join([*parts, *([] if self.pixel_sd is None else [f"pixel_sd={self.pixel_sd:g}"])])

    def jacobian(self, T: Array) -> Array:
        """``d(coordinates of the numbers) / d xi`` at ``T`` (..., 4, 4): (..., 6, 6)."""
        of = CONVENTIONS[self.convention]
        return of.jacobian(inverse(T)) @ inverse_jacobian(T) if self.inverse else of.jacobian(T)

    def read(self, numbers: ArrayLike, T: ArrayLike, name: str = "covariance") -> Array:
        """Return the covariance of the poses ``T`` in the toolkit's convention.

        Parameters
        ----------
        numbers : (..., 6, 6), or (6n, 6n) for the joint covariance of the n poses ``T``
        T : (..., 4, 4)
            The poses that the covariance returned is of; those whose inverse it is given of, where it is.
        name : what messages call it
        """
        T = as_transforms(T, "T", stack=False)
        S = np.asarray(_inverted(numbers, name) if self.information else numbers, dtype=float)
        _check(S, T, name, positive=self.convention != "paper")
        S = S if self.pixel_sd is None else self.pixel_sd**2 * S
        if self.convention == "paper":
            S = _with_rotation(S, theta_from_paper)
            return _moved(S, inverse_jacobian(inverse(T))) if self.inverse else S
        return S if self.is_plain else _moved(S, np.asarray(np.linalg.inv(self.jacobian(T)), dtype=float))

    def write(self, covariance: ArrayLike, T: ArrayLike, name: str = "covariance") -> Array:
        """Return the numbers of the toolkit's covariance of the poses ``T``: undoes `read`."""
        T = as_transforms(T, "T", stack=False)
        S = np.asarray(covariance, dtype=float)
        _check(S, T, name)
        S = S if self.pixel_sd is None else S / self.pixel_sd**2
        if self.convention == "paper":
            S = _with_rotation(_moved(S, inverse_jacobian(T)) if self.inverse else S, paper_from_theta)
        elif not self.is_plain:
            S = _moved(S, self.jacobian(T))
        return _inverted(S, name) if self.information else S


def _with_rotation(S: Array, change: Callable[[Array], Array]) -> Array:
    S = S.copy()
    S[..., :3, :3] = change(S[..., :3, :3])
    return S


def _moved(S: Array, J: Array) -> Array:
    """``J S J^T``; of a joint covariance (6n, 6n) with the n blocks of J."""
    if S.shape[-2:] == (6, 6):
        return np.asarray(J @ S @ J.mT)
    n = len(J)
    blocks = S.reshape(n, 6, n, 6)
    return np.asarray(np.einsum("iab,ibjc,jdc->iajd", J, blocks, J).reshape(6 * n, 6 * n))


def _check(S: Array, T: Array, name: str, positive: bool = True) -> None:
    """Raise `InputError` unless ``S`` is a covariance of the poses ``T``."""
    joint = T.ndim == 3 and S.shape == (6 * len(T), 6 * len(T))
    if S.shape[-2:] != (6, 6) and not joint:
        raise InputError(f"Expected `{name}` to have shape (..., 6, 6), got {S.shape}.")
    if not joint:
        try:
            np.broadcast_shapes(S.shape[:-2], T.shape[:-2])
        except ValueError:
            raise InputError(
                f"Expected one `{name}` for all poses or one for each, got {S.shape[:-2]} for {T.shape[:-2]} poses."
            ) from None
    if positive:
        checked_covariance(S if joint else S.reshape(-1, 6, 6), name, joint=joint)
    elif not np.isfinite(S).all() or np.abs(S - S.mT).max(initial=0.0) > 1e-6 * np.abs(S).max(initial=0.0):
        raise InputError(f"Expected `{name}` to be finite and symmetric.")


def _inverted(numbers: ArrayLike, name: str) -> Array:
    """The inverse of an information matrix, or of a covariance; raises `InputError` where it is singular."""
    L = np.asarray(numbers, dtype=float)
    if L.ndim < 2 or L.shape[-1] != L.shape[-2] or not np.isfinite(L).all():
        raise InputError(f"Expected `{name}` to be finite numbers (..., 6, 6), got shape {L.shape}.")
    d = np.sqrt(np.maximum(np.diagonal(L, axis1=-2, axis2=-1), 0.0))
    d = np.where(d > 0, d, 1.0)
    unit = L / (d[..., :, None] * d[..., None, :])
    if np.abs(unit - unit.mT).max(initial=0.0) > 1e-6:
        raise InputError(f"Expected `{name}` to be symmetric.")
    if np.linalg.eigvalsh(unit).min(initial=1.0) < SOLUTION_ROUNDING:
        raise InputError(
            f"Expected `{name}` to be an information matrix that can be inverted, got one that is singular or "
            "indefinite: a direction without information has no covariance."
        )
    S = np.linalg.inv(unit) / (d[..., :, None] * d[..., None, :])
    return np.asarray(0.5 * (S + S.mT))


def jacobian(T: ArrayLike, convention: str) -> Array:
    """``d(coordinates of the convention) / d xi`` at ``T`` (..., 4, 4): (..., 6, 6)."""
    of = convention_of(convention)
    if of.angle == "Sigma_R":
        raise InputError("The convention 'paper' has no Jacobian: it is the covariance of no six coordinates.")
    return of.jacobian(as_transforms(T, "T", stack=False))


def to_convention(
    covariance: ArrayLike, T: ArrayLike, convention: str, *, information: bool = False, of: str = "pose"
) -> Array:
    """The toolkit's 6x6 covariance of the pose ``T`` in another convention.

    Parameters
    ----------
    covariance : (..., 6, 6), or the joint covariance (6n, 6n) of n poses
    T : (..., 4, 4)
    convention : a name in `conventions.CONVENTIONS`
    information : return the inverse of the covariance
    of : "pose" or "inverse": which pose the result is of

    >>> S = np.diag([1.0, 2, 3, 4, 5, 6])
    >>> np.diag(to_convention(S, np.eye(4), "ros")).tolist()
    [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]
    """
    require_one_of("of", of, OF_POSE)
    return CovarianceReading(convention, of == "inverse", information).write(covariance, T)


def from_convention(
    covariance: ArrayLike,
    T: ArrayLike,
    convention: str,
    *,
    information: bool = False,
    pixel_sd: float | None = None,
    of: str = "pose",
) -> Array:
    """The covariance of the pose ``T``, given in another convention, in the toolkit's: undoes `to_convention`.

    Parameters
    ----------
    covariance : (..., 6, 6), or the joint covariance (6n, 6n) of n poses
    T : (..., 4, 4)
        The poses that the result is of, also where ``of`` is "inverse".
    convention : a name in `conventions.CONVENTIONS`
    information : the numbers are an information matrix, the inverse of a covariance
    pixel_sd : standard deviation of a pixel (px) where the numbers are those of a pixel noise of 1
    of : "pose" or "inverse": which pose the numbers are of

    Raises
    ------
    InputError
        An unknown convention; numbers that are not symmetric, not positive semidefinite or of another size; an
        information matrix that is singular; ``pixel_sd`` beside a convention that has a factor of its own.

    >>> S = from_convention(np.diag([1e4, 1e4, 1e4, 400, 400, 400]), np.eye(4), "g2o", information=True)
    >>> np.sqrt(np.diag(S)).round(3).tolist()
    [0.1, 0.1, 0.1, 0.01, 0.01, 0.01]
    """
    require_one_of("of", of, OF_POSE)
    return CovarianceReading(convention, of == "inverse", information, pixel_sd).read(covariance, T)
