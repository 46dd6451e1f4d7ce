r"""The function `synchronise`: pose pairs from two time-stamped streams, with their time offset and its uncertainty.

Model: robot and camera poses ``base_T_gripper`` and ``camera_T_target`` were sampled at times of two clocks that run at
the same rate, ``robot_time = camera_time + offset``. Poses of the denser stream are interpolated at the times of the
other (`interpolation`, Sub-problem 2): the error of interpolation grows with the square of the interval. Nothing is
extrapolated, no gap is bridged.

The offset starts from the correlation of angular speeds (`correlation`), and is refined jointly with X and W
(`refinement`). Its uncertainty goes with the poses (`timing`): `calibrate` makes the covariance of X marginal
over it. An offset error d moves pose i by ``rate_i d``, hence X by ``g d`` with ``g = -C J^T S^-1 j``, ``j_i = D_i
rate_i``. In the joint fit of (X, W, d) the covariance of X is to first order

    C + g Var(d) g^T

which is the inverse of the 13-parameter information if ``Var(d) = 1/(j^T S^-1 j - j^T S^-1 J C J^T S^-1 j)``, and stays
right where Var(d) is larger because rows are not independent, or smaller because of a prior.

Where every picture was taken at a stop of the robot, all offsets within the stops fit alike: the middle is taken, with
the standard deviation of a uniform distribution, and with rates of 0, as X does not depend on it.

Not covered are clocks that drift against each other, delays that change, and the error of interpolation
(`Synchronised.interpolation_error`).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ...core.files.source import Source
from ...core.geometry.checks import is_number
from ...core.geometry.frames import SETUPS
from ...core.geometry.se3 import Array
from ...core.levels import RARE
from ...core.limits import MAX_NAMED, MIN_POSES
from ...errors import (
    DegenerateMotionError,
    InputError,
    NotConvergedError,
    keywords_of,
    require_integer,
    require_known,
    require_one_of,
    require_type,
)
from ...findings import Finding, warn
from ...model.errors.models import PoseNoise, is_joint
from ...model.poses.pose_pairs import PosePairs, joint_values_at
from ...model.poses.stream import Stream
from ...model.poses.timing import MAX_GAP_INTERVALS, SIDES, Timing
from ..camera_covariance import with_covariance
from .correlation import Correlation, best_correlation
from .interpolation import Interpolated, check_kind, error_of_interpolation, misses
from .pairing import Pairing, noise_of_rows, thinned
from .refinement import (
    ROWS_FOR_RESULT,
    ROWS_FOR_ROUNDS,
    Refined,
    bias_of_interpolation,
    refine,
    start,
    with_noise,
)
from .result import Synchronised
from .stops import STOP_WINDOW_S, Stop, find_stops, offsets_at_rest
from .stream_checks import LeftOut, check_units, coarse_clock, common_time, left_out

# The robot is interpolated unless its interval is longer than the camera's by more than this factor.
SAME_RATE_RATIO = 1.05
# Fewest rows of which an offset is estimated.
MIN_ROWS_FOR_OFFSET = 10
# Two candidates fit alike if their residuals differ by less than this factor.
EQUAL_FIT_RATIO = 1.25
# Share of the poses in common that gaps may cost without a warning.
MAX_GAP_SHARE = 0.1
# Advice where one stream has too few poses for a speed.
AT_STOPS = " Poses taken while the robot stood still need no offset: where both clocks are one, give --offset 0."
# An offset with a larger standard deviation is not determined by the motion.
MAX_OFFSET_SD_S = 0.25


def synchronise(robot: Stream, camera: Stream, **options: Any) -> Synchronised:
    """Pose pairs of two time-stamped streams, with the offset between their clocks and its uncertainty.

    Parameters
    ----------
    robot, camera : Stream
        ``base_T_gripper`` and ``camera_T_target``; seconds and metres. Joint values of the robot are interpolated
        linearly.
    setup : "eye-in-hand" or "eye-to-hand"
    offset : None, float or (value, standard deviation)
        ``robot_time = camera_time + offset`` (s). None estimates it; a number is taken as exact; with a standard
        deviation it is a Gaussian prior, and the estimate starts there.
    max_offset : float or None
        The offset is looked for within +- so many seconds; None is a quarter of what the streams have in common, 1 s at
        least. ``math.inf`` for clocks that have nothing to do with each other.
    interpolation : "so4" or "geodesic"
    max_gap : float or None
        Samples that are farther apart (s) are not interpolated between; None is three times the median interval.
    still : bool
        One averaged pose pair for each stop, instead of all poses in motion; for robots that stop for each picture.
    noise : PoseNoise or None
        Of the samples of each stream, 6x6. None estimates that of the pairs (and `calibrate` may do so again). With it
        ``Synchronised.noise`` is that of the pairs, to be given to `calibrate`: the mean of two samples is less noisy.
    seed : int
        Of the random subsets.

    Returns
    -------
    Synchronised
        ``poses``, ``offset``, ``offset_std``, ``left_out``, ``summary()``, ``figure()``.

    Raises
    ------
    InputError
        Streams that have no time in common, whose times are not in seconds, with too few poses; motion that leaves the
        offset open. The message names the times.
    DegenerateMotionError
        X is not determined, without which the offset is not.
    NotConvergedError
        The offset does not settle.

    Warns
    -----
    InputWarning
        Several offsets that fit; gaps that cost many poses; an offset given that the poses contradict.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> robot = uq.read_stream("robot.csv", "robot")         # doctest: +SKIP
    >>> camera = uq.read_stream("camera.csv", "camera")      # doctest: +SKIP
    >>> sync = uq.synchronise(robot, camera)                 # doctest: +SKIP
    >>> result = uq.calibrate(sync.poses)                    # doctest: +SKIP
    """
    require_known("synchronise", options, SyncRequest)
    given = SyncRequest(**options)
    for name, stream in (("robot", robot), ("camera", camera)):
        require_type(name, stream, Stream, "a Stream (read_stream, or Stream(timestamps, poses))")
        if len(stream) < 3:
            raise InputError(f"Expected at least 3 poses in `{name}`, got {len(stream)}.")
    robot, camera, prior, reach = _by_time(robot), _by_time(camera), given.prior, given.max_offset
    r_times, c_times = robot.timestamps, camera.timestamps
    intervals = float(np.median(np.diff(r_times))), float(np.median(np.diff(c_times)))
    check_units(*intervals)
    side = "robot" if intervals[0] <= SAME_RATE_RATIO * intervals[1] else "camera"
    gap = MAX_GAP_INTERVALS * intervals[SIDES.index(side)] if given.max_gap is None else float(given.max_gap)
    # Times count from the beginning of each stream: those of an epoch have few digits left below 1 us.
    origins = float(r_times[0]), float(c_times[0])
    shift = origins[0] - origins[1]
    parts = r_times - origins[0], robot.poses, c_times - origins[1], camera.poses
    pairing = Pairing(*parts, side, given.interpolation, gap, given.setup == "eye-to-hand")
    centre = 0.0 if prior is None else prior[0]
    if prior is not None and not given.exact and reach is None:
        reach = 4 * prior[1] + 2 * max(intervals)
    common = common_time(r_times, c_times, 0.0 if given.exact or reach is None else reach, centre)
    if reach is None:
        reach = max(common / 4, 1.0)  # s

    found: _Estimate | None = None
    try:
        local = None if prior is None else (prior[0] - shift, prior[1])
        found = _estimate(pairing, (centre - shift - reach, centre - shift + reach), local, given)
    except (InputError, NotConvergedError):
        if not given.exact:
            raise  # else the offset is known, and whether the poses agree with it is not
    at = centre - shift if found is None or given.exact else found.refined.offset
    return _assembled((robot, camera), given, pairing, origins, at, found)


@dataclass(frozen=True, eq=False)
class SyncRequest:
    """Keywords of `synchronise`, checked."""

    setup: str = "eye-in-hand"
    offset: float | tuple[float, float] | None = None
    max_offset: float | None = None
    interpolation: str = "so4"
    max_gap: float | None = None
    still: bool = False
    noise: PoseNoise | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        _ = self.prior
        check_kind(self.interpolation)
        for name in ("max_offset", "max_gap"):
            if (number := getattr(self, name)) is not None and not (is_number(number) and number > 0):
                raise InputError(f"Expected `{name}` to be a number of seconds above 0 or None, got {number!r}.")
        if type(self.still) not in (bool, np.bool_):
            raise InputError(f"Expected `still` to be True or False, got {self.still!r}.")
        if self.noise is not None:
            require_type("noise", self.noise, PoseNoise, "PoseNoise or None")
            _require_one(self.noise)
        require_one_of("setup", self.setup, SETUPS)
        require_integer("seed", self.seed, 0)

    @cached_property
    def prior(self) -> tuple[float, float] | None:
        """Offset and its standard deviation (s; 0: exact), as far as they are given."""
        if self.offset is None:
            return None
        pair: Any = (self.offset, 0.0) if is_number(self.offset) else self.offset
        right = type(pair) in (tuple, list) and len(pair) == 2 and all(map(is_number, pair))
        if not right or not np.isfinite(pair).all() or pair[1] < 0:
            raise InputError(
                "Expected `offset` to be None, a number of seconds, or (value, standard deviation >= 0), got "
                f"{self.offset!r}."
            )
        return float(pair[0]), float(pair[1])

    @property
    def exact(self) -> bool:
        """True if the offset is known exactly."""
        return self.prior is not None and self.prior[1] == 0


synchronise.__signature__ = keywords_of(synchronise, SyncRequest)  # type: ignore[attr-defined]


def _require_one(noise: PoseNoise) -> None:
    """Raise `InputError` unless one covariance is that of all samples of a stream."""
    for name in SIDES:
        S = getattr(noise, name)
        if S is not None and (is_joint(S) or S.ndim != 2):
            raise InputError(
                f"Expected the covariance `{name}` of the samples of a stream to be (6, 6), got {S.shape}."
            )


class _Estimate(NamedTuple):
    """Estimate of the offset from the streams."""

    refined: Refined
    correlation: Correlation
    alternatives: tuple[float, ...]
    at_rest: tuple[float, float] | None = None  # the offsets at which every picture lies in a stop


def _estimate(
    pairing: Pairing,
    ends: tuple[float, float],
    prior: tuple[float, float] | None,
    request: SyncRequest,
    candidates_tried: int = 3,
) -> _Estimate:
    """Estimate the offset between the ``ends`` by correlation and Gauss-Newton; times from the origins of the streams.

    A prior of standard deviation 0 is only a start. Of the peaks of the correlation the highest and the nearest to the
    middle are tried.
    """
    noise = request.noise
    step = max(float(np.median(np.diff(times))) for times in (pairing.robot_times, pairing.camera_times))
    correlation = best_correlation(
        (pairing.robot_times, pairing.robot), (pairing.camera_times, pairing.camera), *ends, pairing.max_gap
    )
    given = None if prior is None or prior[1] == 0 else prior
    middle = 0.5 * (ends[0] + ends[1])
    if correlation.found:
        nearest = sorted(correlation.peaks, key=lambda peak: abs(peak - middle)) if np.isfinite(middle) else []
        candidates = list(dict.fromkeys([*correlation.peaks[:candidates_tried], *nearest[:candidates_tried]]))
    elif prior is not None:
        candidates = [prior[0]]
    else:
        raise InputError(_not_correlated(correlation, ends, step))
    tried: list[Refined] = []
    failure: Exception | None = None
    for candidate in candidates:
        try:
            _require_rows(pairing, candidate, MIN_ROWS_FOR_OFFSET)
            tried.append(start(pairing, candidate, request.seed))
        except (InputError, NotConvergedError) as error:
            failure = failure or error
    if not tried:
        assert failure is not None
        raise failure
    tried.sort(key=lambda one: one.score)
    # Two variances, so four times the logarithm of a ratio of deviations.
    alike = [one for one in tried if one.score - tried[0].score < 4 * np.log(EQUAL_FIT_RATIO)]
    best = min(alike, key=lambda one: abs(one.offset - middle)) if np.isfinite(middle) else tried[0]
    alternatives = {round(one.offset, 6) for one in alike if abs(one.offset - best.offset) > 2 * step}
    refined = best
    if noise is not None:
        refined = refined._replace(noise=noise, of_samples=True)
    rows = pairing.rows_at(refined.offset)
    refined = refine(pairing, refined, thinned(rows, ROWS_FOR_ROUNDS), given)
    if noise is None and np.isfinite(refined.std):
        refined = refined._replace(noise=with_noise(pairing, refined, rows))
    for _ in range(3):  # an offset that moves may add rows at an end
        rows = pairing.rows_at(refined.offset)
        refined = refine(pairing, refined, thinned(rows, ROWS_FOR_RESULT), given)
        if np.array_equal(rows, pairing.rows_at(refined.offset)):
            break
    if given is not None:  # what the data alone want, where they want it
        refined = refined._replace(wanted=(best.offset, best.std))
    if not refined.std < MAX_OFFSET_SD_S and given is None:
        known = f" (standard deviation {refined.std:.2g} s)" if np.isfinite(refined.std) else ""
        raise InputError(
            f"The motion does not determine the time offset{known}. Rotate the robot about different axes, faster and "
            "with changes of speed, or give `offset` (--offset)."
        )
    at_rest = None
    if pairing.side == "robot" and given is None:
        at_rest = offsets_at_rest(pairing.robot_times, pairing.robot, pairing.camera_times, refined.offset)
    if at_rest is not None:
        low, high = at_rest
        middle_of_stops, deviation = 0.5 * (low + high), (high - low) / np.sqrt(12.0)  # of a uniform distribution
        refined = refined._replace(offset=middle_of_stops, std=deviation, wanted=(middle_of_stops, deviation))
        alternatives |= _shifted_by_a_stop(pairing, middle_of_stops, best.score, request.seed)
    return _Estimate(refined, correlation, tuple(sorted(alternatives)), at_rest)


def _shifted_by_a_stop(pairing: Pairing, offset: float, score: float, seed: int) -> set[float]:
    """Return the offsets, one or two pictures from ``offset``, that fit as well as its ``score``: a repeated motion."""
    period = float(np.median(np.diff(pairing.camera_times)))
    found = set()
    for shift in (-2, -1, 1, 2):
        with suppress(InputError, NotConvergedError, DegenerateMotionError):
            _require_rows(pairing, offset + shift * period, MIN_ROWS_FOR_OFFSET)
            tried = start(pairing, offset + shift * period, seed)  # which may return to the stop that fits
            if abs(tried.offset - offset) > 0.5 * period and tried.score - score < 4 * np.log(EQUAL_FIT_RATIO):
                found.add(round(tried.offset, 6))
    return found


def _not_correlated(correlation: Correlation, ends: tuple[float, float], step: float) -> str:
    fastest = [
        np.degrees(np.nanmax(part.speed)) if np.isfinite(part.speed).any() else 0.0
        for part in (correlation.robot, correlation.camera)
    ]
    if correlation.heights:
        what = (
            f"the angular speeds of robot and camera do not correlate (at most {correlation.heights[0]:.2f} where "
            f"chance gives {correlation.needed:.2f})"
        )
    else:
        what = "too little of the angular speeds of robot and camera overlaps, or one of them does not change"
    return (
        f"The time offset is not determined within {ends[1] - ends[0]:.3g} s: {what}; they reach {fastest[0]:.2g} and "
        f"{fastest[1]:.2g} deg/s. Both must be of one motion, with rotations that start and stop, and Euler angles in "
        "their right order (--rotation robot=...); or give `offset` (--offset), or a larger `max_offset` (uq-handeye "
        f"sync --max-offset).{AT_STOPS if step >= STOP_WINDOW_S else ''}"
    )


def _require_rows(pairing: Pairing, offset: float, fewest: int) -> None:
    """Raise unless so many poses have a partner at this offset."""
    found = pairing.interpolated(offset)
    if int(found.fine.sum()) < fewest:
        raise InputError(_too_few(pairing, (0.0, 0.0), found, offset, fewest))


def _left_out(pairing: Pairing, origins: tuple[float, float], found: Interpolated) -> tuple[LeftOut, ...]:
    times = {"robot": pairing.robot_times + origins[0], "camera": pairing.camera_times + origins[1]}
    base = "camera" if pairing.side == "robot" else "robot"
    return left_out(found, base, times[base], pairing.side, times[pairing.side], pairing.max_gap)


def _too_few(pairing: Pairing, origins: tuple[float, float], found: Interpolated, offset: float, fewest: int) -> str:
    parts = _left_out(pairing, origins, found)
    named = "; ".join(str(part) for part in parts[:MAX_NAMED]) + (
        f"; and {len(parts) - MAX_NAMED} more" if parts[MAX_NAMED:] else ""
    )
    since = " (times since the start of each stream)" if origins == (0.0, 0.0) else ""
    return (
        f"Expected at least {fewest} poses that have a partner, got {int(found.fine.sum())} of {pairing.n} at an "
        f"offset of {offset:.4g} s{since}. Left out: {named or 'none'}. Give longer streams, or a larger `max_gap`."
    )


def _assembled(
    streams: tuple[Stream, Stream],
    given: SyncRequest,
    pairing: Pairing,
    origins: tuple[float, float],
    at: float,
    estimate: _Estimate | None,
) -> Synchronised:
    (robot, camera), setup, prior, still, noise = streams, given.setup, given.prior, given.still, given.noise
    shift = origins[0] - origins[1]
    std = 0.0 if given.exact or estimate is None else estimate.refined.std
    offset = prior[0] if prior is not None and given.exact else at + shift
    found = pairing.interpolated(at)
    rows = np.flatnonzero(found.fine)
    if len(rows) < MIN_POSES:
        raise InputError(_too_few(pairing, origins, found, offset, MIN_POSES))
    gone = _left_out(pairing, origins, found)
    sources = tuple(stream.source for stream in (robot, camera) if stream.source is not None)
    stops = find_stops(pairing.robot_times, pairing.robot, pairing.camera_times, pairing.camera, at, pairing.max_gap)
    if still:
        poses = _of_stops(
            stops, setup, origins[1], sources, Timing(offset, std, np.zeros((len(stops), 6)), pairing.side)
        )
        if robot.joints is not None:
            poses = replace(poses, joints=_joints_of_stops(robot, stops, origins[0] + at))
        gone = ()
    else:
        fine = found.rows(rows)
        rates = fine.rate if estimate is None or estimate.at_rest is None else np.zeros_like(fine.rate)
        pair = pairing.poses(fine, rows)
        times = pairing.camera_times[rows] if pairing.side == "robot" else pairing.robot_times[rows] - at
        timing = Timing(offset, std, rates, pairing.side)
        poses = with_covariance(PosePairs(*pair, setup, times + origins[1], None, sources, timing), camera)
        if robot.joints is not None:
            poses = replace(poses, joints=joint_values_at(pairing.robot_times, robot.joints, times + at))
    refined = None if estimate is None else estimate.refined
    findings = _against_streams(pairing, gone, len(rows), shift, offset, prior, estimate)
    side_times, side_poses = (
        (pairing.robot_times, pairing.robot) if pairing.side == "robot" else (pairing.camera_times, pairing.camera)
    )
    missed = misses(side_times, side_poses, pairing.kind, pairing.max_gap)
    error = error_of_interpolation(side_poses, missed)
    if refined is not None and not still:
        bias = bias_of_interpolation(pairing, refined, missed)
        if bias >= 1.0:  # standard deviation of X
            values = {"side": pairing.side, "rotation": error[0], "translation": error[1], "bias": bias}
            findings.append(Finding("synchronisation.coarse_interpolation", "caution", values))
    result = Synchronised(
        poses=poses,
        offset=offset,
        offset_std=std,
        origin=_origin(given, estimate),
        model_std=None if refined is None or given.exact else refined.model_std,
        growth=1.0 if refined is None or given.exact else refined.growth,
        side=pairing.side,
        interpolation=pairing.kind,
        max_gap=pairing.max_gap,
        interpolation_error=error,
        intervals=(float(np.median(np.diff(pairing.robot_times))), float(np.median(np.diff(pairing.camera_times)))),
        left_out=gone,
        alternatives=() if estimate is None else tuple(value + shift for value in estimate.alternatives),
        stops=len(stops) if still else None,
        stops_found=len(stops),
        noise=None if noise is None or still else noise_of_rows(noise, fine, pairing.side),
        findings=(*findings, *_of_streams(robot, camera, stops, still)),
        correlation=None if estimate is None else estimate.correlation,
        pairing=pairing,
        refined=refined,
        shift=shift,
    )
    warn(findings, stacklevel=3)
    return result


def _origin(given: SyncRequest, estimate: _Estimate | None) -> str:
    """Return where the offset is from, in words."""
    if given.exact:
        return "given"
    if estimate is not None and estimate.at_rest is not None:
        return "open within the stops"
    return "estimated" if given.prior is None else "estimated with a prior"


def _of_stops(stops: list[Stop], setup: str, origin: float, sources: tuple[Source, ...], timing: Timing) -> PosePairs:
    if len(stops) < MIN_POSES:
        raise InputError(
            f"Expected at least {MIN_POSES} stops of robot and camera with still=True, found {len(stops)}. Stop "
            "for half a second and more at each pose, or take the poses in motion (still=False)."
        )
    robot, camera = (np.stack(part) for part in zip(*((stop.robot, stop.camera) for stop in stops), strict=True))
    times = np.array([0.5 * (stop.begin + stop.end) for stop in stops]) + origin
    return PosePairs(robot, camera, setup, times, None, sources, timing)


def _against_streams(
    pairing: Pairing,
    gone: tuple[LeftOut, ...],
    kept: int,
    shift: float,
    offset: float,
    prior: tuple[float, float] | None,
    estimate: _Estimate | None,
) -> list[Finding]:
    """Gaps, other offsets that fit, and whether the streams contradict the offset that was given or expected."""
    found: list[Finding] = []

    def caution(what: str, **values: object) -> None:
        found.append(Finding(f"synchronisation.{what}", "caution", values))

    exact, beyond_chance = prior is not None and prior[1] == 0, RARE.chi_square(1)
    gaps = [part for part in gone if part.gap]
    lost = sum(len(part.times) for part in gaps)
    if lost > MAX_GAP_SHARE * (lost + kept):
        parts = [part.to_dict() for part in gaps[:MAX_NAMED]]
        caution("gaps", lost=lost, n=lost + kept, max_gap=pairing.max_gap, parts=parts, more=len(gaps) > MAX_NAMED)
    if estimate is None:
        return found
    if estimate.at_rest is not None and not exact:
        low, high = (value + shift for value in estimate.at_rest)
        found.append(Finding("synchronisation.open_within_stops", "note", {"low": low, "high": high}))
    if estimate.alternatives and not exact:
        caution("other_offsets", offset=offset, others=[value + shift for value in estimate.alternatives])
    wanted, std = estimate.refined.offset + shift, estimate.refined.std
    alone, alone_std = estimate.refined.wanted[0] + shift, estimate.refined.wanted[1]
    if prior is not None and not exact and (alone - prior[0]) ** 2 > beyond_chance * (alone_std**2 + prior[1] ** 2):
        caution("prior_contradicted", prior=prior[0], prior_std=prior[1], offset=alone, std=alone_std)
    # Where the motion does not tell the offset, a fit from the one that was given only finds a neighbour of it.
    told = exact and estimate.correlation.found
    if told and (wanted - offset) ** 2 > beyond_chance * std**2:
        caution("offset_contradicted", given=offset, offset=wanted, std=std)
    return found


def _of_streams(robot: Stream, camera: Stream, stops: list[Stop], still: bool) -> list[Finding]:
    """Notes: coarse clocks, and stops that could be averaged."""
    found = []
    for stream, name in ((robot, "robot"), (camera, "camera")):
        if (q := coarse_clock(stream.timestamps)) is not None:
            found.append(Finding("synchronisation.coarse_clock", "note", {"side": name, "resolution": q}))
    if stops and not still:
        found.append(Finding("synchronisation.stops", "note", {"count": len(stops)}))
    return found


def _by_time(stream: Stream) -> Stream:
    """Return a stream in the order of its times."""
    if (np.diff(stream.timestamps) > 0).all():
        return stream
    order = np.argsort(stream.timestamps, kind="stable")
    joints = None if stream.joints is None else stream.joints[order]
    return replace(stream, timestamps=stream.timestamps[order], poses=stream.poses[order], joints=joints)


def _joints_of_stops(robot: Stream, stops: list[Stop], shift: float) -> Array:
    """Return the mean joint values (k, L) of the samples at each stop; robot time is stop time plus ``shift``."""
    assert robot.joints is not None
    ends = np.searchsorted(robot.timestamps, [[stop.begin + shift, stop.end + shift] for stop in stops])
    return np.stack([robot.joints[first : max(behind, first + 1)].mean(axis=0) for first, behind in ends])
