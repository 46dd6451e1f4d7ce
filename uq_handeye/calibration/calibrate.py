"""The function `calibrate`: X with its uncertainty from poses or motions, with or without their noise.

The default method is maximum likelihood (`gauss_helmert`), started from 4DPA, whose own X and covariance stay in the
result; the alternative is a published method (`published_fit`). Where no noise is given it is estimated from the data
(`estimation`). Outliers are down-weighted (`robust`). Suspicious input is reported as findings (`fit.diagnostics`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from ..core.threads import one_thread
from ..errors import (
    DegenerateMotionError,
    InputError,
    NotConvergedError,
    SingularNoiseError,
    keywords_of,
    require_known,
)
from ..findings import Finding, renumbered, warn, without_consequences
from ..fit.diagnostics.repeated_rows import counted_once
from ..fit.graph.gauss_helmert import ESTIMATORS
from ..fit.graph.request import Request, documented
from ..fit.graph.scale_start import start_scale
from ..fit.graph.screws import scale_by_screws
from ..model.camera.adjustment.linearised import with_pictures
from ..model.errors.keys import CAMERA_SCALE
from ..model.errors.models import PoseNoise
from ..model.errors.sizes import Size, prior_to_dict
from ..model.poses.camera_scale import CameraScale
from ..model.poses.motions import Motions, relative_motions
from ..model.poses.pose_numbers import Selection, ranges, select_poses
from ..model.poses.pose_pairs import PosePairs, pairs_of
from ..model.rig.description import Rig, require_left_out
from ..model.rig.noise_by_name import NoiseByName
from ..model.rig.single import is_single, single_of
from .analysis import Analysis
from .by_likelihood import by_likelihood, poses_about_errors
from .by_published import by_published
from .by_rotation import by_rotation, without_positions
from .camera_of_result import corners_at_estimate
from .evidence.new_poses import residuals_against
from .findings import (
    flipped_poses,
    of_files,
    of_rotations,
    other_convention,
    reasons,
    require_determined,
    shifted,
    turned_pictures,
    why_failed,
)
from .job import Job, job_of
from .pair_findings import findings_of_pairs
from .parts import Provenance, provenance
from .result import Calibration
from .split_fit import SplitFit, split_fit, split_of_poses

if TYPE_CHECKING:
    from .rig_result import RigCalibration


@overload
def calibrate(data: Rig, **options: Any) -> Calibration | RigCalibration: ...
@overload
def calibrate(
    data: PosePairs | Motions | ArrayLike, camera: ArrayLike | None = None, **options: Any
) -> Calibration: ...
def calibrate(
    data: Any,
    camera: ArrayLike | None = None,
    *,
    setup: str | None = None,
    exclude: Sequence[int] | str | None = None,
    only: Sequence[int] | str | None = None,
    **asked: Any,
) -> Any:
    """X with its covariance, residuals and warnings.

    Parameters
    ----------
    data : PosePairs or Motions; or (n, 4, 4) robot poses base_T_gripper, together with `camera`; or Rig
        Robot and camera poses are arrays, lists, or SciPy's RigidTransform. A Rig of one camera, one target and one arm
        is the same data; of several (`RigCalibration`) noise is given by names, priors of poses are ``Rig(known=...)``,
        an error of one camera is made by `SharedError.of`, a size of one called such as ``left:camera rotation``.
    camera : (n, 4, 4) or None
        Camera poses camera_T_target.
    setup : "eye-in-hand" (None) or "eye-to-hand"
        Setup of robot and camera poses given as arrays.
    **asked
        The fields of `Request`.
    exclude, only : sequence of int, text such as ``"12,14-16"``, or None
        Numbers of poses to leave out, or of the only ones to use, counted from 0 in ``data``. The fit is that of the
        rest. The excluded poses stay in ``result.data`` and ``result.table``, with their residuals against the fit and
        the weight 0. A camera calibration from corners stays that of all its pictures.

    Motions that leave directions of X open (parallel axes of a SCARA or a vehicle, pure translations of a gantry) are
    accepted by ``efficient`` and ``ml``: ``result.open_directions`` has these directions, X is one of all that fit, and
    the covariance is that of the other directions. Published methods refuse them.

    Where poses are given, W comes with X (for a published method the mean of ``G X C``, `robot_world`), with its
    covariance if the noise is on the poses. A method that weights by the noise (``nguyen``) takes the
    covariance of each pair that PoseNoise makes.

    Raises
    ------
    InputError
        Input that cannot be used.
    DegenerateMotionError
        The motions determine nothing of X; or, with a published method, not all of it: their rotations do not exceed
        their noise (`diagnostics.rotations.require_signal`), or leave its rotation uncertain by more than 20
        degrees, where a first-order covariance is meaningless: only then ``partial`` holds the `Calibration`.
    NotConvergedError
        An iterative method did not converge.

    Warns
    -----
    InputWarning
        Input that looks wrong; each is also among the ``findings`` of the result.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> result = uq.calibrate(uq.simulate(n_poses=30, noise=noise, seed=1), noise=noise)
    >>> (result.std[3:] * 1e3).round(2)  # mm
    array([0.34, 0.34, 0.28])
    """
    require_known("calibrate", asked, Request)
    if isinstance(data, Rig):
        require_left_out("of a rig", camera=camera, setup=setup)
        if not is_single(data):
            return _calibrate_rig(data, exclude, only, **asked)
        data, options = single_of(data, asked.pop("noise", None))
        if twice := [name for name in options if asked.get(name) is not None]:
            raise InputError(f"Expected `{twice[0]}` once: the rig has it, too. Leave it out, or take it from the rig.")
        asked |= options
    taken: Any = pairs_of(data, camera, setup)
    request = Request(**asked)
    if not isinstance(taken, PosePairs) or taken.robot.ndim != 3:
        if exclude is not None or only is not None:
            raise InputError("Expected PosePairs of one data set beside `exclude` or `only`: they count its poses.")
        return _answer(request, taken)
    chosen = select_poses(taken.n, exclude, only)
    selection, said = counted_once(taken, chosen)
    if selection is None:
        return _answer(request, taken)
    result = _answer(request.rows(taken, selection), taken.rows(selection.kept), selection, said)
    return _with_excluded(result, taken, selection, () if chosen is None else tuple(chosen.excluded.tolist()))


calibrate.__signature__ = keywords_of(calibrate, Request)  # type: ignore[attr-defined]
calibrate.__doc__ = documented(calibrate.__doc__)


def _calibrate_rig(
    data: Rig, exclude: Any, only: Any, noise: NoiseByName | None = None, shared: Any = None, **asked: Any
) -> RigCalibration:
    """See `calibrate`; of a rig of several cameras, targets or arms."""
    from ..model.rig.selection import selected
    from .calibrate_rig import OPTIONS, calibrate_rig, noise_of_views

    defaults = {name: field.default for name, field in Request.__dataclass_fields__.items()}
    others = {name: value for name, value in asked.items() if name not in OPTIONS and np.size(value)}
    left = {name: np.ndim(value) == 0 and value == defaults[name] for name, value in others.items()}
    where = "of several cameras, targets or arms"
    require_left_out(where, **{name: others[name] for name, silent in left.items() if not silent})
    options = {name: value for name, value in asked.items() if name in OPTIONS} | {"shared": shared}
    rig, excluded = selected(data, exclude, only)
    try:
        result = calibrate_rig(rig, noise, **options)
    except (InputError, NotConvergedError) as error:
        error.findings = tuple(without_consequences(findings_of_pairs(rig, None)))
        warn(error.findings, 4)
        raise
    found = without_consequences([*result.findings, *findings_of_pairs(rig, result), *excluded])
    if noise is not None and result.contradictions and not any(one.explains for one in found):
        found += noise_of_views(rig, result, **options)
    moved = next((one for one in found if one.code == "rig.moved"), None)
    split = None if moved is None else split_fit(rig, noise, moved, **options)
    if split is not None:
        found = [split.finding if one is moved else one for one in found]
        result = replace(result, split=split.poses)
    warn(found, 4)
    return replace(result, findings=tuple(found))


def _with_excluded(result: Calibration, data: PosePairs, selection: Selection, asked: tuple[int, ...]) -> Calibration:
    """Return the result of the poses that count, with the excluded ones added to its data and its table.

    ``asked``: the poses that were excluded by request; the others repeat a pose.
    """
    excluded = tuple(selection.excluded.tolist())
    table, analysis, whole = result.table, result.analysis, result.data
    if isinstance(whole, PosePairs):
        robot = data.robot.copy()
        robot[selection.kept] = whole.robot  # those of an arm may replace the measured ones
        camera, seen = data.camera, data.camera_calibration
        if seen is not None and whole.camera_calibration is not None:  # linearised elsewhere
            bundle = with_pictures(seen.bundle, seen.corners, selection.kept, whole.camera_calibration.bundle)
            camera, seen = bundle.poses, seen.with_bundle(bundle)
        timing = data.timing
        if timing is not None and whole.timing is not None:
            timing = replace(timing, std=whole.timing.std)  # may have been given
        whole = replace(data, robot=robot, camera=camera, camera_calibration=seen, timing=timing)
    values: dict[str, Any] = {"excluded": list(asked), "fit": None, "limit": None}
    if table is not None and table.item == "pose" and result.W is not None:
        found = residuals_against(result, data.rows(selection.excluded))
        table = table.among(data.n, excluded, *found)
        fits = found.distance2 <= table.limit
        fit = [k for k, fits_too in zip(excluded, fits, strict=True) if fits_too and k in asked]
        values |= {"fit": fit, "limit": table.limit}
    if isinstance(analysis, Analysis):
        analysis = replace(analysis, numbers=tuple(selection.kept.tolist()))
    said = [Finding("calibration.excluded", "note", values | {"n": data.n})] if asked else []
    findings = (*result.findings, *said)
    return replace(result, data=whole, table=table, analysis=analysis, excluded=excluded, findings=findings)


def _answer(
    request: Request, data: PosePairs | Motions, selection: Selection | None = None, said: Sequence[Finding] = ()
) -> Calibration:
    """See `calibrate`; ``selection``: the numbers that the poses have in the data set they are taken from; ``said``:
    findings about that data set.
    """
    if isinstance(data, PosePairs) and without_positions(data):
        return _by_rotation(request, data, selection, said)
    if request.opens_scale or (isinstance(data, PosePairs) and data.scene is not None):
        return _with_open_scale(request, data, selection, said)
    result, findings = _found(request, data, selection, said)
    warn(findings, 3)
    return result


def _with_open_scale(
    request: Request, data: PosePairs | Motions, selection: Selection | None, said: Sequence[Finding]
) -> Calibration:
    """Return X of camera poses of unknown scale: one more unknown, about which the poses are scaled again."""
    of_scene = isinstance(data, PosePairs) and data.scene is not None
    noise = request.noise
    if of_scene and noise is not None and (not isinstance(noise, PoseNoise) or noise.camera is not None):
        raise InputError(
            "The noise of camera poses of a scene comes from its pictures. Give that of the robot poses alone."
        )
    if not isinstance(data, PosePairs) or (not of_scene and (data.camera_known or noise is not None)):
        raise InputError(
            "An unknown scale of the camera needs camera poses of another program and estimated noise: motions, "
            "corners of a board and given noise have a scale. Leave out camera_scale (--camera-scale), or the noise."
        )
    if request.taken_method not in ESTIMATORS:
        raise InputError(f"Method {request.taken_method!r} takes no unknown scale; use efficient or ml.")
    by_screws = scale_by_screws(data.effective_robot, data.camera)
    factor = start_scale(data.effective_robot, data.camera, request.seed) if by_screws is None else by_screws[0]
    if factor is None:
        raise InputError(
            "The poses do not determine the scale of the camera. Its lengths must change with those of the robot: "
            "rotate about two axes and move, in 6 poses or more; and check camera_frame (--camera-frame) and setup."
        )
    opened = request.with_scale(data.intrinsics_covered)
    for _ in range(5):  # times at most that the camera poses are scaled
        scaled = data.scaled(factor)
        if isinstance(noise, PoseNoise):
            opened = replace(opened, noise=replace(noise, camera=scaled.camera_covariance))
        result, findings = _found(opened, scaled, selection, said)
        error = next((one for one in result.shared_at_sizes if one.key == CAMERA_SCALE), None)
        # the poses used are (1 + e) times as large as true ones; None: they fit exactly
        if error is None or abs(error.estimate) < max(0.1 * error.sd, 1e-6):  # or rounding
            break
        factor /= 1.0 + error.estimate
    scale = CameraScale(factor, 0.0 if error is None else factor * error.sd)
    code = "calibration.scene_scale" if of_scene else "calibration.camera_scale"
    finding = Finding(code, "note", {"factor": scale.factor, "std": scale.std})
    findings = [*findings, finding]
    warn(findings, 4)
    return replace(result, camera_scale=scale, findings=tuple(findings))


def _found(
    request: Request, data: PosePairs | Motions, selection: Selection | None, said: Sequence[Finding]
) -> tuple[Calibration, list[Finding]]:
    """Return the result and its findings, before they are given as warnings."""
    with one_thread():  # as `_run`
        job = job_of(request, data)
    findings = [*said, *of_files(job), *([] if job.arm is None else job.arm.against.findings)]
    try:
        job, result, more = _linearised(job, data)
    except (InputError, NotConvergedError) as error:
        found = without_consequences(_of_open([*findings, *of_rotations(job), *reasons(job)]))
        error.findings = tuple(_numbered(found, selection))  # may well be the reason
        warn(error.findings, 3)
        raise
    findings += [*of_rotations(job, result.table), *more]  # an outlier says nothing of the rows that X is of
    if result.opened is not None:  # its finding includes that of parallel axes
        findings = [finding for finding in findings if finding.code != "input_checks.parallel_axes"]
    if flips := [*flipped_poses(job, result), *turned_pictures(job, result)]:  # which are why angles disagree
        findings = [finding for finding in findings if finding.code != "input_checks.angles_disagree"]
    findings += other_convention(job, result)
    findings = without_consequences([*findings, *shifted(job, result), *flips])
    if (split := _split(job, findings, selection)) is not None:
        result = replace(result, split=split.poses)
        findings = [split.finding if one.code == split.finding.code else one for one in findings]
    findings = _numbered(findings, selection)
    result = replace(result, findings=tuple(findings), provenance=_origin(job, data, result.method, selection))
    try:
        require_determined(result, job.motions)
    except DegenerateMotionError as error:
        error.findings = tuple(why_failed(findings))
        warn(error.findings or findings, 3)
        raise
    return result, findings


def _split(job: Job, findings: Sequence[Finding], selection: Selection | None) -> SplitFit | None:
    """Return the fit before and after the move that was found, if one was."""
    moved = next((one for one in findings if one.code == "rig.moved"), None)
    if moved is None or job.poses is None:
        return None
    row = int(moved.values["since"])
    number = row if selection is None else int(selection.kept[row])
    return split_of_poses(job.poses, job.request.noise, moved, str(number), seed=int(job.request.seed))


def _of_open(findings: Sequence[Finding]) -> list[Finding]:
    """Return findings without misfits of an X that motions about one axis leave open: it explains no poses."""
    if not any(one.code == "input_checks.parallel_axes" for one in findings):
        return list(findings)
    return [one for one in findings if one.code != "input_checks.poses_unexplained" or one.values["readings"]]


def _by_rotation(
    request: Request, data: PosePairs, selection: Selection | None, said: Sequence[Finding]
) -> Calibration:
    """See `_answer`: of poses whose positions are not given."""
    job, result, found = by_rotation(request, data)
    findings = _numbered([*said, *data.findings, *found], selection)
    warn(findings, 3)
    return replace(result, findings=tuple(findings), provenance=_origin(job, data, result.method, selection))


def _origin(job: Job, data: PosePairs | Motions, method: str, selection: Selection | None) -> Provenance:
    """Record data and options."""
    request = job.request
    sizes = cast("dict[str, Size]", request.sizes)
    options = {
        "method": method,
        "pairs": request.pairs if isinstance(request.pairs, str) else f"{len(job.motions)} given",
        "scale": request.scale,
        "kind": request.kind,
        "covariance": request.covariance,
        "robust": job.robust,
        "prior": None if request.prior is None else prior_to_dict(request.prior),
        **({} if job.pose_prior is None else {"pose_prior": job.pose_prior.to_dict()}),
        "seed": int(request.seed),
        "correlation": request.correlation,
        "shared": [line for error in job.shared for line in error.described],
        **({} if not sizes else {"sizes": {name: [s.median, s.factor] for name, s in sizes.items()}}),
        **({} if not request.components else {"components": [part.name for part in request.components]}),
        **({} if selection is None else {"exclude": ranges(selection.excluded.tolist())}),
    }
    about = None if job.arm is None else job.arm.at
    simulated = job.poses is not None and job.poses.truth is not None
    return provenance(data, options, request.to_dict(about, simulated))


def _numbered(findings: Sequence[Finding], selection: Selection | None) -> list[Finding]:
    """Return findings with the numbers of poses as in the whole data set."""
    return list(findings) if selection is None else [renumbered(one, selection.kept.tolist()) for one in findings]


def _run(job: Job) -> tuple[Calibration, list[Finding]]:
    if job.noise is None and job.method in ESTIMATORS:  # many small matrices, for which threads only wait
        with one_thread():
            return by_likelihood(job)
    return by_likelihood(job) if job.method in ESTIMATORS else by_published(job)


def _linearised(job: Job, data: PosePairs | Motions) -> tuple[Job, Calibration, list[Finding]]:
    """Return X, with errors of an arm and corners linearised at their estimate: the request it is of, X, findings."""
    try:
        result, more = _run(job)
        for _ in range(2):  # times at most that they are linearised again
            about = poses_about_errors(job, result)
            seen = corners_at_estimate(result) if job.request.camera_of_data else None
            again = job.poses if about is None else about
            if again is None or (about is None and seen is None):
                break
            if seen is not None:
                again = replace(again, camera=seen.poses, camera_calibration=seen)
            request, at = job.request, None
            if job.arm is not None and result.kinematics is not None:
                request = replace(request, joints=result.kinematics.joints)
                e = job.arm.at if about is None else result.kinematics.e
                at = None if e is None else (job.arm.measured, e)
            job = job_of(
                request, again if data is data.poses else relative_motions(again, np.asarray(job.motions.pairs)), at
            )
            result, more = _run(job)
    except (InputError, NotConvergedError) as error:
        return _plainer(job, error)
    return job, result, more


def _plainer(job: Job, error: Exception) -> tuple[Job, Calibration, list[Finding]]:
    """Estimate X without weights that the user did not request: those of the noise, or the robust ones.

    Noise that leaves residuals exact cannot weight them: X is then that of 4DPA. The fit without robust weights is used
    where the robust one does not determine X, or where with given noise it finds no X on which most poses agree; a
    warning then reports the residuals that contradict that noise. In all other cases the error is raised.
    """
    request = job.request
    match error:
        case SingularNoiseError():
            if request.method is not None or request.robust:
                raise error
            job = replace(job, method="4dpa", robust=False)
            result, findings = by_published(job)
            return job, result, [Finding("calibration.unweighted", "caution"), *findings]
        case DegenerateMotionError():
            said = Finding("calibration.robust_skipped", "caution")
        case _:
            said = Finding("calibration.robust_failed", "caution", {"error": str(error)})
    undetermined = said.code == "calibration.robust_skipped"
    if request.robust or not job.robust or (request.noise is None and not undetermined):
        raise error
    job = replace(job, robust=False)
    try:
        result, findings = _run(job)
    except (InputError, NotConvergedError):
        if undetermined:
            raise error from None
        raise
    if undetermined and (result.table is None or (result.table.distance2 > result.table.limit_of_all).any()):
        raise error  # only the outliers seem to determine X
    return job, result, [said, *findings]
