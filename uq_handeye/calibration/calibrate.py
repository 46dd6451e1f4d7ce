"""calibrate(): from poses or motions, with or without their noise, to X with its uncertainty.

The estimate is `likelihood` by default, started from 4DPA, whose own X and covariance stay in the result; or a
published method (`published`). Where no noise is given it is estimated from the data (`noise_estimation`), with gross
errors weighted down (`robust`). What looks wrong is said (`plausibility`, `pairing`, `diagnostics`, `split_half`).
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace

import numpy as np
from numpy.typing import ArrayLike

from ..diagnostics.pose_table import PoseTable, pose_table
from ..empirical_covariance.resampled import Resampled, resampled
from ..errors import DegenerateMotionError, InputError, InputWarning, NotConvergedError, SingularNoiseError
from ..estimators.registry import ROBOT_WORLD_METHODS
from ..geometry.se3 import Array
from ..input_checks.checks import check_fit, check_motions, check_poses, check_rotations, require_signal
from ..input_checks.shifted_rows import find_shift, shifted_run
from ..likelihood.constraint import Unknowns
from ..likelihood.d2_distribution import Reference
from ..likelihood.gauss_helmert import ESTIMATORS, Fit, efficient, offset_sensitivity
from ..likelihood.goodness_of_fit import effective_dof, goodness_of_fit
from ..likelihood.rig_bundle import Agreement, adjust_rig
from ..likelihood.robust import RobustFit, robust_fit
from ..noise.estimate import NoiseEstimate, NoisePrior
from ..noise.models import Noise, PairNoise, PoseNoise
from ..noise_estimation.estimate import estimate_noise
from ..poses.motions import Motions, relative_motions
from ..poses.pose_pairs import PosePairs
from ..poses.residuals import Residuals, residuals, rotation_angles, summarise
from ..poses.timing import TimeOffset, left_out_of
from ..propagation.published_fit import Published, fit_published
from .analysis import Analysis
from .findings import require_determined
from .provenance import provenance
from .request import BUNDLE, FEWEST_FOR_ROBUST, Job, request
from .result import Calibration
from .result_file import FourDPA

# Beyond this angle of X (degrees) the errors of Tsai's Rodrigues vector grow by a factor of ten and more.
NEAR_HALF_TURN_OF_X = 170.0

# Data whose residuals (rad, and relative to the longest translation) are smaller come from a simulation without noise.
EXACT = 1e-10

# Probability below which residuals contradict a data sheet.
RARE = 1e-4

# Probability below which two halves of the data contradict each other.
CONTRADICTION = 1e-3

# Difference of bundle adjustment and `efficient`, in standard deviations, or ratio of variances, that is warned of.
APART = 1.5

# RMS rotation residual of the pairs (rad) from which on a shifted pairing of the rows is looked for.
SUSPICIOUS = np.radians(1.0)


def calibrate(
    data: PosePairs | Motions,
    *,
    noise: Noise | None = None,
    method: str | None = None,
    pairs: str | ArrayLike = "all",
    scale: float | None = None,
    kind: str | None = None,
    covariance: str = "model",
    robust: bool | None = None,
    prior: NoisePrior | None = None,
    seed: int = 0,
) -> Calibration:
    """X with its covariance, residuals and warnings.

    Parameters
    ----------
    data : PosePairs or Motions
    noise : PoseNoise, PairNoise or None
        Noise of the poses or of the motions. None estimates it from the data (`estimate_noise`): isotropic components
        for rotation and translation of robot and camera. Camera poses from corners (``data.camera_calibration``) bring
        their joint covariance: it is used where `noise` is None, and the robot's noise estimated beside it, or where
        `noise` has no ``camera``.
    method : str or None
        ``efficient``, at the Cramer-Rao bound; ``ml``, its iteration to maximum likelihood; ``bundle``, on the corners
        themselves, for camera poses from corners (`rig_bundle`), with `efficient` beside it; a name in `METHODS` or,
        for poses, in `ROBOT_WORLD_METHODS`. None is ``efficient``; or ``4dpa`` where `scale` or `kind` ask for it, or
        where the noise given leaves a part of the residuals exact, so that nothing can be weighted by its inverse.
    pairs : "all", "consecutive", "disjoint" or (N, 2) integers
        Pairs to make of the poses (`relative_motions`); Motions come with theirs. ``efficient`` and ``ml`` work on the
        poses themselves; for them, as for `ROBOT_WORLD_METHODS`, pairs serve 4DPA and the residuals alone.
    scale : float or None
        Scaling factor d of 4DPA; None is its limit (`solve`).
    kind : str or None
        How noise is propagated through a published method (`propagate`).
    covariance : "model", "sigma-points", "sandwich", "hac", "jackknife" or "bootstrap"
        ``model``: that of the noise, to first order; ``sigma-points``: the same beyond first order, about the true X
        and of X alone (`sigma_point_covariance`); the others come from the residuals of the poses and need no noise
        model (`resampling`).
    robust : bool or None
        Weight gross errors down and say which (`robust`), by ``efficient`` and ``ml``. None does so where the noise is
        estimated, which they would spoil.
    prior : NoisePrior or None
        What is known of the noise to be estimated, for example from a data sheet.
    seed : int
        Of the random subsets and bootstrap replicates.

    Where poses are given, W comes with X (for a published method the mean of ``G X C``, `robot_world`), with its
    covariance if the noise is on the poses. A method that weights by the noise (``nguyen``) takes the
    covariance of each pair that PoseNoise makes.

    Raises
    ------
    InputError
        Input that cannot be used.
    DegenerateMotionError
        The motions do not determine X; or their rotations do not stand out of their noise (`require_signal` in
        `plausibility`); or with this noise they leave its rotation open by more than 20 degrees, where a
        first-order covariance means nothing: only then ``partial`` holds the `Calibration`.
    NotConvergedError
        An iterative method did not converge.

    Warns
    -----
    InputWarning
        Input that looks wrong; the texts are also in ``warnings`` of the result.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> result = uq.calibrate(uq.simulate(n_poses=30, noise=noise, seed=1), noise=noise)
    >>> (result.std[3:] * 1e3).round(2)  # mm
    array([0.34, 0.34, 0.28])
    """
    job = request(data, noise, method, pairs, scale, kind, covariance, robust, prior, seed)
    texts = [] if job.poses is None else check_poses(job.poses)
    if job.motions.N >= 2:
        texts += check_rotations(job.motions, noise, job.method)
    try:
        try:
            result, more = _run(job)
        except SingularNoiseError:
            if method is not None or robust:
                raise
            result, more = _by_published(replace(job, method="4dpa"))
        except DegenerateMotionError as error:
            if robust or not job.robust:
                raise
            result, more = _without_robust(job, error)
    except (InputError, NotConvergedError):
        for text in texts + _reasons(job):  # what looks wrong may well be the reason
            warnings.warn(text, InputWarning, stacklevel=2)
        raise
    texts += more
    texts += _shifted(job, result)
    options = {
        "method": result.method,
        "pairs": pairs if isinstance(pairs, str) else f"{len(job.motions)} given",
        "scale": scale,
        "kind": kind,
        "covariance": covariance,
        "robust": job.robust,
        "prior": None if prior is None else asdict(prior),
        "seed": job.seed,
    }
    result = replace(result, warnings=tuple(texts), provenance=provenance(data, options))
    for text in texts:
        warnings.warn(text, InputWarning, stacklevel=2)
    require_determined(result, job.motions)
    return result


def _run(job: Job) -> tuple[Calibration, list[str]]:
    if job.method == BUNDLE:
        return _by_bundle(job)
    return _by_likelihood(job) if job.method in ESTIMATORS else _by_published(job)


def _by_bundle(job: Job) -> tuple[Calibration, list[str]]:
    """`efficient`, which finds noise and wrong poses, and the bundle adjustment from there."""
    result, texts = _by_likelihood(replace(job, method="efficient"))
    analysis, poses = result.analysis, job.poses
    assert isinstance(analysis, Analysis) and isinstance(analysis.noise, PoseNoise) and poses is not None
    assert result.covariance is not None
    fit, robot = analysis.fit, analysis.noise.robot
    begun = time.perf_counter()
    efficient(poses, analysis.noise, result.X)
    between = time.perf_counter()
    found = adjust_rig(poses, robot, fit.unknowns, fit.weights)
    seconds = time.perf_counter() - between, between - begun
    agreement = Agreement.of(found.X, found.covariance_X, fit.X, fit.covariance_X, seconds)
    of_offset = result.covariance - fit.covariance_X
    angle, distance = residuals(job.motions.A, job.motions.B, found.X)
    result = replace(
        result,
        X=found.X,
        W=found.W,
        covariance=found.covariance_X + of_offset,
        covariance_W=found.covariance_W,
        method=BUNDLE,
        iterations=found.iterations,
        residuals=summarise(angle, distance),
        agreement=agreement,
    )
    if agreement.distance > APART or not 1 / APART < agreement.eigenvalues[0] <= agreement.eigenvalues[-1] < APART:
        texts.append(
            f"{agreement.sentence} They should agree to first order: errors are too large for that, or wrong poses or "
            "corners spoil one of them."
        )
    return result, texts


def _by_likelihood(job: Job) -> tuple[Calibration, list[str]]:
    """`efficient` or `ml`, with 4DPA beside it."""
    start = fit_published(job.motions, job.noise, "4dpa", None, job.everything)
    angle, distance = residuals(job.motions.A, job.motions.B, start.X)
    require_signal(job.motions, job.noise, angle)
    data, noise = job.data, job.noise
    robust: RobustFit | None = None
    estimate: NoiseEstimate | None = None
    exact = noise is None and max(angle.max(), distance.max() / _longest(job.motions)) < EXACT
    if job.robust and not exact:
        estimates: list[NoiseEstimate] = []

        def by_residuals(data: PosePairs | Motions, X: Array, weights: Array) -> Noise | None:
            estimates.append(estimate_noise(data, job.prior, start=X, weights=weights))
            return estimates[-1].noise

        robust = robust_fit(data, noise, method=job.method, estimate=by_residuals, seed=job.seed)
        noise, estimate = robust.noise, (estimates[-1] if estimates else None)
    elif noise is None:
        estimate = estimate_noise(data, job.prior, start=start.X)
        noise = estimate.noise
    if noise is None:  # the data fit exactly: there are no weights, and all estimates agree
        assert estimate is not None
        if robust is not None:  # once wrong ones are left out
            kept = replace(start, X=robust.fit.X, W=robust.fit.W)
            result, texts = _unweighted(job, kept, estimate)
            table = pose_table(robust.fit, robust)
            return replace(result, table=table), [*table.statements, *texts]
        return _unweighted(job, start, estimate)
    fit = ESTIMATORS[job.method](data, noise, start.X) if robust is None else robust.fit
    return _assembled(job, noise, fit, start, estimate, robust)


def _without_robust(job: Job, error: DegenerateMotionError) -> tuple[Calibration, list[str]]:
    """The plain fit where the robust one, which was not asked for, does not determine X; else its error."""
    try:
        result, texts = _run(replace(job, robust=False))
    except (InputError, NotConvergedError):
        raise error from None
    if result.table is None or (result.table.distance2 > result.table.limit_of_all).any():
        raise error  # it is the wrong poses that seem to determine X
    said = (
        "Wrong poses were not looked for, and any of them spoil X: the poses that agree with each other do not "
        "determine X by themselves, all together do. Add poses that turn about other axes."
    )
    return result, [said, *texts]


def _longest(motions: Motions) -> float:
    """The longest translation, or 1 if there is none."""
    data = (motions.A, motions.B) if motions.poses is None else (motions.poses.robot, motions.poses.camera)
    return max(float(np.abs(T[:, :3, 3]).max()) for T in data) or 1.0


def _assembled(
    job: Job, noise: Noise, fit: Fit, start: Published, estimate: NoiseEstimate | None, robust: RobustFit | None
) -> tuple[Calibration, list[str]]:
    data, motions, poses = job.data, job.motions, job.poses
    reference = of_model = _reference(fit, estimate)
    covariance, covariance_W = fit.covariance_X, fit.covariance_W
    if job.covariance == "sigma-points":
        covariance, covariance_W = _by_sigma_points(job, noise, robust), None
    elif job.covariance != "model":
        found = resampled(data, job.method, job.covariance, fit=fit, seed=job.seed)
        covariance, covariance_W, reference = found.covariance_X, found.covariance_W, reference_of(found)
    time_offset, move = _time_offset(poses, fit, covariance)
    if move is not None:
        of_offset = np.outer(move, move)
        covariance = covariance + of_offset[:6, :6]
        covariance_W = None if covariance_W is None else covariance_W + of_offset[6:, 6:]
    table = pose_table(fit, robust)
    # Beside a camera covariance from corners the noise counts as known: most of it, or the test errs on the safe side.
    dof = None if estimate is not None and estimate.from_corners else of_model.dof
    analysis = Analysis(data, noise, fit, job.method, estimate, dof, job.seed)
    angle, distance = residuals(motions.A, motions.B, fit.X)
    result = replace(
        _bare(job, fit.X, fit.W, summarise(angle, distance), noise),
        covariance=covariance,
        covariance_W=covariance_W,
        iterations=fit.iterations if job.method == "ml" else 0,
        covariance_kind=job.covariance,
        reference=reference,
        noise_estimate=estimate,
        bound=fit.covariance_X,
        fourdpa=FourDPA(start.X, start.covariances(noise)[0]),
        fit=goodness_of_fit(fit),
        table=table,
        time_offset=time_offset,
        analysis=analysis,
    )
    texts = table.statements if robust else _wrong(job, noise, table)
    if poses is None or isinstance(noise, PairNoise):
        texts += check_motions(motions, None if estimate else noise, fit.covariance_X, angle, distance, fit.X)
    else:
        assert isinstance(noise, PoseNoise)
        kept = table.weight > 0
        whole = bool(kept.all())
        rest, rest_noise = (poses, noise) if whole else (poses.rows(kept), noise.rows(kept))
        # noise that was estimated explains any residuals
        texts += check_fit(rest, fit.X, None if estimate else rest_noise, None if estimate else fit.covariance_X)
    texts += analysis.diagnostics.warnings()
    for test in (analysis.split_half, analysis.split_in_time):
        if test.p_value is not None and test.p_value < CONTRADICTION:
            texts.append(test.sentence)
    if estimate is not None:
        texts += _against_data_sheet(result) + _against_corners(estimate) + analysis.diagnostics.shared_errors()
        if len(data) < FEWEST_FOR_ROBUST:
            texts.append(
                f"With {len(data)} {table.item}s a wrong one cannot be told from the others: take at least "
                f"{FEWEST_FOR_ROBUST}."
            )
    return result, texts


def _time_offset(poses: PosePairs | None, fit: Fit, covariance: Array) -> tuple[TimeOffset | None, Array | None]:
    """What the offset of interpolated poses does to X, and one standard deviation of it as a move (12,) of X and W."""
    timing = None if poses is None else poses.timing
    if timing is None or fit.W is None:
        return None, None
    g = offset_sensitivity(fit, timing)
    move = timing.std * g
    added = float(move[:6] @ np.linalg.solve(covariance, move[:6]))
    sensitivity = tuple(float(value) for value in g[:6])
    return TimeOffset(timing.offset, timing.std, timing.side, sensitivity, added / (1.0 + added)), move


def _against_data_sheet(result: Calibration) -> list[str]:
    """Whether the residuals contradict what was taken as known of the noise."""
    estimate, fit = result.noise_estimate, result.fit
    if estimate is None or fit is None or not estimate.has_prior or fit.p_value > RARE:
        return []
    how = {
        what: f"{ratio:.2g} times larger" if ratio > 1 else f"{1 / ratio:.2g} times smaller"
        for what, ratio in (("rotation", fit.rotation_sigma0), ("translation", fit.translation_sigma0))
    }
    return [
        f"The rotation residuals are {how['rotation']}, the translation residuals {how['translation']} than the noise "
        f"taken from the data sheet explains (chi-square test, p = {fit.p_value:.1g}): it is not that of these data, "
        "and the standard deviations of X are wrong by up to that."
    ]


def _against_corners(estimate: NoiseEstimate) -> list[str]:
    """Whether the residuals contradict the covariance of camera poses from corners."""
    factor = estimate.camera_factor
    if factor is None or factor.p_value > RARE:
        return []
    from ..noise_estimation.statements import camera_factor_words

    return [camera_factor_words(factor)]


def _wrong(job: Job, noise: Noise, table: PoseTable) -> list[str]:
    """Which poses a plain fit should leave out: robust estimation tells, as gross errors spoil all residuals."""
    if not (table.distance2 > table.limit_of_all).any():
        return []
    with suppress(InputError, NotConvergedError):
        found = robust_fit(job.data, noise, method="efficient", seed=job.seed)
        table = pose_table(found.fit, found)
        table = replace(table, flag=tuple("kept" if flag == "kept" else "outlier" for flag in table.flag))
    return table.statements


def _by_published(job: Job) -> tuple[Calibration, list[str]]:
    """A method of METHODS or ROBOT_WORLD_METHODS."""
    motions, poses = job.motions, job.poses
    found = fit_published(motions, job.noise, job.method, job.scale, job.everything)
    angle, distance = residuals(motions.A, motions.B, found.X)
    require_signal(motions, job.noise, angle)
    noise, estimate, reference = job.noise, None, Reference()
    if noise is None:
        try:
            estimate = estimate_noise(job.data, job.prior, start=found.X)
        except (InputError, NotConvergedError) as error:  # X does without
            return _unweighted(job, found, None, [str(error)])
        if estimate.noise is None:
            return _unweighted(job, found, estimate)
        noise = estimate.noise
        reference = _reference(efficient(job.data, noise, found.X), estimate)
    covariance, covariance_W = found.covariances(noise, job.kind)
    if job.covariance == "sigma-points":
        covariance, covariance_W = _by_sigma_points(job, noise, None), None
    elif job.covariance != "model":
        every_pair = job.everything is not None or job.method in ROBOT_WORLD_METHODS
        data = poses if poses is not None and every_pair else motions
        resample = resampled(data, job.method, job.covariance, X=found.X, noise=noise, seed=job.seed)
        covariance, covariance_W, reference = resample.covariance_X, resample.covariance_W, reference_of(resample)
    if poses is None:
        texts = check_motions(motions, None if estimate else noise, covariance, angle, distance, found.X)
    else:
        given = noise if isinstance(noise, PoseNoise) and estimate is None else None
        texts = check_fit(poses, found.X, given, None if given is None else covariance)
    turn = float(np.degrees(rotation_angles(found.X[:3, :3])))
    if job.method == "tsai" and turn > NEAR_HALF_TURN_OF_X:
        texts.append(
            f"X turns by {turn:.1f} degrees. The Rodrigues vector that Tsai's method solves for grows without bound at "
            "180 degrees, and so do its errors: use another method."
        )
    if poses is not None:
        texts += left_out_of(f"method {job.method!r}", poses.timing)
    result = replace(
        _bare(job, found.X, found.W, summarise(angle, distance), noise),
        covariance=covariance,
        covariance_W=covariance_W,
        iterations=found.iterations,
        covariance_kind=job.covariance,
        reference=reference,
        noise_estimate=estimate,
    )
    return result, texts


def _unweighted(
    job: Job, found: Published, estimate: NoiseEstimate | None, texts: Sequence[str] = ()
) -> tuple[Calibration, list[str]]:
    """X without covariance, where the noise cannot be estimated: the data fit exactly, or not at all."""
    angle, distance = residuals(job.motions.A, job.motions.B, found.X)
    result = _bare(job, found.X, found.W, summarise(angle, distance), None)
    more = [] if job.poses is None else check_fit(job.poses, found.X, None, None)
    if job.covariance != "model":
        more.append(f"There is no covariance {job.covariance!r}: without noise there is nothing to make it of.")
    return replace(result, noise_estimate=estimate, kind=None), [*texts, *more]


def _bare(job: Job, X: Array, W: Array | None, of_pairs: Residuals, noise: Noise | None) -> Calibration:
    """X with what does not depend on the covariance."""
    poses = job.poses
    return Calibration(
        X=X,
        W=W,
        covariance=None,
        method=job.method,
        scale=job.scale,
        kind=job.kind or ("pairs" if poses is None or isinstance(noise, PairNoise) else "poses"),
        setup=None if poses is None else poses.setup,
        n_poses=None if poses is None else poses.n,
        n_pairs=job.everything.n_pairs if job.everything else job.motions.N,
        noise=noise,
        residuals=of_pairs,
        data=job.data,
    )


def _by_sigma_points(job: Job, noise: Noise, robust: RobustFit | None) -> Array:
    """The mean square error of X beyond first order, around the data as fitted, without those of no weight."""
    from ..simulation.sigma_points import sigma_points

    data: PosePairs | Motions = job.motions
    if job.poses is not None and not isinstance(noise, PairNoise):
        measured = PosePairs(job.poses.robot, job.poses.camera, job.poses.setup)  # without the truth of a simulation
        every_pair = job.everything is not None or job.method in (*ESTIMATORS, *ROBOT_WORLD_METHODS)
        data = measured if every_pair or job.motions.pairs is None else relative_motions(measured, job.motions.pairs)
    else:
        data = Motions(job.motions.A, job.motions.B)
    if robust is not None:
        kept = np.flatnonzero(robust.weights)
        data, noise = data.rows(kept), noise.rows(kept)
    return sigma_points(data, noise=noise, method=job.method, scale=job.scale, seed=job.seed).mean_square


def _reference(fit: Fit, estimate: NoiseEstimate | None) -> Reference:
    """The distribution that goes with the covariance of the noise; a prior that fixes all of it leaves nothing open."""
    dof = float("inf") if estimate is None else effective_dof(fit, estimate)
    return Reference("F", dof) if np.isfinite(dof) else Reference()


def reference_of(resample: Resampled) -> Reference:
    """The distribution that goes with a covariance from residuals."""
    return Reference() if resample.freedom is None else Reference("Hotelling", resample.freedom)


def _reasons(job: Job) -> list[str]:
    """What may be wrong with data that gave no result."""
    found: list[str] = []
    with suppress(InputError, NotConvergedError):
        X = fit_published(job.motions, None, "4dpa", None, job.everything).X
        if job.poses is not None:
            found = check_fit(job.poses, X, None, None)
    return found + _shifted(job, None)


def _shifted(job: Job, result: Calibration | None) -> list[str]:
    """Whether rows of one file are missing, where the fit gives reason to ask (or there is none)."""
    if job.poses is None or job.poses.n < FEWEST_FOR_ROBUST:
        return []
    if result is not None:
        bad = 0 if result.table is None else len(result.table.flagged)
        if bad < max(2, 0.05 * job.poses.n) and result.residuals.rotation_rms < SUSPICIOUS:
            return []
    if (shift := find_shift(job.poses)) is not None:
        return [shift.statement]
    if result is None or result.table is None or result.W is None or result.table.item == "motion":
        return []
    run = shifted_run(job.poses, Unknowns(result.X, result.W), result.table.weight == 0)
    return [] if run is None else [run]
