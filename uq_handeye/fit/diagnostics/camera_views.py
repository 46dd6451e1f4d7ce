"""Check that the camera sees its target, and the readings of the files under which it would.

``A X = X B`` holds as well for poses of another frame of the camera, for two files of inverse poses and for files that
are exchanged: X is then another pose, with the same residuals. But a camera has its target ahead, within a cone about
its optical axis, and in nearly the same direction throughout. Trackers have no optical axis; their user says
``camera_convention="optical"``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.geometry.frames import CAMERA_CONVENTIONS, OTHER_CONVENTIONS
from ...core.geometry.se3 import Array, inverse
from ...findings import Finding
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.target_views import direction_spread
from .misread_files import inverted_on_request
from .readings import Reading

# A camera sees what stands within this angle of its optical axis.
MAX_OFF_AXIS_RAD = np.radians(60.0)
# Most cameras see what stands within this angle, and most people aim them at the target.
USUAL_FIELD_RAD = np.radians(35.0)
# A camera is aimed at its target to within this angle (median). Another reading is better aimed if its angle is smaller
# by this ratio, in this share of the poses.
AIMED_RAD, BETTER_AIMED_RATIO, AIMED_SHARE = np.radians(25.0), 0.45, 0.85
# A camera has its target ahead in this share of the poses, and one that is misread in fewer than the second share.
SEEN_SHARE, UNSEEN_SHARE = 0.9, 0.6
# Another reading is likelier if it shows the target in directions that vary by this share of those as given, and puts
# what is on the gripper nearer to it.
STEADIER_RATIO = 0.5
# Where it leaves its distance, the share has to be smaller.
MUCH_STEADIER_RATIO = 0.35


def check_views(poses: PosePairs, X: Array) -> list[Finding]:
    """Report a target that the camera cannot see, or sees in far steadier directions under another reading."""
    known = any(finding.code == "poses.camera_convention" for finding in poses.findings)
    if known or poses.camera_calibration is not None or poses.camera_covariance is not None or poses.n < 3:
        return []
    C = poses.camera
    seen = share_ahead(C)
    readings = _readings(poses, X)
    if seen < UNSEEN_SHARE:
        better = [one for one in readings if one["seen"] >= SEEN_SHARE]
        better.sort(key=lambda one: one["spread"])
        values = {"seen": round(seen * poses.n), "n": poses.n, "views": better}
        # without a likelier reading it may well be a tracker
        return [Finding("input_checks.target_unseen", "caution" if better else "note", values)]
    # poses of a robot that pivots do not say which file is inverse
    if float(np.linalg.norm(np.ptp(poses.robot[:, :3, 3], axis=0))) < 1e-6:
        return []
    off = _off_axis(C)
    spread, off_axis = direction_spread(C), share_ahead(C, USUAL_FIELD_RAD) < UNSEEN_SHARE
    better = [
        one
        for one in readings
        if "length" in one
        and one["length"] <= one["given"]
        and (
            (off_axis and one["ahead"] >= SEEN_SHARE)
            or (off > AIMED_RAD and one["ahead"] >= AIMED_SHARE and one["off"] < BETTER_AIMED_RATIO * off)
            or (
                one["seen"] >= SEEN_SHARE
                and one["spread"] < (STEADIER_RATIO if one["length"] < one["given"] else MUCH_STEADIER_RATIO) * spread
            )
        )
    ]
    if not better:
        return []
    values = {"spread": spread, "off": off, "views": sorted(better, key=lambda one: one["off"])}
    return [Finding("input_checks.steadier_reading", "caution", values)]


def share_ahead(T: Array, within: float = MAX_OFF_AXIS_RAD) -> float:
    """Return the share of target poses (n, 4, 4) that stand ahead of a camera, within an angle (rad) of its axis."""
    t = T[:, :3, 3]
    return float(np.mean(t[:, 2] > np.cos(within) * np.linalg.norm(t, axis=1)))


def _readings(poses: PosePairs, X: Array) -> list[Reading]:
    """Return the readings that fit as well: ``kind``, the share of targets ``seen``, ``spread`` of directions (rad).

    Of those that give X another place, ``length`` is that of what is on the gripper (m), and ``given`` the one as read.
    """
    G, C = poses.robot, poses.camera
    in_hand = poses.setup == "eye-in-hand"
    W = poses.effective_robot @ X @ C
    long_X, long_W = float(np.linalg.norm(X[:3, 3])), float(np.linalg.norm(np.median(W[:, :3, 3], axis=0)))
    on_gripper, fixed = (long_X, long_W) if in_hand else (long_W, long_X)
    found: list[Reading] = []
    for name in OTHER_CONVENTIONS:
        turned = CAMERA_CONVENTIONS[name] @ C
        found.append({"kind": "convention", "name": name, **_views(turned)})
    inverted: Callable[[Array], Array] = inverse
    single = {"setup": poses.setup, "on_request": inverted_on_request(poses)}
    for kind, camera, length in (
        ("both inverse", inverted(C), fixed),
        ("exchanged", G, fixed if in_hand else on_gripper),
        ("exchanged inverse", inverted(G), on_gripper if in_hand else fixed),
    ):
        found.append({"kind": kind, **single, "length": length, "given": on_gripper, **_views(camera)})
    return found


def _views(T: Array) -> dict[str, float]:
    return {
        "seen": share_ahead(T),
        "ahead": share_ahead(T, USUAL_FIELD_RAD),
        "spread": direction_spread(T),
        "off": _off_axis(T),
    }


def _off_axis(T: Array) -> float:
    """Return the median angle (rad) of the targets off the optical axis."""
    t = T[:, :3, 3]
    return float(np.median(np.arctan2(np.linalg.norm(t[:, :2], axis=1), t[:, 2])))
