"""Check of the lengths of X and W: a part on the gripper is nearer to it than the base to a part fixed in the cell."""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array, inverse, logarithm
from ...findings import Finding, Severity
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.target_views import STEADY_VIEW, direction_spread
from .misread_files import inverted_on_request
from .readings import OTHER_SETUP

# What sits farther from the gripper than this, and than the fixed part from the base, is unusual.
LONG_BRACKET_M = 0.4
# What few grippers carry, while a fixed camera is often farther from the base.
UNLIKELY_BRACKET_M = 0.7
# A camera on a gripper sits nearer to it than this.
FAR_CAMERA_M = 0.5
# X is the identity within this many standard deviations, if these are smaller than what a camera has beside a gripper.
IDENTITY_SD, MAX_IDENTITY_SD_M, MAX_IDENTITY_SD_RAD = 4.0, 0.005, np.radians(1.0)
# What no gripper carries.
IMPOSSIBLE_BRACKET_M = 1.0


def check_place(poses: PosePairs, X: Array, covariance: Array) -> list[Finding]:
    """Report X that is the identity within its uncertainty, and a camera that sits far beside its gripper.

    The sensor would sit in the frame that carries it, which nobody builds: the poses of one file were computed from
    those of the other, or both files are of one frame.
    """
    xi = np.concatenate([logarithm(X[:3, :3]), X[:3, 3]])
    move, turn = float(np.linalg.norm(xi[3:])), float(np.linalg.norm(xi[:3]))
    sd_move, sd_turn = (float(np.sqrt(np.trace(covariance[k : k + 3, k : k + 3]))) for k in (3, 0))
    sharp = sd_move < MAX_IDENTITY_SD_M and 0.0 < sd_turn < MAX_IDENTITY_SD_RAD
    if sharp and move < IDENTITY_SD * sd_move and turn < IDENTITY_SD * sd_turn:
        values = {"setup": poses.setup, "translation": move, "rotation": turn}
        return [Finding("input_checks.identity", "caution", values)]
    if poses.setup == "eye-in-hand" and move > FAR_CAMERA_M and move - IDENTITY_SD * sd_move > FAR_CAMERA_M:
        return [Finding("input_checks.far_camera", "caution", {"length": move})]
    return []


def check_lengths(poses: PosePairs, X: Array) -> list[Finding]:
    """Report a sensor bracket that is longer than the arm, and another reading of the files by which it is not.

    Two lists in the wrong place fit ``G X C = W`` exactly, with X and W exchanged: both inverse, ``inv(G) W inv(C) =
    X``; or swapped, ``C inv(W) G = inv(X)``, where G is the robot's own list (eye-in-hand; eye-to-hand it gives inv(X)
    for X, of the same length). Lengths alone cannot tell a long bracket from that. But a camera looks at its target:
    where the list read as camera poses shows the target in nearly the same direction throughout, and what would be the
    camera poses by the other reading does not, the files are as they should be; then it is the other setup, with the
    robot poses inverted, that gives the same matrix X its other name.
    """
    said = all(finding.values.get("said", True) for finding in poses.findings)  # the setup
    if inverted_on_request(poses) == ["camera"] and not said:
        seen, as_given = (direction_spread(T) for T in (poses.camera, inverse(poses.camera)))
        if as_given < STEADY_VIEW * seen:
            values = {"setup": OTHER_SETUP[poses.setup], "seen": seen, "as_given": as_given}
            return [Finding("input_checks.setup_not_said", "caution", values)]
    W = poses.effective_robot @ X @ poses.camera
    long_X = float(np.linalg.norm(X[:3, 3]))
    long_W = float(np.linalg.norm(np.median(W[:, :3, 3], axis=0)))  # whatever single rows are in another unit
    in_hand = poses.setup == "eye-in-hand"
    on_gripper, fixed = (long_X, long_W) if in_hand else (long_W, long_X)
    if on_gripper < LONG_BRACKET_M or on_gripper < 2.0 * fixed:
        return []
    others = [inverse(poses.camera), poses.robot] if in_hand else [inverse(poses.camera)]
    what = "camera" if in_hand else "target"
    longer = on_gripper > 3.0 * fixed
    if direction_spread(poses.camera) < STEADY_VIEW * min(direction_spread(T) for T in others):
        values = {
            "what": what,
            "length": on_gripper,
            "fixed": fixed,
            "setup": OTHER_SETUP[poses.setup],
            "inverted": "robot" in inverted_on_request(poses),
        }
        found = [Finding("input_checks.setup_by_lengths", "caution", values)]
        return found if longer and on_gripper > UNLIKELY_BRACKET_M else []
    severity: Severity = "failure" if longer and on_gripper > IMPOSSIBLE_BRACKET_M else "caution"
    return [Finding("input_checks.long_bracket", severity, {"what": what, "length": on_gripper, "fixed": fixed})]
