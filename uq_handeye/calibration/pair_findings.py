"""Findings about each camera and target of a rig, by the checks of poses side by side.

The views of one target by one camera, where one arm moves between them, are pairs of poses: A X = X B holds for them
alone. So units, direction, setup, order and rows of the files are checked as for one camera (`findings`), and each
finding is named by its camera, with the option or the line of the rig file for that camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array, inverse
from ..core.limits import MAJORITY, MIN_POSES, MIN_POSES_FOR_ROBUST
from ..errors import InputError, NotConvergedError
from ..findings import INPUT, Finding, without_consequences
from ..fit.diagnostics.columns import check_poses
from ..fit.diagnostics.exchanged_views import exchanged
from ..fit.diagnostics.misread_files import INVERSE
from ..fit.diagnostics.pose_ambiguity import flipped_rows
from ..fit.diagnostics.residuals import check_fit, misread
from ..fit.graph.constraint import Unknowns
from ..fit.graph.request import Request
from ..fit.graph.sizes import ALL_TARGETS
from ..model.errors.key import ErrorKey, Kind
from ..model.poses.pose_pairs import Names, PosePairs
from ..model.poses.residuals import pose_residuals
from ..model.rig.description import WORLD, Rig, View
from .findings import MAX_REJECTED_SHARE, SUSPICIOUS, look_at, misplaced_rows, reasons
from .job import job_of
from .rig_poses import RigPoses

# Outliers are named by the weights of the rig; where a target is seen, a rig has no option for another convention.
_LEFT_OUT = ("input_checks.outliers", "input_checks.target_unseen", "input_checks.steadier_reading")


class Pair(NamedTuple):
    """The views of one target by one camera, as poses side by side."""

    poses: PosePairs
    views: NDArray[np.intp]  # (n,) numbers among all views of the rig
    moments: tuple[tuple[str, object], ...]  # (n,) arm and name of the robot pose of each

    @property
    def names(self) -> Names:
        """Names of arm, camera and target."""
        return self.poses.names


def pairs_of(rig: Rig) -> list[Pair]:
    """Return the pairs of camera and target between which one arm moves."""
    views: dict[tuple[str, str], list[tuple[int, View]]] = {}
    first = 0
    for view in rig.views:
        arms = [place for place in rig.places(view) if place != WORLD]
        if len(arms) == 1:
            views.setdefault((view.camera, view.target), []).append((first, view))
        first += len(view.poses)
    return [_pair(rig, of) for of in views.values()]


def _pair(rig: Rig, of: Sequence[tuple[int, View]]) -> Pair:
    view = of[0][1]
    on_camera, on_target = rig.places(view)
    arm, setup = (on_target, "eye-to-hand") if on_camera == WORLD else (on_camera, "eye-in-hand")
    row = {moment: k for k, moment in enumerate(rig.arms[arm].names)}
    moments = [moment for _, one in of for moment in one.at or ()]
    poses = PosePairs(
        rig.arms[arm].poses[[row[moment] for moment in moments]],
        np.concatenate([one.poses for _, one in of]),
        setup,
        names=Names(arm, view.camera, view.target),
    )
    numbers = np.concatenate([np.arange(first, first + len(one.poses)) for first, one in of])
    return Pair(poses, numbers, tuple((arm, moment) for moment in moments))


def findings_of_pairs(rig: Rig, result: RigPoses | None) -> list[Finding]:
    """Return what the files of each camera show; ``result``: the fit of the rig, None where it failed."""
    pairs = [pair for pair in pairs_of(rig) if pair.poses.n >= MIN_POSES]
    of_pairs = [without_consequences(_of_files(pair, result)) for pair in pairs]
    if not all(any(map(_is_inverse, of)) for of in of_pairs):  # the setup and the robot file are right for some camera
        of_pairs = [list(map(_camera_first, of)) for of in of_pairs]
    named = [_of_pair(one, pair.names) for pair, of in zip(pairs, of_pairs, strict=True) for one in of]
    return list(
        {repr(one.to_dict()): one for one in [*_same_views(rig), *_exchanged_views(rig, result), *named]}.values()
    )


def _is_inverse(finding: Finding) -> bool:
    readings = finding.values.get("readings") or [{}]
    return readings[0].get("kind") in INVERSE


def _camera_first(finding: Finding) -> Finding:
    """Return a finding in which an inverse camera file is likelier than the other setup."""
    if not _is_inverse(finding):
        return finding
    readings = sorted(finding.values["readings"], key=lambda reading: reading["kind"] != "inverse camera")
    return replace(finding, values={**finding.values, "readings": readings})


def _of_pair(finding: Finding, names: Names) -> Finding:
    """Return a finding with the names of camera and target; one of the robot file alone is that of all cameras."""
    if finding.values.get("file") == "robot":
        return finding
    values = {"camera": names.camera, "target": names.target, "finding": _with_name(finding, names.camera).to_dict()}
    return Finding("rig.of_camera", finding.severity, values)


def _with_name(finding: Finding, camera: str) -> Finding:
    """Return a finding whose readings name the camera, for the options of its file."""

    def named(value: object) -> object:
        match value:
            case list():
                return [named(part) for part in value]
            case dict() if "kind" in value:
                return {name: named(part) for name, part in value.items()} | {"name": camera}
        return value

    values = {name: named(value) for name, value in finding.values.items()}
    return Finding(finding.code, finding.severity, values | ({"name": camera} if "file" in values else {}))


def _of_files(pair: Pair, result: RigPoses | None) -> list[Finding]:
    poses = pair.poses
    if result is None:
        return _without_fit(poses)
    X, W, covariance = _unknowns(pair, result)
    weight = _weights(pair, result)
    kept = weight > 0
    if 2 * int(kept.sum()) < poses.n or int(kept.sum()) < MIN_POSES:  # X is not that of these poses
        found = _without_fit(poses)
        if any(one.explains for one in found):
            return found
    found = [one for one in check_poses(poses) if one.severity != "note"]
    if int(kept.sum()) < MIN_POSES:
        return found
    rest = poses if kept.all() else poses.rows(np.flatnonzero(kept))
    found += check_fit(rest, X, None, covariance, None, _size(pair, result), judged=True)
    if (~kept).mean() > MAX_REJECTED_SHARE and not any(one.severity == "failure" for one in found):
        found += misread(poses, X, minority=2 * int(kept.sum()) < len(kept))
    turn = float(np.sqrt(np.mean(pose_residuals(poses.effective_robot, poses.camera, X)[0] ** 2)))
    bad, at = np.flatnonzero(~kept), Unknowns(X, W)
    if poses.n >= MIN_POSES_FOR_ROBUST and (len(bad) >= max(2, 0.05 * poses.n) or turn >= SUSPICIOUS):
        found += misplaced_rows(poses, at, ~kept)
    if len(bad) and (flips := flipped_rows(poses, at, weight > 0.9, bad.tolist(), None)):
        found.append(Finding("input_checks.flipped_poses", "caution", {"rows": flips}))
    return [one for one in found if one.code not in _LEFT_OUT]


def _without_fit(poses: PosePairs) -> list[Finding]:
    """Return the findings of the files, and other readings of them, without a fit of the rig."""
    with suppress(InputError, NotConvergedError):
        job = job_of(Request(), poses)
        found = [one for one in [*look_at(job), *reasons(job)] if one.explains or one.record.check == INPUT]
        return [one for one in found if one.code not in _LEFT_OUT]
    return check_poses(poses)


def _unknowns(pair: Pair, result: RigPoses) -> tuple[Array, Array, Array]:
    """Return X, W and the covariance (6, 6) of X, in the base of the arm of a pair."""
    names = pair.names
    X, W = (result.poses[result.names.index(name)] for name in (names.camera, names.target))
    S = result.block(names.camera, names.camera)
    if names.arm in result.names:
        to_base = inverse(result.poses[result.names.index(names.arm)])
        X, W = (to_base @ X, W) if pair.poses.setup == "eye-to-hand" else (X, to_base @ W)
    return X, W, S


def _weights(pair: Pair, result: RigPoses) -> Array:
    of_pose = dict(zip(result.pose_names, result.pose_weights.tolist(), strict=True))
    robot = np.array([of_pose.get(moment, 1.0) for moment in pair.moments])
    return np.asarray(np.minimum(result.weights[pair.views], robot))


def _size(pair: Pair, result: RigPoses) -> float:
    """Return the size of the target, estimated with the rig, as a multiple of the one given."""
    if (joint := result.posterior) is None:
        return 1.0
    sizes, size = {ErrorKey.from_dict(part["key"]): float(part["size"]) for part in result.components}, 1.0
    for key, z in zip(joint.keys, joint.estimate.tolist(), strict=True):  # in units of the size
        if key.kind == Kind.SCALE and (key.name == pair.names.target or key.owner == ALL_TARGETS):
            size /= 1.0 + sizes.get(key, 0.0) * z
    return size


def _exchanged_views(rig: Rig, result: RigPoses | None) -> list[Finding]:
    """Return the pairs of cameras, or of targets, whose views are exchanged at some moments.

    It is a failure where the fit used them, or where so many are exchanged that the others may be.
    """
    found = []
    out = set() if result is None else {*result.rejected, *(moment for _, moment in result.rejected_poses)}
    for one, two in combinations(rig.views, 2):
        what = "camera" if one.target == two.target else "target" if one.camera == two.camera else ""
        names = getattr(one, what, ""), getattr(two, what, "")
        first, second = _common(one, two)
        if not what or rig.place(names[0]) != rig.place(names[1]) or len(first) < MIN_POSES:
            continue
        C, C_2 = one.poses[first], two.poses[second]
        lever = float(np.median(np.linalg.norm(C[:, :3, 3], axis=-1)))
        turned = exchanged(C @ inverse(C_2) if what == "camera" else inverse(C) @ C_2, lever)
        rows = [(one.at or ())[k] for k in first[turned]]
        if rows:
            keys = [(view.camera, view.target, row) for view in (one, two) for row in rows]
            few = len(rows) <= (1.0 - MAJORITY) * len(first)
            left_out = few and all(key in out or key[-1] in out for key in keys)
            values = {"what": what, "one": names[0], "two": names[1], "rows": rows, "count": len(first),
                      "left_out": left_out}  # fmt: skip
            found.append(Finding("rig.exchanged_views", "caution" if left_out else "failure", values))
    return found


def _common(one: View, two: View) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows of two views at the moments that both have."""
    at = {moment: k for k, moment in enumerate(two.at or ())}
    both = [(k, at[moment]) for k, moment in enumerate(one.at or ()) if moment in at]
    first, second = np.array(both, dtype=np.intp).reshape(-1, 2).T
    return first, second


def _same_views(rig: Rig) -> list[Finding]:
    """Return the pairs of cameras, or of targets, whose views hold the same poses at the same moments."""
    found = []
    for one, two in combinations(rig.views, 2):
        if (one.camera, one.target) == (two.camera, two.target):
            continue
        first, second = _common(one, two)
        if len(first) < MIN_POSES:
            continue
        if np.array_equal(one.poses[first], two.poses[second]):
            what = "target" if one.camera == two.camera else "camera"
            values = {"what": what, "one": getattr(one, what), "two": getattr(two, what), "count": len(first),
                      "sources": [view.source for view in (one, two) if view.source]}  # fmt: skip
            found.append(Finding("rig.same_views", "failure", values))
    return found
