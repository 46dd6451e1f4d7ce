"""Noise models: PairNoise on the motions, PoseNoise on the poses.

In both, the error ``xi = (theta, tau)`` (rotation first, left rotation, additive translation, rad and m)
of each motion or pose is Gaussian with zero mean and the covariance given, 6x6, independent between robot and
camera. The frames are those of the quantity itself: for ``base_T_gripper`` the base, for
``camera_T_target`` the camera, for ``A`` the gripper, for ``B`` the camera.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Literal, Self, cast

import numpy as np
from numpy.typing import ArrayLike

from ...core.files.json_values import JsonObject
from ...core.files.records import Record
from ...core.files.tree_values import is_map
from ...core.geometry.checks import checked_covariance
from ...core.geometry.conventions import CovarianceReading
from ...core.geometry.se3 import Array
from ...core.presentation.document import Block, Document, Paragraph, Table, document_of
from ...core.presentation.html import html_of
from ...core.presentation.numbers import digits
from ...core.presentation.units import parse_deviations
from ...errors import InputError
from .camera_noise import CameraNoise
from .cholesky import factor
from .joint_covariance import Index, JointCovariance
from .pose_prior import PosePrior
from .square_roots import Covariance, rows_of, weighted
from .square_roots import is_joint as is_joint
from .square_roots import marginals as marginals

Deviations = tuple[str | float, str | float]

# Relative difference of standard deviations up to which one number describes all three axes.
MAX_DIFFERENCE_OF_AXES = 0.01
# Correlation of the components of an error above which it is mentioned.
MIN_MENTIONED_CORRELATION = 0.05


def _checked_side(value: Any, name: str) -> Any:
    """Check as `checked_covariance`, or as a `JointCovariance` and `CameraNoise` check themselves."""
    check = getattr(value, "checked", None)
    return checked_covariance(value, name, joint=True) if check is None else check(name)


class _TwoSides(Record):
    """Common part of noise on motions and on poses: a covariance for each of two ``SIDES``, and a prior."""

    SIDES: ClassVar[tuple[str, str]]
    ITEM: ClassVar[str]
    _if_any: ClassVar[str] = "prior"

    prior: PosePrior | None

    @property
    def sides(self) -> dict[str, Any]:
        """Covariances by name."""
        return {name: getattr(self, name) for name in self.SIDES}

    def _checked(self, check: Callable[[Any, str], Any]) -> None:
        for name, value in self.sides.items():
            if value is not None:
                object.__setattr__(self, name, check(value, name))
        if all(value is None for value in self.sides.values()):
            first, second = self.SIDES
            raise InputError(f"Expected {type(self).__name__} to be given at least one of `{first}` and `{second}`.")
        if self.prior is not None and not isinstance(self.prior, PosePrior):
            got = type(self.prior).__name__
            raise InputError(f"Expected `prior` of the noise to be a PosePrior or None, got {got}.")

    def _with(self, sides: dict[str, Any]) -> Self:
        return cast(Self, replace(cast(Any, self), **sides))

    def rows(self, index: Index) -> Self:
        """Return the noise of some of the poses or motions, by their numbers or a mask; of a joint covariance its
        marginal.
        """
        return self._with({name: None if S is None else rows_of(S, index) for name, S in self.sides.items()})

    def weighted(self, weights: Array) -> Self:
        """Return the noise with the covariance of each pose or motion, of a joint one its own part, divided by its
        weight (n,).
        """
        return self._with({name: None if S is None else weighted(S, weights) for name, S in self.sides.items()})

    def dense(self) -> Self:
        """The same with arrays in place of `JointCovariance`: where all of (6n, 6n) is needed."""
        joint = {name: np.asarray(S) for name, S in self.sides.items() if isinstance(S, JointCovariance)}
        return self._with(self.sides | joint)

    def without_columns(self) -> Self:
        """Return the same with what each pose has by itself in place of each `JointCovariance`."""
        own = {name: JointCovariance.of_each(S.own) for name, S in self.sides.items() if isinstance(S, JointCovariance)}
        return self._with(self.sides | own) if own else self

    def __repr__(self) -> str:
        sizes = {name: dict.fromkeys(size_words(S)) for name, S in self.sides.items()}
        text = "; ".join(f"{name}: {', '.join(size)}" for name, size in sizes.items())
        return f"{type(self).__name__}({text}{'' if self.prior is None else '; with a prior'})"

    def _repr_html_(self) -> str:
        """Return the noise as a table, for notebooks."""
        return html_of(self)


@dataclass(frozen=True, eq=False, repr=False)
class PairNoise(_TwoSides):
    """Independent noise on each motion: covariances of ``A`` and ``B``, 6x6 or (N, 6, 6); None is exact.

    ``prior``: what is known of X beforehand, which counts as a measurement like the motions (`PosePrior`).
    """

    SIDES: ClassVar[tuple[str, str]] = ("A", "B")
    ITEM: ClassVar[Literal["motion"]] = "motion"
    _in_file: ClassVar[str] = "type=__class__.__name__ A B prior"

    A: Array | None = None
    B: Array | None = None
    prior: PosePrior | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        self._checked(partial(checked_covariance, joint=False))
        if self.prior is not None and self.prior.W is not None:
            raise InputError("Expected PairNoise to have no prior of W: motions know nothing of W.")

    @cached_property
    def factors(self) -> tuple[Array | None, Array | None]:
        """L with ``A = L L^T`` and the same for B."""
        return (None if self.A is None else factor(self.A), None if self.B is None else factor(self.B))

    @classmethod
    def isotropic(cls, A: Deviations | None = None, B: Deviations | None = None) -> PairNoise:
        """Build noise from standard deviations (rotation, translation) per axis, e.g. ``A=("0.02deg", "0.05mm")``."""
        return cls(_isotropic(A, "A"), _isotropic(B, "B"))


@dataclass(frozen=True, eq=False, repr=False)
class PoseNoise(_TwoSides):
    """Noise on the absolute poses ``robot = base_T_gripper`` and ``camera = camera_T_target``.

    Either is 6x6 (the same for every pose), (n, 6, 6) (per pose), or (6n, 6n): the joint covariance of all
    poses, pose by pose, for errors that poses share; a `JointCovariance` is such a one whose cost grows with n only.
    None means exact. ``camera`` may be a `CameraNoise`: that which `calibrate` estimates the pixel noise of, and the
    robot's if it is None, unless its ``pixel_sd`` is known.

    ``prior``: what is known of X and W beforehand, which counts as a measurement like the poses (`PosePrior`).
    ``read_as``: how the covariance of a side was read where it was stated in a convention of another library; the
    numbers here are those of the toolkit. `calibrate` reads them in other ways where they do not fit.
    """

    SIDES: ClassVar[tuple[str, str]] = ("robot", "camera")
    ITEM: ClassVar[Literal["pose"]] = "pose"
    _in_file: ClassVar[str] = "type=__class__.__name__ robot camera prior"

    robot: Any = None  # array or JointCovariance
    camera: Any = None  # also CameraNoise, of unknown pixel noise
    prior: PosePrior | None = field(default=None, kw_only=True)
    read_as: Mapping[str, CovarianceReading] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        self._checked(_checked_side)

    @classmethod
    def isotropic(cls, robot: Deviations | None = None, camera: Deviations | None = None) -> PoseNoise:
        """Build noise from standard deviations (rotation, translation) per axis.

        >>> noise = PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("1mrad", "0.5mm"))
        >>> bool(np.allclose(np.sqrt(np.diag(noise.camera)), [1e-3] * 3 + [0.5e-3] * 3))
        True
        """
        return cls(_isotropic(robot, "robot"), _isotropic(camera, "camera"))


Noise = PairNoise | PoseNoise


def with_prior(noise: Noise, prior: PosePrior | None) -> Noise:
    """Return the noise with a prior of X and W, of motions of X only; the noise as it is without a prior."""
    if prior is None:
        return noise
    return replace(noise, prior=prior if noise.ITEM == "pose" else prior.without_W())


def without_prior(noise: Noise) -> Noise:
    """The noise of the data only."""
    return replace(noise, prior=None)


def _isotropic(value: Deviations | None, name: str) -> Array | None:
    if value is None:
        return None
    rotation, translation = parse_deviations(value, name)
    return np.diag([rotation**2] * 3 + [translation**2] * 3)


def is_of_each(covariance: Covariance | None) -> bool:
    """Return whether the poses have covariances of their own."""
    return covariance is not None and (is_joint(covariance) or np.ndim(covariance) == 3)


def size_words(covariance: Covariance | CameraNoise | None) -> tuple[str, str]:
    """Return standard deviations per axis of rotation and translation as text, of many poses their medians."""
    if covariance is None:
        return "exact", "exact"
    joint = covariance.joint if isinstance(covariance, CameraNoise) else covariance
    variances = np.diagonal(marginals(joint), axis1=-2, axis2=-1)
    std = np.median(np.sqrt(np.maximum(variances, 0.0)).reshape(-1, 6), axis=0)
    return _axes(np.degrees(std[:3]), "deg"), _axes(1e3 * std[3:], "mm")


def _axes(std: Array, unit: str) -> str:
    if std.max() - std.min() <= MAX_DIFFERENCE_OF_AXES * std.max():
        return f"{digits(float(std.mean()), 2)} {unit}"
    return f"{', '.join(f'{name} {digits(float(value), 2)}' for name, value in zip('xyz', std, strict=True))} {unit}"


def require_count(covariance: Covariance | CameraNoise | None, count: int, name: str, what: str) -> None:
    """Raise unless ``covariance`` fits ``count`` poses or motions."""
    if isinstance(covariance, CameraNoise):
        covariance = covariance.covariance()  # which says what to do where its pixel noise is not known
    if covariance is None or covariance.shape == (6, 6):
        return
    found = covariance.shape[0] // 6 if covariance.ndim == 2 else covariance.shape[0]
    if found != count:
        raise InputError(f"Expected the covariance `{name}` to cover {count} {what}, got {found}.")


def noise_to_dict(noise: Noise | None) -> JsonObject | None:
    """Type and covariances as plain numbers."""
    return None if noise is None else noise.to_dict()


def noise_from_dict(data: dict[str, Any]) -> Noise:
    """The inverse of `noise_to_dict`."""
    prior = None if data.get("prior") is None else PosePrior.from_dict(data["prior"])
    if data["type"] == "PairNoise":
        return PairNoise(data["A"], data["B"], prior=prior)
    sides = (data[name] for name in ("robot", "camera"))
    return PoseNoise(*(JointCovariance.from_dict(S) if is_map(S) else S for S in sides), prior=prior)


@document_of.register(_TwoSides)
def noise_document(noise: _TwoSides) -> Document:
    """Return a table with a row per side, and what all poses share."""
    rows = [[name, *size_words(side), _extent(side, noise.ITEM)] for name, side in noise.sides.items()]
    caption = f"Noise of each {noise.ITEM}, 1 sigma per axis"
    table = Table(caption, ["", "rotation", "translation", "holds for"], rows, frozenset({1, 2, 3}))
    notes: list[Block] = [Paragraph(text) for name, side in noise.sides.items() for text in _notes(name, side)]
    if noise.prior is not None:
        notes.append(Paragraph("A prior of X or W is part of it."))
    return [[table, *notes]]


def _notes(name: str, covariance: Any) -> list[str]:
    """Return sentences on what is not in the table."""
    found = []
    joint = getattr(covariance, "joint", covariance)  # of a CameraNoise
    if joint is not covariance:
        found.append(f"{name}: per pixel of corner noise, which `calibrate` estimates.")
    if hasattr(joint, "keys"):
        names = ", ".join(dict.fromkeys(str(key) for key in joint.keys if key is not None))
        count = joint.shared.shape[-1]
        if count:
            found.append(f"{name}: the poses share {count} errors{f' ({names})' if names else ''}.")
    elif covariance is not None and is_joint(covariance):
        found.append(f"{name}: one joint covariance of all poses.")
    elif covariance is not None and _correlation(covariance) > MIN_MENTIONED_CORRELATION:
        found.append(f"{name}: the components are correlated, up to {_correlation(covariance):.2f}.")
    return found


def _extent(covariance: Covariance | CameraNoise | None, item: str) -> str:
    """Return what the numbers hold for."""
    if covariance is None or covariance.shape == (6, 6):
        return f"every {item}"
    count = covariance.shape[0] // 6 if len(covariance.shape) == 2 else covariance.shape[0]
    return f"{count:,} {item}s, median"


def _correlation(covariance: ArrayLike) -> float:
    S = np.asarray(covariance).reshape(-1, 6, 6)
    std = np.sqrt(np.diagonal(S, axis1=-2, axis2=-1))
    scale = np.where(std > 0, std, 1.0)
    rho = np.abs(S) / (scale[:, :, None] * scale[:, None, :]) * (1 - np.eye(6))
    return float(np.median(rho.max(axis=(1, 2))))
