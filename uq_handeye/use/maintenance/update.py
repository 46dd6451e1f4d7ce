r"""`update`: a result and new poses together, as if all had been calibrated at once.

A result that holds its poses is updated by the fit of all poses with the options that it was asked for with. The
update then equals the calibration of all poses, and the order of updates does not matter, but for what the estimate
itself makes of the order of poses (neighbours of a drift).

A result without poses (an older file), or with touches, is updated by its joint posterior (`evidence.absorb`), which is
the same to first order: old poses that are not there cannot be weighted or linearised again.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from ...calibration.calibrate import calibrate
from ...calibration.estimate.provenance import Provenance
from ...calibration.evidence.absorb import absorbed_into, touches_taken
from ...calibration.evidence.new_poses import evidence_of_poses
from ...calibration.result import Calibration
from ...core.formatting.numbers import digits, probability
from ...core.geometry.checks import as_numbers
from ...errors import InputError
from ...findings import Finding
from ...model.noise.models import PoseNoise
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.to_dict import sha256_of
from ...model.posterior.owners import THINGS, checked_things
from ...rig.description import Rig, require_left_out
from ...rig.in_use.update import update_rig
from ...rig.result import RigCalibration
from .check import check
from .joined_poses import arguments, holds_request, joined_poses, measured_poses, require_joinable
from .misread import MISREAD

# Name, among the options of a provenance, of what was put together: hash and number of poses of each part.
TOGETHER = "together"


@overload
def update(result: RigCalibration, poses: Rig, *, although_changed: bool = False) -> RigCalibration: ...
@overload
def update(result: Calibration, poses: PosePairs, **options: Any) -> Calibration: ...
def update(
    result: Any,
    poses: Any,
    *,
    noise: PoseNoise | None = None,
    joints: ArrayLike | None = None,
    although_changed: bool = False,
    same: Iterable[str] | str = THINGS,
) -> Any:
    """Return the calibration of the poses of a result and of new ones together.

    Parameters
    ----------
    result : Calibration or RigCalibration
        It is asked again with its own options: method, noise as given or estimated, shared errors, priors, arm. That of
        a rig takes a Rig as ``poses`` (`uq_handeye.rig.in_use.update`).
    poses : PosePairs
        New poses of the same rig, one or more; with corners where those of the result have them: the camera is then
        adjusted with all pictures.
    noise : PoseNoise or None
        Noise of the new poses, where that of the result was given. None: as that of the old ones.
    joints : (m, L) or None
        Joint values of the new poses, where the result knows the arm; None: ``poses.joints``.
    although_changed : bool
        Update even if the new poses contradict the result.
    same : names out of "robot", "camera" and "target"
        Which of them are those of the result. Default: all. The errors of others are drawn again, and the posterior of
        the result takes the new poses in: one fit of all poses has one robot, camera and target.

    Returns
    -------
    Calibration
        Its provenance says what was put together.

    Raises
    ------
    InputError
        Another setup or unit, poses that the result holds already, poses that contradict it, a result that does not
        hold what the same question needs.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> poses = uq.simulate(n_poses=24, noise=uq.PoseNoise.isotropic(camera=("1mrad", "0.5mm")), seed=1)
    >>> first = uq.calibrate(poses.rows(range(20)))
    >>> both = uq.update(first, poses.rows(range(20, 24)))
    >>> both.n_poses, bool((both.std < 1.2 * first.std).all())
    (24, True)
    """
    if isinstance(result, RigCalibration):
        require_left_out("of a rig", noise=noise, joints=joints, same=None if same is THINGS else same)
        return update_rig(result, poses, although_changed=although_changed)
    if not isinstance(result, Calibration):
        raise InputError(f"Expected `result` to be a Calibration, got {type(result).__name__}.")
    if not isinstance(poses, PosePairs):
        raise InputError(f"Expected `poses` to be PosePairs, got {type(poses).__name__}.")
    if noise is not None and not isinstance(noise, PoseNoise):
        raise InputError(f"Expected `noise` to be PoseNoise or None, got {type(noise).__name__}.")
    if result.setup is None:
        raise InputError("The result is of motions that came without poses: an update needs poses.")
    if joints is not None and result.kinematics is None:
        raise InputError("The result knows no joints: leave out those of the new poses, or calibrate with kinematics.")
    if joints is not None:
        poses = replace(poses, joints=as_numbers(joints, "joints"))
    parts = parts_of(result)
    new = part_of(poses)
    if any(part["sha256"] == new["sha256"] for part in parts):
        raise InputError("The result was made with these poses already: a pose counts once.")
    if not holds_request(result) or touches_taken(result) or checked_things(same) != frozenset(THINGS):
        return _by_posterior(result, poses, noise, although_changed, [*parts, new], same)
    old = measured_poses(result)
    require_joinable(old, poses)
    if result.kinematics is not None and poses.joints is None:
        raise InputError("The result knows the joints of its robot: expected joints of the new poses (--joints).")
    both, numbers = joined_poses(old, poses)
    asked = arguments(result, both, numbers, noise)
    if not although_changed:
        require_unchanged(result, poses, noise)
    found = calibrate(both, **asked)
    return replace(found, about=result.about, provenance=_together(found.provenance, [*parts, new]))


def _by_posterior(
    result: Calibration,
    poses: PosePairs,
    noise: PoseNoise | None,
    although_changed: bool,
    parts: list[dict[str, Any]],
    same: Iterable[str] | str,
) -> Calibration:
    """The update of the joint posterior: where the result lacks its poses, what was asked of them, or touches; and
    where not all is the same.
    """
    evidence = evidence_of_poses(result, poses, noise, same=same)
    if not although_changed:
        require_unchanged(result, poses, noise, same)
    n_old = result.n_poses or 0
    finding = Finding("maintenance.by_posterior", "note", {"old": n_old, "new": poses.n})
    found = absorbed_into(result, evidence, finding, {TOGETHER: parts})
    origin = found.provenance
    parts_alone: dict[str, Any] = {"data": None, "table": None, "analysis": None, "fit": None, "fourdpa": None}
    return replace(
        found,
        n_poses=n_old + poses.n,
        excluded=(),
        bound=None,
        agreement=None,
        provenance=None if origin is None else replace(origin, request=None),
        **parts_alone,
    )


def require_unchanged(
    result: Calibration, poses: PosePairs, noise: PoseNoise | None, same: Iterable[str] | str = THINGS
) -> None:
    """Raise `InputError` where the new poses say that something has changed (`check`), if they can be held against the
    result at all.
    """
    if result.posterior is None or result.opened is not None or result.noise is None:
        return
    found = check(result, poses, noise=noise, same=same)
    for finding in found.findings:
        if finding.code in MISREAD:
            raise InputError(f"The new poses contradict the result as they were read. {finding}")
    if found.changed:
        cause = f", probably {found.cause}" if found.cause is not None else ""
        raise InputError(
            f"The new poses contradict the result ({probability(found.p_value)}): something has changed{cause}. Look "
            "at uq-handeye check, and calibrate again; or update all the same (--although-changed)."
        )


def gain(old: Calibration, new: Calibration, count: int) -> str:
    """Return in words what ``count`` new poses brought: standard deviations before and after, and the headline."""
    poses = f"{count} new {'pose' if count == 1 else 'poses'} beside {old.n_poses}"
    before = f"Before: {old.headline}"
    sizes = [(of.weakest_translation, of.weakest_rotation) for of in (old, new)]
    if any(size is None for pair in sizes for size in pair):
        return f"Updated by {poses}. {before}"
    move, turn = ([1e3 * pair[0][1] for pair in sizes], [np.degrees(pair[1][1]) for pair in sizes])  # type: ignore[index]
    return (
        f"Updated by {poses}: translation of X {digits(move[0], 2)} to {digits(move[1], 2)} mm, rotation "
        f"{digits(turn[0], 2)} to {digits(turn[1], 2)} deg (1 sigma, worst axis). {before}"
    )


def parts_of(result: Calibration) -> list[dict[str, Any]]:
    """Return hash and number of poses of each data set that a result was made of."""
    origin = result.provenance
    if origin is None:
        return []
    return list(origin.options.get(TOGETHER, [{"sha256": origin.data_sha256, "poses": result.n_poses}]))


def _options(result: Calibration) -> dict[str, Any]:
    return {} if result.provenance is None else result.provenance.options


def part_of(poses: PosePairs) -> dict[str, Any]:
    """Return hash and number of poses of one data set."""
    return {"sha256": sha256_of(poses.robot, poses.camera), "poses": poses.n}


def _together(origin: Provenance | None, parts: list[dict[str, Any]]) -> Provenance:
    assert origin is not None
    return replace(origin, options=origin.options | {TOGETHER: parts})
