"""Checks of the numbers of two pose files by themselves: units, columns, repeated rows, the same file twice."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from ...findings import Finding, Severity
from ...model.poses.pose_pairs import PosePairs
from .misread_scale import SMALL_RIG_M
from .repeated_rows import repeated_rows_finding, rows_again

# Farther from its base than any arm reaches.
MAX_REACH_M = 20.0
# Numbers above this are millimetres: in centimetres they would be farther than most arms reach.
MILLIMETRES_FROM = 250.0

Value: TypeAlias = str | float | bool | list[str] | list[int]


def check_poses(poses: PosePairs) -> list[Finding]:
    """Check units, constant and equal columns and repeated rows of the pose lists, and the same list given twice."""
    found: list[Finding] = []

    def note(what: str, severity: Severity = "caution", **values: Value) -> None:
        found.append(Finding(f"input_checks.{what}", severity, values))

    # Both files in millimetres agree as well as in metres: nothing but lengths tells that X is a thousand times off.
    lengths = [float(np.median(np.abs(T[:, :3, 3]).max(axis=-1))) for T in (poses.robot, poses.camera)]
    both = min(lengths) > MAX_REACH_M and max(lengths) > MILLIMETRES_FROM
    stated = {side for one in poses.findings if one.code == "poses.units" for side in one.values["sides"]}
    if again := rows_again(poses):
        found.append(repeated_rows_finding(again, poses.n))
    new = np.setdiff1d(np.arange(1, poses.n), [row for row, _ in again])
    for name, T in (("robot", poses.robot), ("camera", poses.camera)):
        t = T[:, :3, 3]
        far = float(np.abs(t).max())
        if far > MAX_REACH_M and name not in stated:
            from_corners = name == "camera" and poses.camera_calibration is not None
            rows = np.flatnonzero(np.abs(t).max(axis=1) > MAX_REACH_M)
            few: dict[str, Value] = {"rows": rows[:5].tolist()} if 2 * len(rows) <= len(t) else {}
            unit = "mm" if far > MILLIMETRES_FROM or both else "cm"
            of_both = both and not stated and not from_corners
            few |= {"both": True} if of_both else {}
            severity: Severity = "failure" if of_both else "caution"
            note("far", severity, file=name, reach=far, unit=unit, from_corners=from_corners, **few)
        span = np.ptp(t, axis=0)
        if len(t) > 2 and float(np.ptp(T, axis=0).max()) <= 1e-9 * max(far, 1e-3):
            found.append(Finding("input_checks.still", "failure", {"file": name, "n": len(t)}))
            continue
        for axis in range(3):
            if len(t) > 1 and span[axis] <= 1e-9 * max(far, 1e-3):
                note("constant_column", file=name, column="xyz"[axis], value=t[0, axis] + 0.0)
        for a, b in ((0, 1), (0, 2), (1, 2)):
            if len(t) > 2 and span[a] > 1e-9 * max(far, 1e-3) and np.array_equal(t[:, a], t[:, b]):
                note("identical_columns", file=name, columns=["xyz"[a], "xyz"[b]], n=len(t))
        if same := int((T[new] == T[new - 1]).all(axis=(1, 2)).sum()):
            note("repeated_rows", file=name, count=same, n=len(T))
    reach = max(float(np.abs(T[:, :3, 3]).max(initial=0.0)) for T in (poses.robot, poses.camera))
    if 0.0 < reach < SMALL_RIG_M and poses.truth is None and len(stated) < 2:
        found.append(
            Finding("input_checks.tiny", "failure" if reach < SMALL_RIG_M / 10 else "caution", {"reach": reach})
        )
    if np.array_equal(poses.robot, poses.camera):
        found.append(Finding("input_checks.same_file", "failure"))
    return found
