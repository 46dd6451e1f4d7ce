"""Every published method on the same pairs: X, its distance from a reference, its covariance, residuals and time.

Model: method m gives ``X_m = (R_m, t_m)`` from the same ``A_i X = X B_i``. Its difference from the reference X_0 is

    xi = (theta, tau),    R_m = exp([theta]x) R_0,    t_m = t_0 + tau

rotation first, rad and m, in the parent frame of X (`calibration`). With the covariance S_m of the method itself

    d^2 = xi^T S_m^-1 xi,    agrees  <=>  d^2 <= 12.59, the 95 % quantile of chi-square with 6 degrees of freedom

that is, X_0 lies inside the 95 % ellipsoid about X_m. This describes, it does not test: all methods see the same noise,
so that d^2 is not chi-square distributed, methods that agree may be wrong together, and a precise method differs from
an imprecise reference.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import singledispatch
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...calibration.calibrate import calibrate
from ...calibration.checks import Check
from ...calibration.evidence.new_poses import poses_less_shared_errors
from ...calibration.result import Calibration
from ...calibration.rig_result import RigCalibration
from ...calibration.stored_result import not_a_result
from ...core.geometry.frames import SETUPS
from ...core.progress import progress_bar
from ...errors import (
    DegenerateMotionError,
    InputError,
    InputWarning,
    MissingExtraError,
    NotConvergedError,
    among,
)
from ...fit.graph.constraint import require_noise_fits
from ...fit.graph.gauss_helmert import ESTIMATORS
from ...fit.graph.noise_of_data import estimate_noise
from ...methods.method import Estimate, Method
from ...methods.noise_transport import noise_of_pairs
from ...methods.published_fit import fit_published
from ...methods.registry import METHODS, ROBOT_WORLD_METHODS
from ...methods.robot_world import RobotWorldMethod
from ...model.errors.models import Noise, PairNoise
from ...model.poses.motions import Motions, relative_motions, spread_pairs
from ...model.poses.pose_pairs import PosePairs, pairs_of
from ...model.poses.residuals import Residuals, residuals, summarise
from ...model.shared_errors.shared_error import SharedError
from .result import CHI2_95, Comparison, Row, against, squared_distance

# Pairs of poses, spread evenly, on which a report compares the methods.
COMPARED_PAIRS = 4_000
# The method whose row is the answer of `calibrate`: the default reference.
OWN = "efficient"
# What data can make of a method; any other exception is a fault of the program.
REFUSALS = (InputError, NotConvergedError, ArithmeticError, np.linalg.LinAlgError)
__all__ = ["CHI2_95", "Row", "against", "compare", "squared_distance"]


def compare(
    data: PosePairs | Motions | ArrayLike,
    camera: ArrayLike | None = None,
    *,
    setup: str | None = None,
    noise: Noise | None = None,
    methods: Sequence[str] | None = None,
    pairs: str | ArrayLike = "all",
    reference: str = OWN,
    shared: Sequence[SharedError] | None = None,
    timed: bool = True,
    progress: bool = False,
) -> Comparison:
    """Compare every method on the same pairs, each with its own covariance, with the result of `calibrate`.

    The row ``efficient`` is what ``calibrate(data, noise=noise)`` gives. All methods get the poses that count in it,
    and its noise. A method that fails keeps its row, which says why, and so does one whose extra is not installed. All
    pairs of many poses are thinned out to about 20,000.

    Parameters
    ----------
    data, camera, setup
        As in `calibrate`.
    noise : PoseNoise, PairNoise or None
        As in `calibrate`. None takes what `calibrate` estimates; where that fails (exact data, or data that do not fit
        together) there are differences but no standard deviations, hence no agreement.
    methods : "efficient", "ml", names in `METHODS` or `ROBOT_WORLD_METHODS`, or None for "efficient" and `METHODS`
        The reference is added if it is not among them.
    pairs : "all", "consecutive", "disjoint" or (N, 2) integers
        Pairs to make of the poses (`relative_motions`); Motions come with theirs.
    reference : str
        The method from which differences are taken; if it fails, the first that does not.
    shared : sequence of SharedError or None
        As in `calibrate`.
    timed : bool
        Measure the time of each method (default); False leaves it out and is about twice as fast.
    progress : bool
        Show a bar on stderr if that is a terminal. Default: False.

    Raises
    ------
    InputError
        Arguments that no method could use; data on which methods fail do not raise.

    Warns
    -----
    InputWarning
        What `calibrate` warns of, once for all methods.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> from uq_handeye.report.comparison.compare import compare
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> comparison = compare(uq.simulate(n_poses=30, noise=noise, seed=1), noise=noise, methods=["park"])
    >>> [(row.method, row.agrees) for row in comparison.rows]
    [('efficient', True), ('park', True)]
    """
    taken = pairs_of(data, camera, setup)
    names = _names(methods, reference)
    motions, available = _motions(taken, pairs)
    require_noise_fits(noise, motions)
    answers: list[Calibration] = []

    def answer() -> Calibration:
        answers.append(calibrate(taken, noise=noise, pairs=pairs, shared=shared))
        return answers[-1]

    own = _row(Row(OWN, None, "simultaneous", "closed form"), answer)
    used = noise
    if answers and answers[0].noise is not None:
        kept, used = _used(answers[0], motions)
        if kept.N < motions.N:
            n = len(kept.poses or kept)
            available = kept.N if available == motions.N else n * (n - 1) // 2
        motions = kept
    elif noise is None:
        with suppress(InputError, NotConvergedError):
            used = estimate_noise(motions if motions.poses is None else motions.poses).noise
    checks = answers[0].checks if answers else ()
    seen = explained_motions(answers[0], motions) if answers else motions
    if answers and answers[0].residuals.pairs == motions.N:
        own = replace(own, residuals=answers[0].residuals)
    estimated = noise is None and used is not None
    work = Work(motions, used, estimated, available, seen, checks)
    return compare_rows(names, work, {OWN: own}, reference, timed, progress)


def explained_motions(result: Calibration, motions: Motions) -> Motions:
    """Return the motions corrected by the shared errors that a calibration estimates, for the residuals of all methods.

    Otherwise the X of a method that absorbs the wrong size of a target would seem to fit best.
    """
    poses = motions.poses
    if poses is None or motions.pairs is None or result.posterior is None or result.W is None:
        return motions
    return relative_motions(poses_less_shared_errors(result, poses), motions.pairs)


class Work(NamedTuple):
    """Input of all methods of a comparison; their residuals are those of the motions ``seen``."""

    motions: Motions
    noise: Noise | None
    noise_estimated: bool
    available: int  # pairs that there were to choose from
    seen: Motions  # without errors that were estimated
    checks: tuple[Check, ...] = ()


def compare_rows(
    names: Sequence[str], work: Work, found: dict[str, Row], reference: str, timed: bool, progress: bool = False
) -> Comparison:
    """Compare these methods; rows that are already ``found`` are used unchanged."""
    motions, noise = work.motions, work.noise
    poses = motions.poses
    found = dict(found)
    with warnings.catch_warnings(record=True) as others:  # those of progress itself, and of numpy
        warnings.simplefilter("always")
        with progress_bar("compare", len(names), "methods", progress) as advance:
            for name in sorted(names, key=lambda name: name != reference):
                if name not in found:
                    found[name] = _row_of(name, motions, noise, timed)
                advance(1)
    rows = [found[name] for name in names]
    base = next((found[name] for name in (reference, *names) if found[name].failure is None), None)
    common, own = _sorted_warnings(rows, base)
    if base is None and OWN in found:  # the error of calibrate for data that no method accepts
        common = tuple(dict.fromkeys((*found[OWN].warnings, *common)))

    def judged(row: Row) -> Residuals | None:
        return None if row.X is None else summarise(*residuals(work.seen.A, work.seen.B, row.X))

    rows = [against(replace(row, residuals=row.residuals or judged(row)), base) for row in own]
    result = Comparison(
        rows=tuple(rows),
        reference=None if base is None else base.method,
        requested_reference=reference,
        frame="X" if poses is None else SETUPS[poses.setup],
        setup=None if poses is None else poses.setup,
        n_poses=None if poses is None else poses.n,
        n_pairs=motions.N,
        n_pairs_available=work.available,
        noise=noise,
        noise_estimated=work.noise_estimated,
        warnings=common,
        checks=work.checks,
    )
    for text in (*common, *result.own_warnings):
        warnings.warn(text, InputWarning, stacklevel=3)
    for message in {(warning.category, str(warning.message)): warning for warning in others}.values():
        warnings.warn(message.message, message.category, stacklevel=3)
    return result


def _used(result: Calibration, motions: Motions) -> tuple[Motions, Noise]:
    """The motions without the poses that the calibration gave no weight, and the noise that it used."""
    data, noise = result.used
    if isinstance(data, Motions):
        return data, noise
    if result.table is None or data is result.data:
        return motions, noise
    kept = result.table.weight > 0
    assert motions.pairs is not None
    pairs = motions.pairs[kept[motions.pairs].all(axis=1)]
    return relative_motions(data, np.cumsum(kept)[pairs] - 1), noise


def _every() -> dict[str, Method | RobotWorldMethod]:
    return {**METHODS, **ROBOT_WORLD_METHODS}


def _names(methods: Sequence[str] | None, reference: str) -> list[str]:
    """The methods to run, each once and the reference among them."""
    wanted = [OWN, *METHODS] if methods is None else [methods] if isinstance(methods, str) else list(methods)
    for name, argument in (*((name, "methods") for name in wanted), (reference, "reference")):
        if not among(name, (*ESTIMATORS, *_every())):
            known = ", ".join((*ESTIMATORS, *_every()))
            raise InputError(f"Expected `{argument}` to name methods among {known}, got {name!r}.")
    return list(dict.fromkeys(wanted if reference in wanted else [reference, *wanted]))


def _motions(data: PosePairs | Motions, pairs: str | ArrayLike) -> tuple[Motions, int]:
    """The motions for all methods, and how many pairs there were to choose from."""
    match data:
        case Motions():
            motions, available = data, data.N
        case PosePairs():
            if data.n < 3:
                raise InputError(f"Expected at least 3 poses, which make 2 motions, got {data.n}.")
            every = among(pairs, ("all",))
            motions = relative_motions(data, spread_pairs(data.n, 20_000) if every else pairs)
            available = data.n * (data.n - 1) // 2 if every else motions.N
        case _:
            raise InputError(f"Expected `data` to be PosePairs or Motions, got {type(data).__name__}.")
    if motions.A.ndim != 3:
        raise InputError("Expected one data set, got a batch.")
    return motions, available


def _row_of(name: str, motions: Motions, noise: Noise | None, timed: bool) -> Row:
    """The row of one method on these motions; never raises on account of the data."""
    if name in ESTIMATORS:
        model = Row(name, None, "simultaneous", "iterative" if name == "ml" else "closed form")
        return _row(model, lambda: calibrate(motions, noise=noise, method=name, robust=False))
    method = _every()[name]
    row = Row(name, method.year, method.structure, method.form)
    row = _row(
        row,
        lambda: calibrate(motions, noise=noise, method=name),
        lambda error: _without_covariance(row, error, motions, noise, method),
        motions,
    )
    if not timed or row.X is None:
        return row
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the row holds them
        with suppress(*REFUSALS):  # what reached no end is not timed
            return replace(row, seconds=_seconds(_alone(method, motions, noise)))
    return row


def _row(
    row: Row,
    run: Callable[[], Calibration],
    refused: Callable[[InputError], Row] | None = None,
    motions: Motions | None = None,
) -> Row:
    """The row with what ``run`` finds, or why it finds nothing, but for the difference from the reference."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            row = _filled(row, run())
        except REFUSALS as error:
            row = _refused(row, error, refused, motions)
    for warning in caught:
        if not issubclass(warning.category, InputWarning):
            warnings.warn(warning.message, warning.category, stacklevel=2)
    found = dict(zip(row.warnings, row.kinds, strict=True))
    for warning in caught:
        if isinstance(warning.message, InputWarning):
            found.setdefault(str(warning.message), warning.message.code or str(warning.message))
    return replace(row, warnings=tuple(found), kinds=tuple(found.values()))


