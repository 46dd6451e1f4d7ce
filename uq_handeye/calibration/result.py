"""Calibration: X with its uncertainty, and everything that belongs to it, in one documented object."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ..diagnostics.budget import Budget
from ..diagnostics.pose_table import PoseTable
from ..diagnostics.result import Diagnostics
from ..diagnostics.split_half import SplitHalf
from ..diagnostics.task_space import PointUncertainty, moves_of_points, through_robot, through_target, through_X
from ..errors import InputError
from ..files.atomic import json_text
from ..files.open import as_path, opened
from ..findings import Finding, texts
from ..formatting.numbers import concise, digits
from ..geometry import conventions
from ..geometry.frames import SETUPS, TARGETS
from ..geometry.pose_numbers import POSE_NUMBERS, pose_numbers
from ..geometry.principal_axes import principal_axes
from ..geometry.se3 import Array, inverse, inverse_jacobian
from ..likelihood.d2_distribution import Reference
from ..likelihood.goodness_of_fit import GoodnessOfFit
from ..likelihood.open_directions import OpenDirections, moves_along
from ..likelihood.rig_bundle import Agreement
from ..likelihood.shared_estimates import SharedEstimate
from ..noise.estimate import NoiseEstimate
from ..noise.models import Noise
from ..noise.to_dict import noise_to_dict
from ..poses.motions import Motions
from ..poses.pose_pairs import PosePairs
from ..poses.residuals import Residuals
from ..poses.timing import TimeOffset
from ..presentation.document import document_of, to_text
from ..presentation.notebook import html_of
from ..procrustes.finite_scale import octonion
from ..procrustes.sensitivity import pose_from_octonion_jacobian
from ..procrustes.so4_covariances import PAPER_SCALE
from ..runtime.read_only import ReadOnlyArrays
from .analysis import Analysis, StoredAnalysis
from .provenance import Provenance
from .result_file import FORMAT, FourDPA, finite, from_dict, plain
from .sentences import open_words

if TYPE_CHECKING:
    import pandas as pd

    from ..report.page import CrossCheck, Methods

MAX_BYTES = 500_000_000  # of a result's file


@dataclass(frozen=True, eq=False)
class Calibration(ReadOnlyArrays):
    """X of AX = XB and what is known about it.

    Model: ``X = (R, t)`` with the error ``xi = (theta, tau)``, ``R = exp([theta]x) R_hat``,
    ``t = t_hat + tau``, in rad and m, in the parent frame of X (gripper for eye-in-hand, base for eye-to-hand);
    ``covariance`` is that of xi, to first order.

    `diagnostics`, `covariances`, `split_half` and `budget` are worked out when they are first asked for.

    Attributes
    ----------
    X : (4, 4)
        The pose that was sought, `frame`: ``gripper_T_camera`` for eye-in-hand, ``base_T_camera`` for eye-to-hand; m.
    covariance : (6, 6) or None
        Of (theta, tau), rad and m. None: not determined, as no noise was given and none could be estimated.
    method : str
        The estimator.
    scale : float or None
        Scaling factor of 4DPA; None: its limit, which needs none.
    kind : str or None
        How the noise was propagated: "pairs", "poses" or "literal".
    setup : str or None
        "eye-in-hand" or "eye-to-hand"; None for motions that came without poses.
    n_poses : int or None
        None for motions that came without poses.
    n_pairs : int
        Motions that were made of the poses.
    noise : PoseNoise, PairNoise or None
        The noise that the covariance is of, given or estimated.
    residuals : Residuals
        How well X explains the pairs: RMS, median, maximum. It is not how accurate X is.
    findings : tuple of Finding
        What was found about data and fit: code, severity ("note", "caution" or "failure") and values;
        ``str(finding)`` is its sentence. A failure says that X or its covariance cannot be used as it is.
    warnings : tuple of str
        The sentences of the findings that are more than a note. Read them before X is used.
    W : (4, 4) or None
        The pose of the target, `frame_W`: ``base_T_target``, or ``gripper_T_target`` for eye-to-hand; m.
    covariance_W : (6, 6) or None
        That of W, in the parent frame of W; needs noise on the poses.
    iterations : int
        0: closed form.
    covariance_kind : str
        "model", "sigma-points", "sandwich", "hac", "jackknife" or "bootstrap".
    reference : Reference
        The distribution of ``d^2 = xi^T covariance^-1 xi``: chi-square, or wider where the noise is estimated.
    noise_estimate : NoiseEstimate or None
        Standard deviations with intervals, where the noise comes from the data.
    bound : (6, 6) or None
        Cramer-Rao bound at this noise and these poses: no unbiased estimate has a smaller covariance. Of `efficient`
        and `ml`.
    fourdpa : FourDPA or None
        ``X`` and ``covariance`` by 4DPA alone, beside `efficient` and `ml`.
    fit : GoodnessOfFit or None
        Chi-square test of the residuals against the noise.
    table : PoseTable or None
        Residual, distance, leverage, weight and flag of each pose.
    time_offset : TimeOffset or None
        Of interpolated poses: the offset and its share of the covariance.
    shared : tuple of SharedEstimate
        Errors that all poses share: assumed standard deviation, estimate and standard deviation after the fit, share
        of the variance of X.
    agreement : Agreement or None
        Of method "bundle": how far it is from `efficient`, and the time of each.
    provenance : Provenance or None
        Files, options, versions: enough to repeat the run.
    data : PosePairs, Motions or None
        What it was made of. Not in the JSON file: None when it was read from one.
    opened : OpenDirections or None
        What of X and W the motions leave open; None: nothing. `covariance` and `covariance_W` are then those of the
        other directions, and have the variance 0 along these: use them together with `open_directions`.
    analysis : Analysis, StoredAnalysis or None
        Where `diagnostics`, `covariances`, `split_half`, `split_in_time` and `budget` come from.
    """

    X: Array  # (4, 4)
    covariance: Array | None  # (6, 6); None: not determined, no noise was given
    method: str
    scale: float | None
    kind: str | None  # how the covariance was propagated: "pairs", "poses" or "literal"
    setup: str | None  # None for motions that came without poses
    n_poses: int | None
    n_pairs: int
    noise: Noise | None
    residuals: Residuals
    findings: tuple[Finding, ...] = ()
    W: Array | None = None  # (4, 4), the mean of G X C: base_T_target (gripper_T_target for eye-to-hand)
    covariance_W: Array | None = None  # (6, 6), as `covariance`, in the parent frame of W; needs noise on the poses
    iterations: int = 0  # 0: closed form
    covariance_kind: str = "model"  # one of `request.COVARIANCES`
    reference: Reference = field(default_factory=Reference)  # the distribution of d^2 = xi^T covariance^-1 xi
    noise_estimate: NoiseEstimate | None = None  # where the noise comes from the data
    bound: Array | None = None  # (6, 6) Cramer-Rao bound at this noise and these poses; of efficient and ml
    fourdpa: FourDPA | None = None  # 4DPA's own answer, beside efficient and ml
    fit: GoodnessOfFit | None = None  # chi-square test of the residuals against the noise
    table: PoseTable | None = None  # residual, leverage and flag of each pose
    time_offset: TimeOffset | None = None  # of interpolated poses: its share of the covariance
    shared: tuple[SharedEstimate, ...] = ()  # errors that all poses share
    agreement: Agreement | None = None  # of method "bundle" with `efficient`
    opened: OpenDirections | None = None  # what of X and W the motions leave open
    provenance: Provenance | None = None  # files, options and versions: enough to repeat the run
    data: PosePairs | Motions | None = field(default=None, repr=False)  # what it was made of; not in the JSON file
    analysis: Analysis | StoredAnalysis | None = field(
        default=None, repr=False
    )  # diagnostics, other covariances, split halves, budget

    @property
    def warnings(self) -> tuple[str, ...]:
        """What looked wrong, one sentence or more each: the findings that are more than a note."""
        return texts(self.findings)

    @property
    def frame(self) -> str:
        """The frames of X, e.g. ``gripper_T_camera``."""
        return "X" if self.setup is None else SETUPS[self.setup]

    @property
    def frame_W(self) -> str:
        """The frames of W, e.g. ``base_T_target``."""
        return "W" if self.setup is None else TARGETS[self.setup]

    @property
    def std(self) -> Array | None:
        """Standard deviations (6,) of (theta, tau), rad and m; infinite for components that move along what is open."""
        if self.covariance is None:
            return None
        return deviations_of(self.covariance, self.opened, "X")

    @property
    def std_W(self) -> Array | None:
        """Standard deviations (6,) of (theta, tau) of W, rad and m; infinite as those of X."""
        if self.covariance_W is None:
            return None
        return deviations_of(self.covariance_W, self.opened, "W")

    @property
    def open_directions(self) -> Array:
        """(k, 12): what of (xi_X, xi_W) the motions leave open, as errors (theta, tau) of X, then of W, rad and m.

        Orthonormal in units of the rig: angles times ``opened.lever``, the distance of camera and target. k = 0 where
        nothing is open.
        """
        return np.zeros((0, 12)) if self.opened is None else self.opened.basis

    @property
    def open_of_X(self) -> Array | None:
        """(j, 6): what of X is open; None: nothing."""
        return None if self.opened is None else self.opened.of_X

    @property
    def open_of_W(self) -> Array | None:
        """(j, 6): what of W is open; None: nothing."""
        return None if self.opened is None else self.opened.of_W

    @property
    def open_words(self) -> tuple[str, ...]:
        """Each open direction in words."""
        return (
            () if self.opened is None else tuple(open_words(one, self.setup) for one in self.opened.single().tolist())
        )

    @property
    def correlation(self) -> Array | None:
        """Correlation matrix (6, 6) of (theta, tau); 0 beside a variance of 0."""
        if self.covariance is None:
            return None
        std = np.sqrt(np.diag(self.covariance))
        unit = np.where(std > 0, std, 1.0)
        correlation: Array = self.covariance / np.outer(unit, unit)
        np.fill_diagonal(correlation, 1.0)
        return correlation

    @property
    def inverse(self) -> Array:
        """``inv(X)`` (4, 4), e.g. ``camera_T_gripper``."""
        return inverse(self.X)

    @property
    def covariance_inverse(self) -> Array | None:
        """Covariance (6, 6) of ``inv(X)`` in the same convention, in its own parent frame."""
        if self.covariance is None:
            return None
        J = inverse_jacobian(self.X)
        return np.asarray(J @ self.covariance @ J.T)

    @property
    def sigma_scale(self) -> float:
        """The factor d at which `sigma` is given: that of the estimate, or 1e4 where it was the limit."""
        return PAPER_SCALE if self.scale is None else self.scale

    @property
    def sigma(self) -> Array:
        """The unit octonion (8,) of X on SO(4) (18), at `sigma_scale`."""
        return octonion(self.X, self.sigma_scale)

    @property
    def covariance_sigma(self) -> Array | None:
        """Covariance (8, 8) of `sigma` (48), of rank 6: the unit lengths of q_L and q_R are exact."""
        if self.covariance is None:
            return None
        sigma = self.sigma
        # sigma moves in the six directions orthogonal to (q_L, 0) and (0, q_R); there d xi / d sigma is regular.
        normals = np.zeros((8, 2))
        normals[:4, 0], normals[4:, 1] = sigma[:4], sigma[4:]
        tangent = np.linalg.qr(normals, mode="complete")[0][:, 2:]
        J = tangent @ np.linalg.inv(pose_from_octonion_jacobian(sigma, self.sigma_scale) @ tangent)
        return np.asarray(J @ self.covariance @ J.T)

    def covariance_in(self, convention: str) -> Array:
        """The covariance in the convention of another library; see `uq_handeye.geometry.conventions`."""
        if self.covariance is None:
            raise InputError("The covariance is not determined: no noise was given, and none could be estimated.")
        return conventions.to_convention(self.covariance, self.X, convention)

    @property
    def quaternion(self) -> Array:
        """Unit quaternion (x, y, z, w) of X, w >= 0."""
        return np.asarray(Rotation.from_matrix(self.X[:3, :3]).as_quat(canonical=True))

    @property
    def weakest_rotation(self) -> tuple[Array, float] | None:
        """Axis (3,) about which the rotation of X is least certain, and its standard deviation in rad."""
        return None if self.covariance is None else _weakest(self.covariance[:3, :3])

    @property
    def weakest_translation(self) -> tuple[Array, float] | None:
        """Direction (3,) along which the translation of X is least certain, and its standard deviation in m."""
        return None if self.covariance is None else _weakest(self.covariance[3:, 3:])

    def quantile(self, level: float = 0.95) -> float:
        """The d^2 that a share ``level`` of all errors stays below: the squared radius of that ellipsoid."""
        return self.reference.quantile(level)

    @property
    def efficiency(self) -> Array | None:
        """Standard deviations (6,) of 4DPA, as multiples of the Cramer-Rao bound."""
        if self.fourdpa is None or self.fourdpa.covariance is None or self.bound is None:
            return None
        return np.asarray(np.sqrt(np.diag(self.fourdpa.covariance) / np.diag(self.bound)))

    @property
    def diagnostics(self) -> Diagnostics:
        """Observability, influence, tests of the residuals, systematic errors: see `Diagnostics`."""
        return self._analysed().diagnostics

    @property
    def covariances(self) -> dict[str, Array | None]:
        """Covariances (6, 6) of X by name: that of the noise model, and those that need none; None: not determined."""
        return self._analysed().covariances

    @property
    def split_half(self) -> SplitHalf:
        """X from the even and from the odd rows against each other."""
        return self._analysed().split_half

    @property
    def split_in_time(self) -> SplitHalf:
        """X from the first and from the last rows against each other, which finds drift."""
        return self._analysed().split_in_time

    @property
    def budget(self) -> Budget:
        """Which share of the variance comes from which noise source."""
        return self._analysed().budget

    def _analysed(self) -> Analysis | StoredAnalysis:
        if self.analysis is None:
            raise InputError(
                f"This is known for the methods efficient and ml where there is noise, not for this result of "
                f"{self.method!r}."
            )
        return self.analysis

    @property
    def used(self) -> tuple[PosePairs | Motions, Noise]:
        """What X is the plain fit of: the poses that count, and their noise, that of each divided by its weight.

        `monte_carlo`, `sweep`, `sample_posterior` and `cross_check`, given the calibration itself, start from these, so
        that all of them speak of this X. Raises `InputError` where there are no poses or there is no noise.
        """
        if self.data is None or self.noise is None:
            lacks = "no poses: it was read from a file" if self.data is None else "no noise: none was found"
            raise InputError(f"This calibration holds {lacks}.")
        if self.table is None or (self.table.weight == 1).all():
            return self.data, self.noise
        kept = np.flatnonzero(self.table.weight > 0)
        return self.data.rows(kept), self.noise.rows(kept).weighted(self.table.weight[kept])

    def uncertainty_at(
        self,
        points: ArrayLike,
        *,
        robot: ArrayLike | None = None,
        camera: ArrayLike | None = None,
        robot_covariance: ArrayLike | None = None,
        camera_covariance: ArrayLike | None = None,
        points_covariance: ArrayLike | None = None,
    ) -> PointUncertainty:
        """The uncertainty of points that the camera measures, where the calibration carries them.

        Model (`task_space`): to first order, errors of X (or W), of the pose given and of the points independent.

        Parameters
        ----------
        points : (..., 3)
            In camera coordinates, metres.
        robot : (..., 4, 4) or None
            ``base_T_gripper`` when the points were seen. With it the points are expressed at the other end of the robot
            (the base for eye-in-hand, the gripper for eye-to-hand); without, in the parent frame of X (the gripper for
            eye-in-hand, the base for eye-to-hand).
        camera : (..., 4, 4) or None
            ``camera_T_target`` when the points were seen: the same frame as with `robot`, but through the target and
            W, ``W inv(C) p``; needs neither X nor the robot pose.
        robot_covariance, camera_covariance : (6, 6), (..., 6, 6) or None
            Of that pose; None is exact.
        points_covariance : (3, 3), (..., 3, 3) or None
            Noise of the points themselves, in the camera frame.

        Returns
        -------
        PointUncertainty
            ``points`` (..., 3), ``covariance`` (..., 3, 3), ``std`` (..., 3), ``radius_95`` (...), ``frame``. Where
            X (or W) is open (`open_directions`) coordinates that this moves are infinite, the others are as known.

        Raises
        ------
        InputError
            Wrong shapes or numbers; a covariance that is not positive semidefinite, or whose pose is not given; poses
            for a calibration of motions that came without any; an X or W whose covariance is not determined.
        """
        setup = self.setup
        for name, pose, noise in (("robot", robot, robot_covariance), ("camera", camera, camera_covariance)):
            if pose is None and noise is not None:
                raise InputError(f"Expected the pose `{name}` beside `{name}_covariance`, which is that of this pose.")
            if pose is not None and setup is None:
                raise InputError(
                    f"Expected no `{name}`: this calibration is of motions that came without poses, so that X is known "
                    "in its own frame alone."
                )
        if robot is not None and camera is not None:
            raise InputError("Give either `robot`, to go through the robot, or `camera`, to go through the target.")
        if camera is not None:
            assert setup is not None
            if self.W is None or self.covariance_W is None:
                raise InputError(
                    "The way through the target needs W and its covariance: calibrate poses with PoseNoise."
                )
            found = through_target(
                self.W,
                self.covariance_W,
                points,
                camera,
                camera_covariance=camera_covariance,
                setup=setup,
                points_covariance=points_covariance,
            )
            if self.opened is None:
                return found
            return found.left_open(moves_of_points(found.points - self.W[:3, 3], self.opened.of_W))
        if self.covariance is None:
            raise InputError("The covariance of X is not determined, and so is that of the points.")
        near = through_X(self.X, self.covariance, points, setup=setup, points_covariance=points_covariance)
        if robot is None:
            if self.opened is None:
                return near
            return near.left_open(moves_of_points(near.points - self.X[:3, 3], self.opened.of_X))
        assert setup is not None
        found = through_robot(
            self.X,
            self.covariance,
            points,
            robot,
            robot_covariance=robot_covariance,
            setup=setup,
            points_covariance=points_covariance,
        )
        if self.opened is None:
            return found
        R = np.asarray(robot, dtype=float)[..., :3, :3]
        R = R if setup == "eye-in-hand" else R.mT
        return found.left_open(moves_of_points(near.points - self.X[:3, 3], self.opened.of_X, R))

    def __repr__(self) -> str:
        data = f"{self.n_pairs} pairs" if self.n_poses is None else f"{self.n_poses} poses"
        known = "uncertainty not determined"
        if self.weakest_translation is not None and self.weakest_rotation is not None:
            move, turn = 1e3 * self.weakest_translation[1], np.degrees(self.weakest_rotation[1])
            known = f"{digits(move, 2)} mm, {digits(turn, 2)} deg (1 sigma, worst axis)"
            if self.opened is not None:
                known += f", {len(self.open_directions)} open"
        return f"Calibration({self.frame} by {self.method}, {data}: {known})"

    def summary(self, threshold: float = 0.5) -> str:
        """The result as text; correlations at or above ``threshold`` are listed."""
        return to_text(document_of(self, threshold=threshold))

    def _repr_html_(self) -> str:
        """The result in a notebook: X with its deviations, warnings, and the numbers behind them."""
        return html_of(self)

    def report(
        self,
        path: str | Path,
        *,
        comparison: Methods = True,
        cross_check: CrossCheck | None = None,
    ) -> Path:
        """One self-contained file for people: ``.html``, or ``.pdf``; see `report.page` for the sections.

        Parameters
        ----------
        path : str or Path
            Its suffix says which: .html or .pdf.
        comparison : Comparison, Compared or bool
            The methods side by side: what `compare` or `compare_beside` gave. True compares them first, which is all
            that is computed for a report; False leaves the section without.
        cross_check : CrossCheck or None
            Where given, its covariances are drawn over the ellipses and its relations listed.

        Raises
        ------
        InputError
            A path with another suffix or that cannot be written.
        MissingExtraError
            A PDF where neither WeasyPrint (extra ``pdf``) nor a Chromium browser is installed.
        """
        from ..report.page import write_report

        return write_report(self, path, comparison=comparison, cross_check=cross_check)

    def export(self, path: str | Path, format: str | None = None) -> Path:
        """X for another program: JSON, ROS (YAML), URDF, OpenCV FileStorage or NPZ; see `export` for what each holds.

        ``format`` is a name in `export.FORMATS`; None takes it from the suffix.
        """
        from ..export import write_export

        return write_export(self, path, format)

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table of the six numbers of X: value, standard deviation, unit."""
        import pandas as pd

        values, std = pose_numbers(self.X, self.covariance, opened=self.open_of_X)
        units = ["mm"] * 3 + ["deg"] * 3
        known = [None] * 6 if std is None else std.tolist()
        return pd.DataFrame(
            {
                "value": values,
                "std": pd.array(known, dtype="Float64"),
                "unit": units,
                "concise": [concise(*number) for number in zip(values.tolist(), known, units, strict=True)],
            },
            index=pd.Index(POSE_NUMBERS, name=self.frame),
        )

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, lists and text, with units and convention; see `from_dict`."""
        return {
            "format": FORMAT,
            "convention": conventions.CONVENTION,
            "units": {"rotation": "rad", "translation": "m"},
            "method": self.method,
            "scale": self.scale,
            "kind": self.kind,
            "setup": self.setup,
            "X": self.X.tolist(),
            "covariance": plain(self.covariance),
            **self._derived(),
            "n_poses": self.n_poses,
            "n_pairs": self.n_pairs,
            "noise": noise_to_dict(self.noise),
            "W": plain(self.W),
            "covariance_W": plain(self.covariance_W),
            "iterations": self.iterations,
            "covariance_kind": self.covariance_kind,
            "reference": self.reference.to_dict(),
            "noise_estimate": None if self.noise_estimate is None else self.noise_estimate.to_dict(),
            "bound": plain(self.bound),
            "4dpa": None
            if self.fourdpa is None
            else {"X": self.fourdpa.X.tolist(), "covariance": plain(self.fourdpa.covariance)},
            "fit": None if self.fit is None else asdict(self.fit),
            "poses": None if self.table is None else self.table.to_dict(),
            "analysis": None if self.analysis is None else self.analysis.to_dict(),
            "provenance": None if self.provenance is None else self.provenance.to_dict(),
            "time_offset": None if self.time_offset is None else self.time_offset.to_dict(),
            "shared": [error.to_dict() for error in self.shared],
            **({} if self.agreement is None else {"agreement": self.agreement.to_dict()}),
            **({} if self.opened is None else {"open": self.opened.to_dict() | {"words": list(self.open_words)}}),
            "residuals": self.residuals._asdict(),
            "findings": [finding.to_dict() for finding in self.findings],
            "warnings": list(self.warnings),
        }

    def _derived(self) -> dict[str, Any]:
        """What follows from other parts of the file."""
        return {
            "frame": self.frame,
            "std": finite(self.std),
            "correlation": plain(self.correlation),
            "quaternion_xyzw": self.quaternion.tolist(),
            "inverse": self.inverse.tolist(),
            "covariance_inverse": plain(self.covariance_inverse),
            "frame_W": self.frame_W,
            "std_W": finite(self.std_W),
            "efficiency": plain(self.efficiency),
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Calibration:
        """The inverse of `to_dict`; raises `InputError` on anything else: parts that are missing, of another type, not
        finite, or that do not belong to each other."""
        return from_dict(cls, data)

    def to_json(self, path: str | Path | None = None) -> str:
        """JSON text, also written to ``path`` (whole or not at all); numbers survive without loss."""
        return json_text(self.to_dict(), path)

    @classmethod
    def from_json(cls, path: str | Path) -> Calibration:
        """Read what `to_json` wrote."""
        with opened(as_path(path), MAX_BYTES) as file:
            text = file.read()
        try:
            data = json.loads(text.decode("utf-8"), parse_constant=_refuse)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path} is not JSON: {error}.") from error
        try:
            return cls.from_dict(data)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error


def deviations_of(covariance: Array, opened: OpenDirections | None, of: str) -> Array:
    """Standard deviations (6,) of X or W, infinite for components that move along what is open."""
    std = np.sqrt(np.diag(covariance))
    if opened is None:
        return np.asarray(std)
    basis = opened.of_X if of == "X" else opened.of_W
    return np.where(moves_along(basis, opened.lever), np.inf, std)


def _weakest(covariance: Array) -> tuple[Array, float]:
    deviations, axes = principal_axes(covariance)
    return axes[0], float(deviations[0])


def _refuse(constant: str) -> None:
    raise ValueError(f"it holds {constant}")
