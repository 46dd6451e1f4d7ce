r"""Arm as a calibration found it: the errors of its kinematics, and poses corrected by them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.files.records import Record, parts_of
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array, difference, perturb
from ...errors import InputError
from ...model.kinematics.arms.postures import postures_at
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.errors import GROUPS
from ...model.kinematics.joint import require_within_limits
from ...model.kinematics.kinematic_errors import JOINT_NOISE, poses_with_errors
from ...model.posterior.posterior import Posterior

if TYPE_CHECKING:
    import pandas as pd

# The controller's poses are those of the joints where they differ by less (RMS, rad and m).
SAME = (np.radians(0.01), 1e-4)


class ErrorEstimate(NamedTuple):
    """One number of e: what was assumed of it, and what the data say (rad, m; ``true - model``)."""

    name: str
    group: str
    joint: str
    unit: str
    prior_sd: float
    estimate: float
    sd: float
    told: float  # share of the prior variance that the data took away, 0 to 1


@dataclass(frozen=True, eq=False)
class FittedKinematics(Record):
    """An arm with the estimates of its kinematic errors, ``true = FK(q; e)``.

    ``covariance`` is that of e; numbers that were left out (of the base, of the flange, of groups that are exact) are 0
    in both. Units: rad and m.
    """

    _in_file: ClassVar[str] = "chain names e covariance sd how flange joints beside_controller"

    chain: Kinematics
    e: Annotated[Array, "m"]  # (m,) of all errors of the chain
    covariance: Annotated[Array, "m", "m"]  # (m, m)
    sd: dict[str, float]  # deviations of the groups and of the joint noise, by name
    how: str  # "estimate", "declared" or "exact"
    flange: str  # "workspace", "controller" or "physical"
    joints: Annotated[Array, "n", "joints"]  # (n, L) at which it was calibrated
    beside_controller: tuple[float, float]  # RMS of the controller's poses less those of the joints, rad and m

    @property
    def joint_noise(self) -> float:
        """Standard deviation of the noise of each joint, rad."""
        return self.sd.get(JOINT_NOISE, 0.0)

    @property
    def kept(self) -> NDArray[np.intp]:
        """(k,) the numbers of the errors that count."""
        return np.flatnonzero(np.diag(self.covariance) > 0)

    def table(self) -> list[ErrorEstimate]:
        """The estimates of the errors that count, in the order of the chain's errors."""
        found = []
        for k in self.kept.tolist():
            of, prior = self.chain.errors[k], self.sd.get(self.chain.errors[k].group, 0.0)
            sd = float(np.sqrt(self.covariance[k, k]))
            told = float(np.clip(1.0 - (sd / prior) ** 2, 0.0, 1.0)) if prior > 0 else 0.0
            found.append(ErrorEstimate(of.name, of.group, of.joint, of.unit, prior, float(self.e[k]), sd, told))
        return found

    def told(self) -> dict[str, float]:
        """Share of the prior variance that the data took away from each group of errors, on average, 0 to 1."""
        rows = self.table()
        shares = {group: [row.told for row in rows if row.group == group] for group in GROUPS}
        return {group: float(np.mean(share)) for group, share in shares.items() if share}

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table of `table`, a row per number of e by its name."""
        import pandas as pd

        return pd.DataFrame(self.table(), columns=list(ErrorEstimate._fields)).set_index("name")

    def at(self, q: Array) -> Array:
        """(..., 4, 4) ``FK(q; e)`` at the estimate, in the frames that X is stated in."""
        return poses_with_errors(self.chain, q, self.e, self.flange)

    def poses(self, q: Any, robot: Array | None = None) -> Array:
        """(..., 4, 4) ``FK(q; e)``, corrected by the estimate, at joints q (..., L).

        ``robot`` (..., 4, 4) are the controller's poses there: they are moved as the correction moves those of the
        joints. Where its poses at the calibration were others than those of the joints, they are needed.
        """
        joints = self.checked(q)
        corrected = self.at(joints)
        if robot is None:
            if self.beside_controller[0] > SAME[0] or self.beside_controller[1] > SAME[1]:
                turn, shift = np.degrees(self.beside_controller[0]), 1e3 * self.beside_controller[1]
                raise InputError(
                    f"The controller's poses differ from those of the joints by {shift:.2g} mm and {turn:.2g} deg "
                    "(RMS): expected `robot`, its poses, beside `joints`."
                )
            return corrected
        nominal = self.chain.poses(joints)
        if nominal.shape != robot.shape:
            raise InputError(f"Expected `robot` poses {nominal.shape} at these joints, got shape {robot.shape}.")
        return perturb(robot, difference(corrected, nominal))

    def joints_at(self, robot: Array) -> Array:
        """(..., L) joint values at which the arm is at poses ``robot`` (..., 4, 4), near those of the calibration.

        Raises `InputError` for poses that the arm does not reach from there.
        """
        flat = robot.reshape(-1, 4, 4)
        at = self.chain.poses(self.joints)
        reach = max(self.chain.reach, 1e-3)
        apart = np.linalg.norm(flat[:, None, :3, 3] - at[:, :3, 3], axis=-1) / reach
        apart = apart + np.linalg.norm(flat[:, None, :3, :3] - at[:, :3, :3], axis=(-2, -1))
        found = postures_at(self.chain, flat, self.joints[apart.argmin(axis=1)])
        if not found.reached.all():
            raise InputError(
                f"The arm {self.chain.name} does not reach {int((~found.reached).sum())} of {len(flat)} robot poses "
                "near the postures of the calibration: give `joints` (--joints FILE.csv)."
            )
        return found.q.reshape(*robot.shape[:-2], -1)

    def checked(self, q: Any) -> Array:
        """Joints (..., L), rad (prismatic: m); raises `InputError`."""
        values = as_numbers(q, "joints")
        count = self.chain.n_joints
        if values.ndim < 1 or values.shape[-1] != count or not np.isfinite(values).all():
            raise InputError(
                f"Expected `joints` to be finite numbers (..., {count}) of {', '.join(self.chain.names)}, got shape "
                f"{values.shape}."
            )
        kinds = [joint.kind for joint in self.chain.joints]
        require_within_limits(
            values.reshape(-1, count), self.chain.names, kinds, self.chain.limits, np.zeros(count, dtype=bool),
            lambda row: f"`joints`, row {row}", "Expected rad, and m of prismatic joints.",
        )  # fmt: skip
        return values

    @classmethod
    def of(
        cls,
        chain: Kinematics,
        joints: Array,
        how: str,
        flange: str,
        sd: dict[str, float],
        beside_controller: tuple[float, float],
        posterior: Posterior,
    ) -> FittedKinematics:
        """Build the kinematics from the joint posterior, by the names of the errors."""
        m = len(chain.errors)
        e, covariance = np.zeros(m), np.zeros((m, m))
        place = {error.name: k for k, error in enumerate(chain.errors)}
        pairs = [(place[name], k) for k, name in enumerate(posterior.names) if name in place]
        if pairs:
            here, there = np.array(pairs).T
            e[here] = posterior.estimate[there]
            covariance[np.ix_(here, here)] = posterior.covariance[np.ix_(12 + there, 12 + there)]
        return cls(chain, e, covariance, sd, how, flange, joints, beside_controller)

    @property
    def names(self) -> list[str]:
        """Names of the errors of the chain."""
        return [error.name for error in self.chain.errors]

    @classmethod
    def from_dict(cls, data: Any) -> FittedKinematics:
        """Read what `to_dict` wrote; raises `InputError` on anything else."""
        found = cls(**parts_of(cls, data, "kinematics"))
        m, L = len(found.chain.errors), found.chain.n_joints
        if data.get("names") != found.names or len(found.e) != m or found.joints.shape[1:] != (L,):
            raise InputError(f"Expected kinematics with the {m} errors and {L} joints of their chain.")
        return found
