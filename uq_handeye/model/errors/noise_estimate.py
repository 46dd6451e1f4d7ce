"""Noise of a data set after its estimation: its components, and the complete estimate.

Units are rad and m, standard deviations per axis; text is in degrees and mm. The estimation is in `fit.graph`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from ...core.files.json_values import Json, JsonObject
from ...core.files.records import Record, parts_of, read
from ...core.files.tree_values import is_map
from ...core.geometry.se3 import Array
from ...errors import InputError
from ...findings import Finding
from .error_estimate import SHOWN, ErrorEstimate
from .joint_covariance import JointCovariance
from .key import ErrorKey, Kind, Owner
from .keys import CAMERA_EXCESS, PICTURE_SHIFT, SCENE_EXCESS
from .models import Noise, PairNoise, PoseNoise, is_joint

# Noise of one side that is drawn at each pose.
SIDES = (Owner.ROBOT, Owner.CAMERA, Owner.A, Owner.B)
OF_SIDES = (Kind.ROTATION, Kind.TRANSLATION, Kind.BEYOND_CORNERS)
OF_CAMERA = tuple(ErrorKey(Owner.CAMERA, kind) for kind in OF_SIDES)


class CameraFactor(NamedTuple):
    """Factor on the covariance of the camera poses that the residuals indicate: 1 if it is valid (`beside_camera`)."""

    value: float  # kappa, of variances
    dof: float  # kappa times dof is chi-square with dof degrees of freedom, if the covariance is valid
    p_value: float  # two-sided


@dataclass(frozen=True, eq=False)
class NoiseEstimate(Record):
    """The noise that a data set shows; see `estimate_noise`.

    ``variances`` and ``covariance`` (of their estimates) are of side 1 rotation, side 2 rotation (rad^2) and of the
    translations together (m^2): what S is made of. Beside a covariance of the camera poses they are of the robot's
    rotation and translation, and of the pixels (pixels^2), as far as they are not given, or of what corners of a
    picture share (pixels^2, `CAMERA_EXCESS`).
    """

    _in_file: ClassVar[str] = (
        "noise=sides components findings statement variances covariance dof camera_factor shape keys of_model"
    )
    _if_any: ClassVar[str] = "camera_factor shape keys of_model"

    noise: PoseNoise | PairNoise | None  # None: exact data
    components: tuple[ErrorEstimate, ...]
    findings: tuple[Finding, ...]  # what the data can and cannot tell
    variances: Annotated[Array, "m"]  # (3,), with a camera covariance (1,) to (3,)
    covariance: Annotated[Array, "m", "m"]  # (m, m)
    dof: float  # residual degrees of freedom: 6 n - p, a pose of weight w counts as w poses
    camera_factor: CameraFactor | None = None  # of a given camera covariance, where the data determine it
    shape: float | None = None  # degrees of freedom of the t that X follows, its sizes integrated over; None: Gaussian
    keys: tuple[ErrorKey, ...] = ()  # of the components that `variances` are of; empty: by what was estimated, as above
    of_model: tuple[ErrorEstimate, ...] = ()  # all errors of the joint model

    @property
    def statement(self) -> tuple[str, ...]:
        """Sentences that say what the data can and cannot tell."""
        return tuple(map(str, self.findings))

    @property
    def has_prior(self) -> bool:
        """True if a data sheet contributed, so that the test of the fit is one."""
        return any(component.status in ("fixed", "prior") for component in self.components)

    @property
    def from_corners(self) -> bool:
        """True if the noise of the camera poses comes from their corners, and only the robot's was estimated."""
        return any(component.status == "from corners" for component in self.components)

    @property
    def from_points(self) -> bool:
        """True if the noise of the camera poses comes from points in 3-D, and only the robot's was estimated."""
        return any(component.status == "from points" for component in self.components)

    @property
    def camera_known(self) -> bool:
        """True if the camera poses came with their covariance."""
        return self.from_corners or self.from_points or self.from_scene

    @property
    def from_scene(self) -> bool:
        """True if the noise of the camera poses comes from a scene, and only the robot's was estimated."""
        return any(component.status == "from the scene" for component in self.components)

    @property
    def by_geometry(self) -> bool:
        """True if the covariance of the camera poses has the shape that their views give it (`CameraNoise`)."""
        return any(component.status == "by geometry" for component in self.components)

    @property
    def tested(self) -> bool:
        """True if residuals can contradict this noise: most of what they see was not made of them."""
        factor = self.camera_factor
        if any(component.key in OF_CAMERA and not component.is_given for component in self.components) and all(
            component.key.kind not in OF_SIDES or component.key.owner not in SIDES
            for component in self.components
            if component.status in ("fixed", "prior")
        ):  # assumed of an arm, with a camera whose noise is that of the residuals
            return False
        beyond = (CAMERA_EXCESS, PICTURE_SHIFT, SCENE_EXCESS)
        if any(component.key in beyond and component.size > 0 for component in self.components):
            return False
        return self.has_prior or (factor is not None and factor.dof > 0.5 * self.dof)

    @property
    def is_joint(self) -> bool:
        """True if the covariance of a side is joint: it has a row for each pose."""
        return self.noise is not None and any(S is not None and is_joint(S) for S in self.noise.sides.values())

    def __getitem__(self, of: str | ErrorKey) -> ErrorEstimate:
        for component in self.components:
            if of in (component.key, component.name):
                return component
        raise KeyError(of)

    @property
    def sides(self) -> JsonObject | None:
        """Noise of each side that has one, as plain values."""
        if self.noise is None:
            return None
        return {name: _side_to_dict(S) for name, S in self.noise.sides.items() if S is not None}

    @classmethod
    def from_dict(cls, data: Any) -> NoiseEstimate:
        """Read what `to_dict` wrote; raises `InputError` on anything else."""
        sides = read(dict[str, Any] | None, data.get("noise"), "noise_estimate.noise")
        noise: Noise | None = None
        if sides is not None:
            kind = PairNoise if "A" in sides else PoseNoise
            noise = kind(**{name: _side_from_dict(side) for name, side in sides.items()})
        found = cls(**parts_of(cls, data, "noise_estimate", noise=noise))
        for component in found.components:
            if component.unit not in SHOWN:
                raise InputError(
                    f"Expected the unit of {component.name} to be rad, m or px, got {component.unit!r:.40}."
                )
        return found


def _side_to_dict(S: Array | JointCovariance) -> Json:
    """Standard deviations of rotation and translation; a joint covariance, or others of corners, as they are."""
    if isinstance(S, JointCovariance):
        return S.to_dict()
    deviations = np.sqrt(np.diag(S)) if S.shape == (6, 6) else np.zeros(6)
    two: list[float] = deviations[[0, 3]].tolist()
    if np.array_equal(S, np.diag(np.repeat(deviations[[0, 3]], 3) ** 2)):
        return two
    return {"covariance": S.tolist()}


def _side_from_dict(values: Any) -> Any:
    """The inverse of `_side_to_dict`."""
    if is_map(values):
        return values["covariance"] if "covariance" in values else JointCovariance.from_dict(values)
    rotation, translation = (float(value) for value in values)
    return np.diag([rotation**2] * 3 + [translation**2] * 3)


def together(what: Kind, sides: tuple[str, str]) -> ErrorKey:
    """The key of a sum."""
    return ErrorKey(Owner.A_AND_B if sides[0] == Owner.A else Owner.ROBOT_AND_CAMERA, what)
