"""Parts of a calibration in addition to X and W: its origin, its solution, its errors, and its quality.

Each part is a record of the result file. `Named` gives their attributes the names that they have on the result.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from operator import attrgetter
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

import numpy as np

from ..core.files.records import Record
from ..core.files.source import Source, versions
from ..core.geometry.se3 import Array
from ..fit.diagnostics.pose_table import PoseTable
from ..fit.graph.goodness_of_fit import GoodnessOfFit
from ..fit.graph.points import OpenSizes
from ..fit.graph.posterior import Posterior
from ..fit.graph.reference import Reference
from ..model.errors.error_estimate import ErrorEstimate
from ..model.errors.models import Noise
from ..model.errors.noise_estimate import NoiseEstimate
from ..model.poses.camera_scale import CameraScale
from ..model.poses.estimated_pose import EstimatedPose
from ..model.poses.motions import Motions
from ..model.poses.pose_data import sha256_of
from ..model.poses.pose_pairs import PosePairs
from ..model.poses.residuals import Residuals
from ..model.poses.timing import TimeOffset
from .analysis import Analysis, FittedKinematics, StoredAnalysis


@dataclass(frozen=True)
class Provenance(Record):
    """Input, options and versions of a calibration.

    ``data_sha256`` is the SHA-256 of the poses (or motions) as they were used, float64, little-endian, robot first: the
    same numbers give it whatever file they came from. ``options`` are the arguments of `calibrate`; ``command`` is the
    command line where there was one. ``request`` holds the arguments as they were given, by which the same calibration
    is repeated with more poses (`Request.to_dict`); None after an update by the posterior alone, which has no single
    set of arguments.
    """

    _if_any: ClassVar[str] = "request"

    data_sha256: str
    options: dict[str, Any]
    versions: dict[str, str]
    sources: tuple[Source, ...] = field(default=())
    command: str | None = None
    request: dict[str, Any] | None = None


def provenance(data: PosePairs | Motions, options: dict[str, Any], request: dict[str, Any]) -> Provenance:
    """Record the input and the options of `calibrate`."""
    sides = (data.robot, data.camera) if isinstance(data, PosePairs) else (data.A, data.B)
    sources = () if data.poses is None else data.poses.sources
    return Provenance(sha256_of(*sides), options, dict(versions()), sources, request=request)


class FourDPA(NamedTuple):
    """4DPA result for the same data."""

    X: Annotated[Array, 4, 4]
    covariance: Annotated[Array, 6, 6] | None  # to first order, at the same noise


@dataclass(frozen=True, eq=False, kw_only=True)
class Origin(Record):
    """Data and request that X was made of."""

    setup: str | None  # None for motions that came without poses
    n_poses: int | None
    n_pairs: int
    data: PosePairs | Motions | None = None
    excluded: tuple[int, ...] = ()  # numbers of poses in `data` that were left out by request
    provenance: Provenance | None = None  # files, options and versions: enough to repeat the run
    about: dict[str, str] = field(default_factory=dict)  # title block of the report, by the names of `files.about`

    @property
    def counted(self) -> PosePairs | Motions | None:
        """Data of the fit: `data` without the excluded poses, of which motions were made."""
        poses = None if self.data is None else self.data.poses
        if not self.excluded or poses is None or poses is not self.data:
            return self.data
        return poses.rows(np.setdiff1d(np.arange(poses.n), self.excluded))


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution(Record):
    """The method of the estimate of X, and further results for the same data."""

    method: str
    scale: float | None
    kind: str | None  # how the covariance was propagated: "pairs", "poses" or "literal"
    iterations: int = 0  # 0: closed form
    covariance_kind: str = "model"  # one of `request.COVARIANCES`
    reference: Reference = field(default_factory=Reference)  # the distribution of d^2 = xi^T covariance^-1 xi
    bound: Array | None = None  # (6, 6) Cramer-Rao bound at this noise and these poses; of efficient and ml
    fourdpa: FourDPA | None = None  # result of 4DPA, for comparison with efficient and ml


@dataclass(frozen=True, eq=False, kw_only=True)
class Errors(Record):
    """Noise and the errors that all poses share, to which the covariance belongs."""

    noise: Noise | None = None
    noise_estimate: NoiseEstimate | None = None  # where the noise comes from the data
    time_offset: TimeOffset | None = None  # of interpolated poses: its share of the covariance
    camera_scale: CameraScale | None = None  # of camera poses that have none of their own
    shared_at_sizes: tuple[ErrorEstimate, ...] = ()  # what `shared` is made of: for the mean sizes of the errors
    kinematics: FittedKinematics | None = None  # the arm, where its joints were given
    joint_posterior: Posterior | OpenSizes | None = None  # what `posterior` is made of
    # (2, n, 3, 4) poses of robot and camera as the fit corrects them, at which the columns of shared errors were taken
    corrected: Array | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Quality(Record):
    """Quality of the fit: how well X explains the data."""

    residuals: Residuals
    fit: GoodnessOfFit | None = None  # chi-square test of the residuals against the noise
    table: PoseTable | None = None  # residual, leverage and flag of each pose
    analysis: Analysis | StoredAnalysis | None = None  # diagnostics, other covariances, split halves, budget
    split: tuple[EstimatedPose, ...] = ()  # where camera or target moved: all poses of the fit with it as two


# The parts by their names on the result.
PARTS: dict[str, Any] = {
    "origin": Origin,
    "solution": Solution,
    "errors": Errors,
    "quality": Quality,
}


if TYPE_CHECKING:

    class Named(Origin, Solution, Errors, Quality):
        """Attributes of the parts, by the same names on the result."""

else:

    class Named:
        """Attributes of the parts, by the same names on the result."""

    Named.counted = property(attrgetter("origin.counted"))
    for part, kind in PARTS.items():
        for one in fields(kind):
            setattr(Named, one.name, property(attrgetter(f"{part}.{one.name}")))