def _alone(method: Method | RobotWorldMethod, motions: Motions, noise: Noise | None) -> Callable[[], object]:
    """The estimate without anything around it."""
    if isinstance(method, RobotWorldMethod):
        poses = motions.poses
        assert poses is not None  # or it would have no X
        return lambda: method(poses)
    weights = noise if isinstance(noise, PairNoise) and method.weighted else None
    if method.weighted and noise is not None and weights is None:
        weights = noise_of_pairs(motions, noise)
    return lambda: method.estimate(motions.A, motions.B, weights)


def _filled(row: Row, result: Calibration) -> Row:
    """The row with what `calibrate` found."""
    if not _is_finite(result):
        raise ArithmeticError("the result holds numbers that are not finite.")
    return replace(
        row,
        X=result.X,
        covariance=result.covariance,
        converged=True,  # or it would have raised
        iterations=result.iterations,
    )


def _is_finite(result: Calibration) -> bool:
    return bool(np.isfinite(result.X).all() and (result.covariance is None or np.isfinite(result.covariance).all()))


def _without_covariance(
    row: Row, error: InputError, motions: Motions, noise: Noise | None, method: Method | RobotWorldMethod
) -> Row:
    """The row with X alone where it is the covariance that the method refuses, for example of too many pairs."""
    if noise is None or method.weighted:
        return replace(row, failure=_said(error))
    try:
        found = fit_published(motions, None, method.name, None, None)
        if not np.isfinite(found.X).all():
            raise ArithmeticError("the result holds numbers that are not finite.")
    except REFUSALS:
        return replace(row, failure=_said(error))
    row = replace(row, X=found.X, converged=True, iterations=found.iterations)
    return replace(row, warnings=(f"No covariance, hence no verdict: {_said(error)}",), kinds=("no covariance",))


