"""`Calibration`, the result of `calibrate`: X with its uncertainty, W, the fit, the findings and the origin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from ..core.files.json_values import JsonObject
from ..core.geometry.se3 import Array
from ..core.presentation.document import COLUMNS, document_of, to_text
from ..core.presentation.html import html_of
from ..core.presentation.numbers import digits
from ..errors import InputError
from ..fit.diagnostics.task_space import PointUncertainty
from ..fit.graph.points import OpenSizes
from ..model.errors.models import Noise, PoseNoise
from ..model.errors.noise_estimate import NoiseEstimate
from ..model.poses.pose_data import data_to_dict
from .accuracy import Statement
from .analysis import FittedKinematics, joint_sides
from .camera_of_result import intrinsics_words
from .estimated import distance_of
from .prediction.corrected_urdf import CorrectedUrdf, write_corrected_urdf
from .prediction.predict import CameraPrediction, predict_camera, predict_points
from .prediction.task import TaskErrors, predict_task
from .prediction.workspace import WorkspacePrediction, over_workspace
from .report.facts import Facts, facts_of
from .report.figure_names import figure_names
from .result_file import AS_DATA, AS_NOISE, DERIVED, bound_to_data, columns_of, from_dict
from .stored_result import OF_CAMERA, StoredResult, head_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from scipy.spatial.transform import RigidTransform

    from ..report.page import CrossCheck, Methods
    from .tolerance import Verdicts


@dataclass(frozen=True, eq=False, init=False)
class Calibration(Statement, StoredResult):
    """X of AX = XB with its uncertainty.

    Model: ``X = (R, t)`` with the error ``xi = (theta, tau)``, ``R = exp([theta]x) R_hat``,
    ``t = t_hat + tau``, in rad and m, in the parent frame of X (gripper for eye-in-hand, base for eye-to-hand);
    ``covariance`` is that of xi, to first order.

    `diagnostics`, `covariances`, `split_half` and `budget` are computed on first access.

    Attributes
    ----------
    X : (4, 4)
        The estimated pose, in the frames `frame`: ``gripper_T_camera`` for eye-in-hand, ``base_T_camera`` for
        eye-to-hand; m.
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
        Poses that count, without the excluded ones. None for motions that came without poses.
    n_pairs : int
        Motions that were made of the poses.
    noise : PoseNoise, PairNoise or None
        The noise that the covariance is of, given or estimated; of poses: of those in `counted`.
    residuals : Residuals
        How well X explains the pairs: RMS, median, maximum. It is not how accurate X is.
    findings : tuple of Finding
        Findings about data and fit: code, severity ("note", "caution" or "failure") and values; ``str(finding)`` is its
        sentence. With a failure X or its covariance cannot be used.
    warnings : tuple of str
        The sentences of the findings that are more than a note. Read them before X is used.
    W : (4, 4) or None
        The pose of the target, `frame_W`: ``base_T_target``, or ``gripper_T_target`` for eye-to-hand; m.
    covariance_W : (6, 6) or None
        That of W, in the parent frame of W; needs noise on the poses.
    iterations : int
        0: closed form.
    covariance_kind : str
        "model", "sandwich" or "bootstrap".
    reference : Reference
        The distribution of ``d^2 = xi^T covariance^-1 xi``: chi-square, or wider where the noise is estimated.
    noise_estimate : NoiseEstimate or None
        Standard deviations with intervals, where the noise comes from the data.
    bound : (6, 6) or None
        Cramer-Rao bound at this noise and these poses: no unbiased estimate has a smaller covariance. Of `efficient`
        and `ml`.
    fourdpa : FourDPA or None
        ``X`` and ``covariance`` by 4DPA, for comparison with `efficient` and `ml`.
    fit : GoodnessOfFit or None
        Chi-square test of the residuals against the noise.
    table : PoseTable or None
        Residual, distance, leverage, weight and flag of each pose, also of the excluded ones.
    time_offset : TimeOffset or None
        Of interpolated poses: the offset and its share of the covariance.
    camera_scale : CameraScale or None
        Of camera poses of unknown scale: metres per unit, and its standard deviation. `data` has them in metres.
    shared : tuple of ErrorEstimate
        Errors that all poses share: assumed standard deviation, estimate and standard deviation after the fit, share
        of the variance of X.
    shared_at_sizes : tuple of ErrorEstimate
        The source of `shared`: the same for the mean sizes of the errors, as the numbers of `kinematics` are.
    provenance : Provenance or None
        Files, options, versions: enough to repeat the run.
    data : PosePairs, Motions or None
        The input, with the excluded poses. None when it was read from a file of a version that did not store
        poses.
    excluded : tuple of int
        Numbers of the poses that were left out by ``exclude`` or ``only``, counted from 0 in `data`.
    opened : OpenDirections or None
        Directions of X and W that the motions leave open; None: there are none. `covariance` and `covariance_W` are
        then those of the other directions, and have the variance 0 along these: use them together with
        `open_directions`.
    split : tuple of EstimatedPose
        Where the camera or the target moved during the session: cameras and targets of the fit in which it is two, one
        before and one after, such as ``camera`` and ``camera@13``.
    about : dict of str to str
        Title block of the report: cell, robot, camera, serial numbers, ... (`files.about.ABOUT`).
    kinematics : FittedKinematics or None
        The errors of the arm, where its joints and kinematics were given.
    joint_posterior : Posterior, OpenSizes or None
        The source of `posterior`.
    analysis : Analysis, StoredAnalysis or None
        The source of `diagnostics`, `covariances`, `split_half`, `split_in_time` and `budget`.
    origin, solution, errors, quality : Origin, Solution, Errors, Quality
        Parts that hold the above by the same names, except X, W, their covariances, `opened` and `findings`.
    """

    def predict(
        self,
        points: ArrayLike,
        joints: ArrayLike | None = None,
        *,
        robot: ArrayLike | None = None,
        points_covariance: ArrayLike | None = None,
        reached_at: ArrayLike | None = None,
        tool: ArrayLike | None = None,
    ) -> PointUncertainty:
        """Predict where points that the camera sees lie in the base, with the covariance of X and the arm together.

        With ``reached_at``: the distance by which the tip of the tool misses the points, at these joints. This is the
        error of a robot that moves to a point seen by the camera: errors that move the point and the tool alike cancel.

        Parameters
        ----------
        points : (..., 3)
            In camera coordinates, m.
        joints : (..., L) or None
            Of the robot when they were seen, rad (prismatic: m): the pose is corrected by the estimated errors of the
            arm. Leading axes broadcast with those of the points. Needless for eye-to-hand.
        robot : (..., 4, 4) or None
            ``base_T_gripper``, in place of joints where the calibration has none; and together with them where the
            controller's poses are not those of the joints.
        points_covariance : (3, 3), (..., 3, 3) or None
            Noise of the points themselves, in the camera frame.
        reached_at : (..., L) or None
            Joints at which the tool is brought to the points. For eye-to-hand ``joints`` is then left out.
        tool : (..., 3) or None
            The tip of the tool in the flange (or gripper) frame of the kinematics, m; None is its origin.

        Returns
        -------
        PointUncertainty
            In the base, with the noise of joints and robot of that one pose. For eye-to-hand the robot does not enter.
            With ``reached_at``: the tip of the tool minus the point, with the noise of both poses.

        Raises
        ------
        InputError
            Shapes that do not fit, joints where the calibration has none; a calibration that leaves a part of X open.
        """
        return predict_points(self, points, joints, robot, points_covariance, reached_at, tool)

    def predict_task(
        self,
        length: float | str,
        at: float | str,
        pixel_noise: float | str,
        focal_length: float | str | None = None,
    ) -> TaskErrors:
        """Predict the errors of a length, a plane and a point that the camera measures: calibration and measurement.

        Parameters
        ----------
        length, at : float or str
            Side of the measured square and its distance ahead of the camera (m, or ``"100mm"``).
        pixel_noise : float or str
            Of the measurement itself, one standard deviation of each coordinate (``"0.2px"``).
        focal_length : float, str or None
            In pixels; None: of the camera calibration from corners that the result holds.
        """
        return predict_task(self, length, at, pixel_noise, focal_length)

    def predict_camera(
        self,
        poses: ArrayLike | RigidTransform | None = None,
        *,
        joints: ArrayLike | None = None,
        robot: ArrayLike | None = None,
        new_measurement: bool = True,
    ) -> CameraPrediction:
        """The poses ``camera_T_target`` that the camera should see at robot poses, with their covariance.

        Model: `prediction`. X, W, the errors of the arm and those of camera and target count together, with all their
        correlations. A declared accuracy of the robot and columns of the user's own count in X, not at the new pose.

        Parameters
        ----------
        poses : (..., 4, 4), RigidTransform or None
            Robot poses ``base_T_gripper``, where the calibration has no joints; and together with `joints` where the
            controller's poses are not those of the joints.
        joints : (..., L) or None
            Of the robot, rad (prismatic: m).
        robot : (..., 4, 4) or None
            Another name of `poses`.
        new_measurement : bool
            Include the noise of one new measurement, of joints, robot and camera, for comparison with a measured pose.
            Without it, noise of the robot that was estimated from the data still counts, as it includes the unknown
            position error of the arm.

        Raises
        ------
        InputError
            As `predict`.
        """
        if poses is not None and not _are_poses(poses, self.kinematics):
            raise InputError(
                f"Expected `poses` of the robot (..., 4, 4), got {np.shape(poses)}. Joints: predict_camera(joints=q)."
            )
        if poses is not None and robot is not None:
            raise InputError("Expected the poses of the robot once: `poses` or `robot`, not both.")
        return predict_camera(self, joints, robot if poses is None else poses, new_measurement)

    @cached_property
    def over_workspace(self) -> WorkspacePrediction | None:
        """Miss distance of the tool at a point that the camera sees, near the calibrated poses and over the workspace.

        It is computed on first access. None where the calibration has no errors of an arm (`kinematics`).
        """
        return over_workspace(self, distance_of(self.analysis)[0])

    @cached_property
    def facts(self) -> Facts:
        """Facts that the views of the result select from: text, page, notebook, certificate, tables."""
        return facts_of(self)

    @property
    def identity(self) -> tuple[str, tuple[Array | None, ...]]:
        """The setup, and X and W with the covariance of X."""
        return str(self.setup), (self.X, self.W, self.covariance)

    def of_camera(self, camera: str | None = None, target: str | None = None) -> Self:
        """Return the result of one camera with one target, as a rig of several has it: this one.

        Raises `InputError` for other names.
        """
        for name, own in zip((camera, target), (self.names.camera, self.names.target), strict=True):
            if name not in (None, own):
                raise InputError(f"Expected the name {own!r}, of the only one, got {name!r}.")
        return self

    def __repr__(self) -> str:
        data = f"{self.n_pairs} pairs" if self.n_poses is None else f"{self.n_poses} poses"
        data += f", {len(self.excluded)} excluded" if self.excluded else ""
        known = "uncertainty not determined"
        if self.weakest_translation is not None and self.weakest_rotation is not None:
            move, turn = 1e3 * self.weakest_translation[1], np.degrees(self.weakest_rotation[1])
            known = f"{digits(move, 2)} mm, {digits(turn, 2)} deg (1 sigma, worst axis)"
            if self.opened is not None:
                known += f", {len(self.open_directions)} open"
        if self.reasons:
            known = f"NOT USABLE, {self.reasons[0]}"
        return f"Calibration({self.frame} by {self.method}, {data}: {known})"

    @cached_property
    def intrinsics_words(self) -> str | None:
        """The intrinsics that X belongs to in one sentence; None where the camera poses came without corners."""
        return intrinsics_words(self)

    def summary(self, verbose: bool = False, threshold: float = 0.5) -> str:
        """Return the result as text: the first screen, or with ``verbose`` the long text.

        The first screen has at most 26 lines of 80 columns. The long text lists correlations at or above ``threshold``.
        """
        if not isinstance(verbose, bool):
            raise InputError(f"Expected `verbose` to be True or False, got {verbose!r}; `threshold` goes by its name.")
        document = document_of(self, verbose=verbose, threshold=threshold)
        return to_text(document) if verbose else to_text(document, COLUMNS)

    def _repr_html_(self) -> str:
        """The result in a notebook: X with its standard deviations, warnings, and the numbers behind them."""
        return html_of(self)

    def report(
        self,
        path: str | Path,
        *,
        comparison: Methods = True,
        cross_check: CrossCheck | None = None,
        about: Mapping[str, str] | None = None,
        verdict: Verdicts | None = None,
        details: bool = False,
        paper: str = "a4",
        certificate: bool = False,
    ) -> Path:
        """Write the report as one self-contained file: two pages, then folded sections with everything else.

        Parameters
        ----------
        path : str or Path
            Its suffix selects the format: .html or .pdf.
        comparison : Comparison, Compared or bool
            The comparison of methods by `compare` or `compare_result`. True computes it, the only computation for a
            report; False leaves it out.
        cross_check : CrossCheck or None
            If given, its covariances are drawn over the ellipses and its relations listed.
        about : mapping or None
            Title block: cell, robot, camera, operator, ... (`files.about.ABOUT`), added to those of `about`.
        verdict : Verdict, mapping of the name of the camera to Verdict, or None
            Of a tolerance: PASS, FAIL or NOT SHOWN, with the probability.
        details : bool
            Unfold the folded sections, also in the PDF, which otherwise has the two pages only.
        paper : str
            Of the PDF: "a4" or "letter".
        certificate : bool
            Write the certificate in its place: the two pages that are signed and filed (`make_certificate`), with the
            suffix .json as data.

        Raises
        ------
        InputError
            A path with another suffix or that cannot be written.
        MissingExtraError
            A PDF where neither WeasyPrint (extra ``pdf``) nor a Chromium browser is installed.
        """
        from ..report.page import write_report

        return write_report(
            self, path, comparison=comparison, cross_check=cross_check, about=about, verdict=verdict, details=details,
            paper=paper, certificate=certificate,
        )  # fmt: skip

    @property
    def figures(self) -> tuple[str, ...]:
        """The names that `plot` takes for this result."""
        return figure_names(self)

    def plot(self, name: str | None = None) -> Figure:
        """Return a figure as a Matplotlib Figure, which notebooks show.

        Parameters
        ----------
        name : str or None
            One of `figures`: "ellipses", "rig", "residuals", "budget", "shared", "task_space", "workspace" or "methods"
            (which compares the methods first). None: the first of them.

        Raises
        ------
        InputError
            A name that is not among `figures`.
        """
        from ..report.figures import figure_of

        return figure_of(self, name)

    def export(self, path: str | Path, format: str | None = None, *, covariance_convention: str = "toolkit") -> Path:
        """X for another program: JSON, ROS, URDF, OpenCV, NPZ, or as a robot writes it; see `export`.

        ``format`` is a name in `export.FORMATS`; None takes it from the suffix. ``covariance_convention``: of the
        covariances in files of OpenCV and NPZ, a name in `conventions.CONVENTIONS`.
        """
        from ..formats.export import write_export

        return write_export(self, path, format, covariance_convention)

    def export_urdf(self, path: str | Path, urdf: str | Path, narrower: float = 0.5) -> CorrectedUrdf:
        """Write the URDF of the arm, corrected by the errors that the data determine, to ``path``.

        Numbers are corrected whose standard deviation is below ``narrower`` times the one assumed; their covariance,
        and the numbers left unchanged, are written to ``NAME.corrections.json`` (`prediction.corrected_urdf`). ``urdf``
        is the file that the arm was calibrated with.
        """
        return write_corrected_urdf(self.kinematics, path, urdf, narrower)

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table of the six numbers of X: value, standard deviation, unit."""
        import pandas as pd

        numbers = self.facts.X
        return pd.DataFrame(
            {
                "value": [one.value for one in numbers],
                "std": pd.array([one.sd for one in numbers], dtype="Float64"),
                "unit": [one.unit for one in numbers],
                "concise": [one.concise for one in numbers],
            },
            index=pd.Index([one.name for one in numbers], name=self.frame),
        )

    _if_any: ClassVar[str] = "about open kinematics posterior data excluded split camera_scale corrected"
    _in_file: ClassVar[str] = (
        f"method scale kind setup X covariance {DERIVED} n_poses n_pairs noise=_noise_in_file W covariance_W "
        "iterations covariance_kind reference noise_estimate=_estimate_in_file bound 4dpa=fourdpa fit poses=table "
        "analysis provenance about time_offset camera_scale shared open=opened kinematics posterior residuals "
        "headline usable answered reasons accuracy checks facts data=_data_in_file excluded split findings warnings "
        "corrected"
    )

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, lists and text, with units and convention; see `from_dict`."""
        found = {**head_of(OF_CAMERA), **super().to_dict()}
        columns = columns_of(found) if isinstance(self.noise, PoseNoise) else None
        for side, S in joint_sides(self.noise).items():
            found["noise"][side] = S.to_dict() if columns is None else columns.shortened(S, found["noise"][side])
        if isinstance(source := getattr(self.posterior, "source", None), OpenSizes):
            found["posterior"] = source.beside_noise(self.noise)  # columns of errors, once
        if self.posterior is not None and bound_to_data(self.posterior.bound, self.counted):
            found["posterior"]["bound"] = AS_DATA
        if self.opened is not None:
            found["open"]["words"] = list(self.open_words)
        if self._of_noise:
            found["noise_estimate"]["noise"] = AS_NOISE  # a row for each pose, once
        return found

    @property
    def _of_noise(self) -> bool:
        """True if the noise of the estimate is that of the result, with a row for each pose."""
        estimate = self.noise_estimate
        return estimate is not None and estimate.is_joint and estimate.noise is self.noise

    @property
    def _noise_in_file(self) -> Noise | None:
        return None if self.noise is None else self.noise.without_columns()

    @property
    def _estimate_in_file(self) -> NoiseEstimate | None:
        estimate = self.noise_estimate
        return replace(estimate, noise=self._noise_in_file) if estimate is not None and self._of_noise else estimate

    @property
    def _data_in_file(self) -> JsonObject | None:
        return None if self.data is None else data_to_dict(self.data)

    @classmethod
    def from_dict(cls, data: Any) -> Self:
        """The inverse of `to_dict`; raises `InputError` on anything else: parts that are missing, of another type, not
        finite, or that do not belong to each other."""
        return from_dict(cls, data)


def _are_poses(value: ArrayLike | RigidTransform, arm: FittedKinematics | None) -> bool:
    """Return whether an argument is poses (..., 4, 4), and not values of four joints in four rows."""
    if hasattr(value, "as_matrix"):
        return True
    array = np.asarray(value)
    of_four = arm is not None and arm.joints.shape[-1] == 4
    return array.shape[-2:] == (4, 4) and not (of_four and np.any(array[..., 3, :] != (0, 0, 0, 1)))
