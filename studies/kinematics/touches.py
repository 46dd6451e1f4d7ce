r"""A tool ball in fixed sockets: the kinematic errors of an arm from points instead of poses.

Model of touch i, of socket s, with joints q_i, the ball b in the tip's frame and the places p_s of the sockets in the
base, all unknown:

    FK(q_i; e) b = p_s + v_i,    v_i ~ N(0, sigma^2 I + sigma_q^2 J_b J_b^T)

J_b the derivative of the ball's place by the joints. The standard deviations sigma and sigma_q, and those of the groups
of e about the population's, are found and integrated over as by `calibrate` (`one_model`). What the unknowns say of a
touch that was held out, all together:

- of a *known* socket: the residual ``FK(q) b - p_s``;
- of a *new* socket, of which nothing is known: differences of two touches, ``FK(q) b - FK(q') b``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import uq_handeye as uq
from studies.common.scores import nees
from uq_handeye.core.geometry.se3 import Array, skew
from uq_handeye.fit.graph.constraint import Linearised
from uq_handeye.fit.graph.engine import LatentModel
from uq_handeye.fit.graph.integration import integrate
from uq_handeye.fit.graph.mode import find_mode
from uq_handeye.model.errors.key import ErrorKey, Kind, Owner
from uq_handeye.model.errors.keys import JOINT_NOISE
from uq_handeye.model.errors.sizes import SIZES, Size
from uq_handeye.model.errors.term import ErrorTerm

TOUCH = "touch"
TOUCH_SD, TOUCH_FACTOR = 0.15e-3, 3.0  # m: what is known of the noise of a touch beforehand
BALL = np.array([0.0, 0.0, 0.033])  # m, in the frame of the tip: where the search starts
ROUNDS = 3


class Touches(NamedTuple):
    """Touches of one arm: joints (n, L), and the names of tool position and socket of each."""

    q: Array
    positions: NDArray[np.str_]
    sockets: NDArray[np.str_]

    def rows(self, index: NDArray[np.intp]) -> Touches:
        return Touches(self.q[index], self.positions[index], self.sockets[index])


def read_touches(folder: Path) -> Touches:
    table = pd.read_csv(folder / "touches.csv")
    q = pd.read_csv(folder / "joints.csv").drop(columns="timestamp").to_numpy()
    positions = table["tool_position"].to_numpy(dtype=str)
    holes = table["hole"].to_numpy().astype(str)
    return Touches(q, positions, np.char.add(np.char.add(positions, "/"), holes))


class Places(NamedTuple):
    """Places of the ball in the base, with what changes them."""

    p: Array  # (n, 3)
    by_ball: Array  # (n, 3, 3)
    by_errors: Array  # (n, 3, m)
    by_joints: Array  # (n, 3, L)


@dataclass(frozen=True, eq=False)
class TouchModel:
    """The unknowns x = (b, places of the sockets), the kept errors e, and their joint covariance."""

    kinematics: uq.Kinematics
    kept: NDArray[np.intp]
    names: tuple[str, ...]  # of the sockets
    ball: Array
    sockets: Array  # (s, 3)
    e: Array  # (m,)
    covariance: Array  # (3 + 3 s + m,) squared
    touch_sd: float
    joint_sd: float

    def places(self, q: Array) -> Places:
        every = np.zeros(len(self.kinematics.errors))
        every[self.kept] = self.e
        G = self.kinematics.poses(q, every)
        arm = G[:, :3, :3] @ self.ball
        D = np.concatenate([-skew(arm), np.broadcast_to(np.eye(3), (len(q), 3, 3))], axis=-1)
        by_errors = D @ self.kinematics.columns(q, every)[..., self.kept]
        return Places(arm + G[:, :3, 3], G[:, :3, :3], by_errors, D @ self.kinematics.jacobian(q, every))

    def own(self, at: Places) -> Array:
        """(n, 3, 3) noise of one touch."""
        return np.asarray(self.touch_sd**2 * np.eye(3) + self.joint_sd**2 * at.by_joints @ at.by_joints.mT)

    def rows(self, of: Touches) -> tuple[Array, Array, Places]:
        """Derivatives (n, 3, ...) of the residuals by all unknowns, and the residuals (n, 3)."""
        at, numbers = self.places(of.q), np.searchsorted(self.names, of.sockets)
        by_sockets = np.zeros((len(of.q), 3, len(self.names), 3))
        by_sockets[np.arange(len(of.q)), :, numbers] = -np.eye(3)
        A = np.concatenate([at.by_ball, by_sockets.reshape(len(of.q), 3, -1), at.by_errors], axis=-1)
        return A, at.p - self.sockets[numbers], at

    def judged(self, judge: str, of: Touches) -> tuple[Array, Array]:
        """`known` or `new`."""
        return self.known(of) if judge == "known" else self.new(of)

    def known(self, of: Touches) -> tuple[Array, Array]:
        """Residuals (n, 3) of touches of sockets that are known, and their covariances (n, 3, 3)."""
        A, r, at = self.rows(of)
        return r, A @ self.covariance @ A.mT + self.own(at)

    def new(self, of: Touches) -> tuple[Array, Array]:
        """The same of differences of the touches of each socket by twos, of sockets of which nothing is known."""
        pairs = np.concatenate([two_by_two(np.flatnonzero(of.sockets == name)) for name in np.unique(of.sockets)])
        at = self.places(of.q)
        A = np.zeros((len(of.q), 3, len(self.covariance)))
        A[..., :3], A[..., A.shape[-1] - len(self.kept) :] = at.by_ball, at.by_errors
        A, own = A[pairs[:, 0]] - A[pairs[:, 1]], self.own(at)
        return at.p[pairs[:, 0]] - at.p[pairs[:, 1]], A @ self.covariance @ A.mT + own[pairs].sum(axis=1)


def two_by_two(index: NDArray[np.intp]) -> NDArray[np.intp]:
    return index[: len(index) // 2 * 2].reshape(-1, 2)


def nominal(kinematics: uq.Kinematics, of: Touches) -> TouchModel:
    """Ball and sockets by least squares, without kinematic errors."""
    names = tuple(np.unique(of.sockets).tolist())
    none, nothing = np.zeros(0), np.zeros((3 + 3 * len(names),) * 2)
    start = TouchModel(
        kinematics, np.zeros(0, dtype=np.intp), names, BALL, np.zeros((len(names), 3)), none, nothing, 0.0, 0.0
    )
    A, r, _ = start.rows(of)
    x = -np.linalg.lstsq(A.reshape(-1, A.shape[-1]), r.ravel(), rcond=None)[0]
    return replace(start, ball=BALL + x[:3], sockets=np.asarray(x[3:].reshape(-1, 3)))


def fitted(kinematics: uq.Kinematics, of: Touches, errors: uq.KinematicErrors) -> TouchModel:
    """Ball, sockets and kinematic errors, with their joint covariance."""
    errors = replace(errors, flange="controller")  # ball and sockets are unknown: no frames to define
    place = {error.key: k for k, error in enumerate(kinematics.errors)}
    terms = [term for term in errors.terms(kinematics, of.q) if term.columns is not None]
    groups, by_group = [term.key.kind for term in terms], [[place[key] for key in term.keys] for term in terms]
    kept = np.concatenate(by_group).astype(np.intp)
    model = replace(nominal(kinematics, of), kept=kept, e=np.zeros(len(kept)))
    p = 3 + 3 * len(model.names)
    for _ in range(ROUNDS):
        latent = _latent(model, of, errors, groups, list(map(len, by_group)))
        mixture = integrate(latent, [find_mode(latent)])
        each = [latent.conditional(theta) for theta in mixture.theta]
        mean = np.average([one.mean for one in each], axis=0, weights=mixture.weights)
        squares = [one.covariance + np.outer(one.mean - mean, one.mean - mean) for one in each]
        touch_sd, joint_sd = latent.sizes(mixture.mean_theta)[:2].tolist()
        model = replace(
            model,
            ball=model.ball + mean[:3],
            sockets=model.sockets + mean[3:p].reshape(-1, 3),
            e=mean[p:],
            covariance=np.average(squares, axis=0, weights=mixture.weights),
            touch_sd=touch_sd,
            joint_sd=joint_sd,
        )
    return model


def _latent(
    model: TouchModel, of: Touches, errors: uq.KinematicErrors, groups: list[Kind], counts: list[int]
) -> LatentModel:
    """Return the model linear about ``model``: a touch is a row of six numbers whose rotation says nothing."""
    A, r, at = model.rows(of)
    J, F = np.split(_padded(A), [A.shape[-1] - len(model.e)], axis=-1)
    residuals = _padded(r[..., None])[..., 0] - F @ model.e
    population = errors.population
    components = [
        ErrorTerm(
            ErrorKey(Owner.ROBOT, Kind.OWN, name=TOUCH),
            "robot",
            Size(TOUCH_SD, TOUCH_FACTOR, "m"),
            block=np.eye(6)[:, 3:],
        ),
        ErrorTerm(
            JOINT_NOISE,
            "robot",
            Size(population.joint_sd, SIZES[JOINT_NOISE].factor, "rad"),
            block=_padded(at.by_joints),
        ),
    ]
    for group, K in zip(groups, np.split(F, np.cumsum(counts)[:-1], axis=-1), strict=True):
        size = Size(errors.standard_deviations[group], population.factor)
        components.append(ErrorTerm(ErrorKey(Owner.ROBOT, group), "robot", size, columns=K))
    as_they_are = np.broadcast_to(np.eye(6), (len(of.q), 6, 6))
    rotations = np.broadcast_to(np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]), (len(of.q), 6, 6))
    return LatentModel.of(Linearised(residuals, J, (as_they_are, as_they_are)), components, known=rotations)


def _padded(rows: Array) -> Array:
    """(n, 6, m) of rows (n, 3, m), which are the last three."""
    return np.pad(rows, [(0, 0), (3, 0), (0, 0)])


def score(residuals: Array, covariances: Array, quantile: float) -> dict[str, float]:
    d2 = nees(residuals, covariances)
    return {
        "inside": float(np.mean(d2 <= quantile)),
        "d2/3": float(np.mean(d2)) / 3,
        "mm": 1e3 * float(np.sqrt(np.mean(np.sum(residuals**2, axis=-1)))),
    }