def _refused(row: Row, error: Exception, refused: Callable[[InputError], Row] | None, motions: Motions | None) -> Row:
    """The row with why there is no result; what an iteration reached, or an X that means nothing, stays in it."""
    row = replace(row, failure=_said(error))
    match error:
        case NotConvergedError(partial=Estimate(X=X, iterations=count)):
            if motions is not None and X.shape == (4, 4) and np.isfinite(X).all():
                row = replace(row, X=X, iterations=int(count))
            return replace(row, converged=False)
        case NotConvergedError():
            return replace(row, converged=False)
        case DegenerateMotionError(partial=Calibration() as found) if _is_finite(found):
            return _filled(row, found)
        case DegenerateMotionError():
            return row
        case MissingExtraError():
            return replace(row, not_run=True)
        case InputError():
            return row if refused is None else refused(error)
    return replace(row, failure=f"{type(error).__name__}: {row.failure}")  # the numbers of these data


def _said(error: Exception) -> str:
    """Return the error on one line of a table."""
    return " ".join(str(error).split()) or type(error).__name__


def _seconds(function: Callable[[], object]) -> float:
    """Shortest time of a few calls, or of one if it is slow."""
    times: list[float] = []
    while len(times) < 5 and sum(times) < 0.25:
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def _sorted_warnings(rows: list[Row], base: Row | None) -> tuple[tuple[str, ...], list[Row]]:
    """Return the warnings of the reference (of all methods if none succeeded), and the rows with what is beyond them.

    Warnings are the same if they are of findings of one code, whatever their numbers.
    """
    common = {
        kind: text
        for row in (rows if base is None else [base])
        for kind, text in zip(row.kinds, row.warnings, strict=True)
    }
    own = []
    for row in rows:
        more = [one for one in zip(row.kinds, row.warnings, strict=True) if one[0] not in common]
        own.append(replace(row, kinds=tuple(kind for kind, _ in more), warnings=tuple(text for _, text in more)))
    return tuple(common.values()), own


