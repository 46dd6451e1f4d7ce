"""Joint values read from a file: they give the robot poses by forward kinematics, or go with poses of another file."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.files.open import StrPath, as_path, opened, shown
from ..core.files.source import Source
from ..core.geometry.se3 import Array
from ..core.limits import MAX_TABLE_BYTES, MIN_POSES
from ..errors import InputError, InputWarning, require_type
from ..formats.contents import FRAMES, Side
from ..model.poses.pose_pairs import PosePairs, joint_values_at
from ..model.poses.timing import MAX_GAP_INTERVALS
from .pairing_by_time import SYNCHRONOUS_S, check_tolerance, nearest

if TYPE_CHECKING:
    from ..model.kinematics.chain import Kinematics
    from ..model.kinematics.joint_readings import JointSeries
    from ..model.kinematics.joints_file import NamedJoints


@dataclass(frozen=True, eq=False)
class Joints:
    """The rows of a joint file and the chain that they move."""

    values: Array  # (n, L) rad, m
    timestamps: Array | None  # (n,) s
    kinematics: Kinematics
    source: Source
    name: str  # of the file, for messages
    series: JointSeries | None = None  # columns of which the first were read
    pendant: bool = False  # joint 3 was said to be as FANUC's pendant shows it

    def __len__(self) -> int:
        return len(self.values)

    @property
    def side(self) -> Side:
        """Return their poses by forward kinematics, as a file of robot poses would hold them."""
        T = self.kinematics.poses(self.values)
        return Side(self.name, T[:, :3, 3], T[:, :3, :3], self.timestamps, None, "row", frame=FRAMES["robot"][0])

    def at_rows(self, robot: Side, tolerance: float) -> Array:
        """Return joint values (n, L) at the n poses of a file of robot poses; NaN at a pose that has none.

        Row k belongs to row k where there are as many and the timestamps, if both have them, agree; else rows are
        paired by time, the nearest within ``tolerance``.
        """
        check_tolerance(tolerance)
        r, q = robot.timestamps, self.timestamps
        if r is None or q is None:
            if len(robot) != len(self):
                raise InputError(
                    f"{robot.name} has {len(robot)} poses and {self.name} has {len(self)} rows: expected the joints of "
                    "each pose. Leave out rows that the other file lacks, or add timestamps to both."
                )
            return self.values
        half = 0.5 * float(np.median(np.abs(np.diff(r)))) if len(r) > 1 else tolerance  # the interval between rows
        if len(robot) == len(self) and (late := float(np.abs(r - q).max())) <= min(tolerance, half):
            if late > SYNCHRONOUS_S:
                warnings.warn(
                    f"Rows of {robot.name} and {self.name} are paired by their order although their timestamps differ "
                    f"by up to {late:.6g} s. That is right if the robot stood still.",
                    InputWarning,
                    stacklevel=4,
                )
            return self.values
        at = nearest(r, q)
        values = self.values[at]
        values[np.abs(r - q[at]) > tolerance] = np.nan
        return values

    def at_times(self, robot: Side) -> Array:
        """Return joint values (n, L) at the times of a robot's stream, interpolated; NaN beyond their ends."""
        if robot.timestamps is None or self.timestamps is None:
            without = robot.name if robot.timestamps is None else self.name
            raise InputError(f"{without} has no timestamps: joints and robot poses of streams are paired by time.")
        order = np.argsort(self.timestamps, kind="stable")
        times, wanted = self.timestamps[order], robot.timestamps
        values = joint_values_at(times, self.values[order], wanted)
        right = np.clip(np.searchsorted(times, wanted), 1, max(len(times) - 1, 1))
        step = np.diff(times, append=np.inf) if len(times) < 2 else np.diff(times)
        far = step[right - 1] > MAX_GAP_INTERVALS * float(np.median(step))
        on = np.abs(times[nearest(wanted, times)] - wanted) <= SYNCHRONOUS_S
        outside = (wanted < times[0] - SYNCHRONOUS_S) | (wanted > times[-1] + SYNCHRONOUS_S)
        values[(far & ~on) | outside] = np.nan
        return values


def joints_of(joints: StrPath | NamedJoints | None, kinematics: Kinematics | None, units: str | None) -> Joints | None:
    """Return the rows of a file of joints with their chain, or None if neither is given."""
    if joints is None and kinematics is None:
        return None
    if joints is None or kinematics is None:
        here, other = ("joints", "kinematics") if kinematics is None else ("kinematics", "joints")
        raise InputError(
            f"Expected `{other}` beside `{here}`: a file of joint values (--joints) and the chain that they move "
            "(--urdf, --dh)."
        )
    return read_joint_file(joints, kinematics, units)


def read_joint_file(path: StrPath | NamedJoints, kinematics: Kinematics, units: str | None = None) -> Joints:
    """Read joint values and say where they are from."""
    from ..model.kinematics.chain import Kinematics
    from ..model.kinematics.joints_file import NamedJoints, read_joints

    require_type("kinematics", kinematics, Kinematics, "Kinematics")
    if isinstance(path, NamedJoints):
        found, name, short, data = read_joints(path, kinematics, units), path.name, path.name, path.values.tobytes()
    else:
        location = as_path(path)
        found, name, short = read_joints(location, kinematics, units), shown(location), shown(as_path(location.name))
        with opened(location, MAX_TABLE_BYTES) as file:
            data = file.read()
    source = Source(short, "joints", len(data), sha256(data).hexdigest(), tuple(found.notes))
    return Joints(found.q, found.timestamps, kinematics, source, name, found.series, found.pendant)


def give_joints(poses: PosePairs, values: Array, name: str) -> PosePairs:
    """Return the pairs with their joint values (n, L); pairs without (NaN) are left out, and noted."""
    have = np.isfinite(values).all(axis=1)
    if have.all():
        return replace(poses, joints=values)
    if have.sum() < MIN_POSES:
        raise InputError(
            f"{int(have.sum())} of {poses.n} poses have joints in {name}, and at least {MIN_POSES} are needed: are the "
            "timestamps of both files of one clock, in seconds? Rows that belong together may have row numbers."
        )
    rows = np.flatnonzero(~have)
    first, *others = poses.sources
    note = f"{len(rows)} pairs without joints in {name} are left out: {listed_rows(rows)}"
    left = replace(poses.rows(np.flatnonzero(have)), joints=values[have])
    return replace(left, sources=(first._replace(notes=(*first.notes, note)), *others))


def listed_rows(rows: NDArray[np.intp]) -> str:
    """Return row numbers as a note lists them."""
    return ", ".join(map(str, rows[:20])) + (", ..." if len(rows) > 20 else "")
