r"""Split-half consistency: X from two halves of the data against the sum of their covariances.

Model: halves 1 and 2 share no pose, each has its own estimate of X (and of W): one Gauss-Newton step on its own rows
from the fit of all rows, linearised there. The difference ``d = (theta, tau)``,
``R_1 = exp([theta]x) R_2``, ``t_1 = t_2 + tau``, has to first order the covariance

    V = C_1 + C_2 - K_12 - K_12^T,    K_12 = G_1 S_12 G_2^T,    G_h = C_h J_h^T S_hh^-1 (rows of X)

K_12 = 0 for errors that are independent from pose to pose; S_12 is the covariance of the residuals of one half with
those of the other, which a joint noise fills. ``d^T V^-1 d`` is chi-square(6) distributed if the noise is known. Noise
that was estimated with nu degrees of freedom is several sizes with priors, and d a small part of the data that they are
estimated from: ``d^2 / 6`` is taken as F(6, nu) distributed. (Were it one scale without a prior, d^2 could not exceed
nu, and ``d^2 / nu`` would be Beta distributed; with priors that rejects right data far too often.)

The test detects errors that differ between the halves (drift, wrong kinematics, a noise given too small). It does not
detect errors that both halves share, such as that of the intrinsics.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc

from ...core.files.records import NUMBER, Record
from ...core.geometry.se3 import Array, logarithm
from ...core.levels import CONTRADICTED
from ...core.limits import MIN_POSES
from ...errors import DegenerateMotionError, InputError
from ...findings import Finding
from ...model.errors.square_roots import Covariance, cholesky_of, gram, is_joint, pulled, rows_of, whiten
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ..graph.gauss_helmert import Fit, inverse_information

# Degrees of freedom of estimated noise below which there is no test: with fewer, most of what is known of the noise is
# its prior, and the difference of the halves is no part of that.
MIN_NOISE_FREEDOM = 12.0


@dataclass(frozen=True, eq=False)
class SplitHalf(Record):
    """The two estimates and the test, or the `reason` why there is none (numbers are then None).

    Leading axes of the data are independent problems and appear in every array; files hold one.
    """

    _where: ClassVar[str] = "split_half"
    _in_file: ClassVar[str] = "split halves reason dof X1 X2 difference covariance d2 p_value passed"

    split: str
    halves: tuple[
        Annotated[NDArray[np.intp], "a"], Annotated[NDArray[np.intp], "b"]
    ]  # numbers of the poses (or motions) in each
    reason: Finding | None  # why there is no test
    X1: Annotated[Array, 4, 4] | None = None  # (..., 4, 4)
    X2: Annotated[Array, 4, 4] | None = None
    difference: Annotated[Array, 6] | None = (
        None  # (..., 6): X1 from X2, left rotation in rad, additive translation in m
    )
    covariance: Annotated[Array, 6, 6] | None = None  # (..., 6, 6) of the difference
    d2: Annotated[Array, NUMBER] | None = None  # (...)
    dof: float | None = None  # degrees of freedom of the estimated noise; None: known noise
    p_value: Annotated[Array, NUMBER] | None = None  # (...)

    @property
    def passed(self) -> NDArray[np.bool_] | None:
        """(...) whether the halves agree: their difference is no contradiction; None where the test is not possible."""
        return None if self.p_value is None else np.asarray(self.p_value >= CONTRADICTED.probability)

    @property
    def possible(self) -> bool:
        """True if there is a test."""
        return self.reason is None

    @property
    def finding(self) -> Finding:
        """The result: a caution where the halves contradict each other beyond any chance."""
        if self.reason is not None:
            return self.reason
        assert self.passed is not None and self.difference is not None
        assert self.d2 is not None and self.p_value is not None
        if self.passed.ndim:
            values = {"split": self.split, "passed": self.passed.sum(), "tests": self.passed.size}
            return Finding("diagnostics.many_halves", "note", values)
        values = {
            "split": self.split,
            "sizes": [len(half) for half in self.halves],
            "rotation": np.linalg.norm(self.difference[:3]),
            "translation": np.linalg.norm(self.difference[3:]),
            "d2": self.d2,
            "p_value": self.p_value,
            "agree": self.passed,
        }
        return Finding("diagnostics.halves", "note" if self.passed else "caution", values)

    @property
    def sentence(self) -> str:
        """The result in words."""
        return str(self.finding)

    def _possible(self) -> SplitHalf:
        for name in ("X1", "X2", "difference", "covariance", "d2", "p_value"):
            if (missing := getattr(self, name) is None) and self.reason is None:
                raise InputError(f"Expected split_half.{name} to be numbers, or a reason why there are none.")
            if not missing and self.reason is not None:
                raise InputError("The split-half test is damaged: it has numbers, and a reason why it has none.")
        return self


def split_fit(fit: Fit, data: PosePairs | Motions, split: str, dof: float | None = None) -> SplitHalf:
    """X from two halves of the rows of a fit of the data, and whether they agree within their covariances.

    Rows of a robust weight below 1 are left out. Each half moves X from that of all rows by one Gauss-Newton step on
    its own rows. Halves that are too small or do not determine X are no error: the result says so.

    Parameters
    ----------
    fit : Fit
        Of `data`; leading axes are independent problems.
    split : "interleaved" or "contiguous"
        Even and odd rows (both halves see the whole path, so that both determine X); or first and last rows (finds
        drift over time).
    dof : float or None
        Degrees of freedom with which the scale of the noise was estimated; None if the noise is known.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> from uq_handeye.fit.diagnostics.split_half import split_fit
    >>> noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    >>> poses = uq.simulate(n_poses=20, noise=noise, seed=3)
    >>> split_fit(uq.efficient(poses, noise), poses, "interleaved").possible
    True
    """
    if fit.W is not None:
        assert data.poses is not None
        data = data.poses
    rows = np.arange(fit.residual.shape[-2])
    if fit.weights is not None and (fit.weights < 1).any():  # halves know no weights
        rows = np.flatnonzero(fit.weights == 1)
        data = data.rows(rows)
    first, second = _halves(data, split)
    halves = rows[first], rows[second]

    def without(why: str, **values: object) -> SplitHalf:
        return SplitHalf(split, halves, Finding(f"diagnostics.{why}", "note", {"split": split, **values}))

    fewest = min(len(half) for half in halves)
    if fewest < MIN_POSES:
        item = "motion" if fit.W is None else "pose"
        return without("halves_too_small", item=item, rows=fewest, needed=MIN_POSES)
    if dof is not None and dof < MIN_NOISE_FREEDOM:
        return without("halves_without_freedom", dof=dof)
    joint = is_joint(fit.S)
    stacked = np.concatenate([fit.linear.J, fit.residual[..., None]], axis=-1)
    found, back = [], []
    for half in halves:  # one after the other: each has its part of the columns
        factor = cholesky_of(rows_of(fit.S, half))
        white = whiten(factor, stacked[..., half, :, :])
        found.append(gram(white))
        back += [pulled(factor, white)[..., :-1]] if joint else []
        del factor, white
    sums = np.stack(found)
    try:
        C = inverse_information(sums[..., :-1, :-1])
    except DegenerateMotionError as error:
        return without("half_fails", error=str(error))
    step = -(C @ sums[..., :-1, -1:])[..., 0]
    X1, X2 = (fit.unknowns.moved(part).X for part in step)
    d = np.concatenate([logarithm(X1[..., :3, :3] @ X2[..., :3, :3].mT), X1[..., :3, 3] - X2[..., :3, 3]], axis=-1)
    V = C[0, ..., :6, :6] + C[1, ..., :6, :6]
    if joint:
        K = _between(fit.S, halves, [of[..., :6, :] for of in C], back)
        V = V - K - K.mT
    spread = np.diagonal(V, axis1=-2, axis2=-1)
    if not (spread > 0).all():  # but for rounding, all of it is what both halves share
        return without("half_fails", error="The errors of both halves are the same.")
    unit = 1.0 / np.sqrt(spread)
    scaled = V * unit[..., :, None] * unit[..., None, :]
    d2 = np.sum(d * unit * np.linalg.solve(scaled, (d * unit)[..., None])[..., 0], axis=-1)
    p = chdtrc(6, d2) if dof is None else fdtrc(6, dof, d2 / 6)
    return SplitHalf(split, halves, None, X1, X2, d, V, np.asarray(d2), dof, np.asarray(p))


def _halves(data: PosePairs | Motions, split: str) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    order = np.arange(len(data))
    if split == "interleaved":
        return order[::2], order[1::2]
    if (times := getattr(data, "timestamps", None)) is not None:
        order = np.argsort(times, kind="stable")
    return order[: len(data) // 2], order[len(data) // 2 :]


def _between(S: Covariance, halves: tuple[NDArray[np.intp], ...], C: list[Array], back: list[Array]) -> Array:
    """K_12 (..., 6, 6) for joint noise, from rows of C (..., 6, p) and ``S_hh^-1 J_h`` (..., n_h, 6, p)."""
    gains = []
    for half, of, pull in zip(halves, C, back, strict=True):
        gain = np.zeros((*pull.shape[:-3], 6, S.shape[-1] // 6, 6))  # 0 for the rows of the other half
        gain[..., half, :] = np.einsum("...ap,...kip->...aki", of, pull)
        gains.append(gain.reshape(*gain.shape[:-2], -1))
    return np.asarray(gains[0] @ (S @ gains[1].mT))