class Compared(NamedTuple):
    """A comparison, or the reason why there is none."""

    comparison: Comparison | None
    reason: str  # why there is none
    note: str  # on the data that were compared


@singledispatch
def compare_result(result: object) -> Compared:
    """All published methods on the data of the result, without the poses that it rejected; its X is the reference.

    The noise is that of the result, given or estimated there. No time is measured.
    """
    raise not_a_result(result)


@compare_result.register
def _of_camera(result: Calibration) -> Compared:
    data, noise, note = result.counted, result.noise, ""
    if data is None:
        return Compared(
            None,
            "Not compared: this result was read from a file that holds no poses. "
            "report(path, comparison=compare(poses, noise=noise)) shows the methods.",
            "",
        )
    if result.table is not None and result.table.rejected:
        kept = np.flatnonzero(result.table.weight[result.table.counted] > 0)
        data, noise = (data.rows(kept), None) if noise is None else result.used
        count = len(result.table.rejected)
        note = f" Without the {f'{count} {result.table.item}s' if count > 1 else result.table.item} rejected here."
    if isinstance(data, PosePairs):
        available = data.n * (data.n - 1) // 2
        motions = relative_motions(data, spread_pairs(data.n, COMPARED_PAIRS))
    else:
        motions, available = data, min(data.N, COMPARED_PAIRS)
        if data.N > COMPARED_PAIRS:
            some = np.linspace(0, data.N - 1, COMPARED_PAIRS).astype(np.intp)
            note += f" They are spread evenly over the {data.N:,} motions."
            motions, noise = data.rows(some), None if noise is None else noise.rows(some)
    base = Row(
        f"{result.method} (this result)",
        None,
        "",
        "",
        X=result.X,
        covariance=result.covariance,
        residuals=result.residuals if result.residuals.pairs == motions.N else None,
        warnings=result.warnings,
        kinds=tuple(finding.code for finding in result.findings if finding.severity != "note"),
    )
    names, estimated = [base.method, *METHODS], result.noise_estimate is not None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those that matter are in the table
        work = Work(motions, noise, estimated, available, explained_motions(result, motions))
        found = compare_rows(names, work, {base.method: base}, base.method, timed=False)
    return Compared(found, "", note)


@compare_result.register
def _of_rig(result: RigCalibration) -> Compared:
    return Compared(None, "Not compared: the published methods solve one A X = X B, of one camera.", "")
