r"""The estimate at the Cramer-Rao bound: two closed-form steps, their iteration to maximum likelihood, and the bound.

Model (`constraint`): Gaussian errors xi_i of the measured poses or motions with known covariance, true values that
satisfy ``G X C = W`` or ``A X = X B``. With the latent true values eliminated, minus twice the log-likelihood is

    min over v of  sum_i v_i^T Sigma_i^-1 v_i    subject to    r(measured (-) v; X, W) = 0

One step (Gauss-Helmert) linearises r at guesses of X, W and the errors v. With ``rho = r + D v``, ``S = D Sigma D^T``

    I_F = sum_i J_i^T S_i^-1 J_i,   xi = -I_F^-1 sum_i J_i^T S_i^-1 rho_i,   v_i = Sigma_i D_i^T S_i^-1 (rho_i + J_i xi)

The first step from 4DPA's X, with v = 0, is that of T5: at the bound to first order in the errors. It takes the
derivatives at measured data, whose noise biases X and makes ``I_F^-1`` too small where rotation noise times a lever
exceeds the translation noise (motions with 10 mrad and 0.1 mm in `studies.likelihood`: mean NEES 8 and 12, not 6).
``efficient`` therefore takes a second one, with the derivatives at the poses as the first corrected them. The changes
by further steps are small compared with the standard deviations, except for the largest noise there. ``ml`` iterates
until it converges: there the conditions of the constrained maximum hold exactly. The covariance of both is ``I_F^-1``,
where the last step was taken; its block of X (the Schur complement on X) is marginal over W.

Exact sides (noise None) and covariances that are joint over poses (T4b) need no special case, as Sigma is never
inverted; S must be. Leading axes are independent problems.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array, left_jacobian, perturb
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import SOLUTION_ROUNDING, rounding
from ...errors import DegenerateMotionError, InputError, NotConvergedError, require_type
from ...model.errors.cholesky import substitute
from ...model.errors.columns import against
from ...model.errors.joint_covariance import JointFactor
from ...model.errors.models import Noise, PairNoise, PoseNoise, with_prior
from ...model.errors.pose_prior import PosePrior
from ...model.errors.square_roots import Covariance, Factor, cholesky_of, gram, is_joint, pulled, weighted, whiten
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.timing import Timing, warn_left_out
from .constraint import Constraint, Linearised, Unknowns, constraint_of, covariances_of, residual_covariance
from .open_directions import (
    OpenDirections,
    beside_prior,
    closed_part,
    lever_of,
    open_basis,
    projection,
    rig_units,
    solve_information,
)
from .starts import isotropic_residuals, sound_start, start_of

# Number of steps of `efficient`.
CLOSED_FORM_STEPS = 2
# Largest number of steps of `ml`.
MAX_ML_STEPS = 50
# Largest number of rounds of an iteration that fits X and W in each of them: noise and weights in turn, or corners
# that are linearised again.
MAX_ROUNDS = 20
# `ml` has converged when a step moves X and W by less than this, in standard deviations; robust weights have when none
# of them changes by more.
STEP_SD = 1e-6
# For noise near rounding `ml` has also converged when a step is below this share of the rotations and of the longest
# translation.
STEP_ROUNDING = rounding(16)

# Errors of robot and camera (..., n, 6); None for a side without errors.
Errors = tuple[Array | None, Array | None]


class Told(NamedTuple):
    """Posterior of errors z ~ N(0, 1) whose columns S has, and what these do to X and W."""

    z: Array  # (..., q)
    response: Array  # (..., p, q) of (xi_X, xi_W), for z = 1
    left: Array  # (..., q, q) covariance of z

    def of(self, some: NDArray[np.intp]) -> Told:
        """Those of some of the errors."""
        return Told(self.z[..., some], self.response[..., some], self.left[..., some[:, None], some])


@dataclass(frozen=True, eq=False)
class Fit(ReadOnlyArrays):
    """X and W with everything that the covariance, diagnostics and robust weights are made of.

    ``residual`` is what the errors leave of the constraint once X and W are fitted, to first order ``D xi`` less the
    fitted part; with the covariance S and the leverage below 1 it is what consistency is judged by.
    """

    unknowns: Unknowns
    covariance: Array  # (..., p, p) of (xi_X, xi_W) on poses, p = 12; of xi_X on motions, p = 6
    linear: Linearised  # where the last step was taken
    S: Covariance  # (..., n, 6, 6), or joint (..., 6n, 6n): covariance of the residuals, before any robust weight
    residual: Array  # (..., n, 6) after the fit
    iterations: int
    converged: NDArray[np.bool_]  # (...)
    weights: Array | None = None  # (..., n) in [0, 1], robust weights of the poses; None: all 1
    open: Array | None = None  # (..., p, p): projector onto the directions that stay open (`open_directions`)
    lever: Array | None = None  # (...): the length that makes an angle of them a length (m)
    prior: PosePrior | None = None  # of X and W, used in addition to the data

    @property
    def X(self) -> Array:
        """(..., 4, 4)"""
        return self.unknowns.X

    @property
    def W(self) -> Array | None:
        """(..., 4, 4); None on motions."""
        return self.unknowns.W

    @property
    def covariance_X(self) -> Array:
        """(..., 6, 6), on the directions of X that are not open: of variance 0 along the others."""
        return self._closed(slice(0, 6))

    @property
    def covariance_W(self) -> Array | None:
        """(..., 6, 6), likewise; None on motions."""
        return None if self.W is None else self._closed(slice(6, 12))

    def _closed(self, part: slice) -> Array:
        covariance = self.covariance[..., part, part]
        return covariance if self.open is None else closed_part(covariance, self.open, self.lever, part)

    @property
    def opened(self) -> OpenDirections | None:
        """Open directions of one problem; None: nothing is open."""
        if self.open is None:
            return None
        basis = self.open_directions
        return OpenDirections(np.pad(basis, [(0, 0), (0, 12 - basis.shape[1])]), float(np.asarray(self.lever)))

    @property
    def open_directions_X(self) -> Array:
        """(k, 6) those of X only: what of X is not determined."""
        if self.open is None:
            return np.zeros((0, 6))
        assert self.lever is not None
        return open_basis(self.open[:6, :6], rig_units(self.lever, 6))

    @property
    def spent(self) -> int:
        """Degrees of freedom that the unknowns take from the residuals and the prior; of one problem."""
        known = 0 if self.prior is None else self.prior.rank
        return int(self.covariance.shape[-1]) - len(self.open_directions) - known

    @property
    def square_of_prior(self) -> float:
        """``xi^T Lambda xi`` of X and W relative to the means of the prior; 0 without one."""
        return 0.0 if self.prior is None else float(self.prior.normal_equations(self.X, self.W)[2])

    @property
    def closed_projection(self) -> Array:
        """(p, p): errors of X and of W without their own open parts; of one problem."""
        p = self.covariance.shape[-1]
        result = np.eye(p)
        if self.open is not None:
            assert self.lever is not None
            rig = rig_units(self.lever, 6)
            for part in (slice(k, k + 6) for k in range(0, p, 6)):
                result[part, part] = projection(open_basis(self.open[part, part], rig), rig)
        return result

    def gauged(self) -> Fit:
        """Return the fit with the open directions taken as known: X and W do not move along them."""
        return self if self.open is None else replace(self, open=None)

    @property
    def open_directions(self) -> Array:
        """(k, p) basis of what stays open in (xi_X, xi_W), rad and m, orthonormal in units of the rig; of one problem.

        Raises `InputError` for several problems at once, which may differ in k.
        """
        p = self.covariance.shape[-1]
        if self.open is None:
            return np.zeros((0, p))
        if self.open.ndim > 2:
            raise InputError(f"Expected the fit of one data set, got leading axes {self.open.shape[:-2]}.")
        assert self.lever is not None
        return open_basis(self.open, rig_units(self.lever, p))

    def told(self, f: Array) -> Told:
        r"""Estimate errors that all poses share, with columns f (..., n, 6, q) that S has, from the residuals r.

            z = f^T S^-1 r,    Cov(z) = 1 - f^T (S^-1 - S^-1 J C J^T S^-1) f,    d (xi_X, xi_W) / dz = -C J^T S^-1 f

        are those of the joint fit of X, W and z with the prior N(0, 1) of z (Woodbury).
        """
        p = self.linear.J.shape[-1]
        sums = gram(whiten(self.weighted_factor, np.concatenate([self.linear.J, self.residual[..., None], f], axis=-1)))
        response = -self.covariance @ sums[..., :p, p + 1 :]
        explained = sums[..., p + 1 :, p + 1 :] + sums[..., p + 1 :, :p] @ response
        left = np.eye(f.shape[-1]) - 0.5 * (explained + explained.mT)
        return Told(sums[..., p + 1 :, p], response, left)

    @cached_property
    def told_of_shared(self) -> Told:
        r"""`told` of all errors that a joint S has columns of, without whitening these again.

        With ``S = B (1 + V V^T) B^T``, ``P = (1 + V^T V)^-1``, y and A the residuals and J over B,

            f^T S^-1 [r, J] = P V^T [y, A],    f^T S^-1 f = 1 - P
        """
        factor = self.weighted_factor
        assert isinstance(factor, JointFactor)
        p = self.linear.J.shape[-1]
        white = substitute(factor.B, np.concatenate([self.linear.J, self.residual[..., None]], axis=-1))
        half = np.linalg.inv(factor.C)  # P = half^T half
        pulled = half.mT @ (half @ against(factor.V, white))
        by_J = pulled[..., :p].mT
        response = -self.covariance @ by_J
        left = half.mT @ half - by_J.mT @ response
        return Told(pulled[..., p], response, 0.5 * (left + left.mT))

    @cached_property
    def factor(self) -> Factor:
        """L with ``S = L L^T``, as S."""
        return cholesky_of(self.S)

    @cached_property
    def weighted_factor(self) -> Factor:
        """The same of S with the robust weights in it."""
        return self.factor if self.weights is None else cholesky_of(weighted(self.S, self.weights))

    @cached_property
    def white(self) -> tuple[Array, Array]:
        """``L^-1 residual`` (..., n, 6) and ``L^-1 J`` (..., n, 6, p)."""
        whitened = whiten(self.factor, np.concatenate([self.linear.J, self.residual[..., None]], axis=-1))
        return whitened[..., -1], whitened[..., :-1]


def efficient(data: PosePairs | Motions, noise: Noise, start: Array | None = None) -> Fit:
    """Two closed-form steps from 4DPA (or ``start``): at the Cramer-Rao bound (T5).

    Parameters
    ----------
    data : PosePairs or Motions
        On poses where there are any, unless the noise is `PairNoise`; leading axes are independent problems.
    noise : PoseNoise or PairNoise
        With a residual covariance S that is positive definite.
    start : (..., 4, 4) or None
        A consistent estimate of X; None takes 4DPA of all pairs of poses, or of the motions given.

    Raises
    ------
    InputError
        Noise that is none, does not fit the data or leaves a part of the residuals exact.
    DegenerateMotionError
        The data do not determine X (or W).
    """
    constraint = _checked(data, noise)
    if start is None:
        return fit_data(data, constraint, noise, CLOSED_FORM_STEPS)
    return fit_efficient(constraint, noise, start_of(data, constraint, start))


def maximum_likelihood(data: PosePairs | Motions, noise: Noise, start: Array | None = None) -> Fit:
    """`efficient`, repeated to the maximum of the likelihood with latent true poses or motions.

    Parameters and errors as for `efficient`, and

    Raises
    ------
    NotConvergedError
        ``partial`` holds the `Fit` that was reached, with a flag for each problem.
    """
    constraint = _checked(data, noise)
    if start is None:
        return _require_converged(fit_data(data, constraint, noise, MAX_ML_STEPS))
    return fit_ml(constraint, noise, start_of(data, constraint, start))


def fit_efficient(constraint: Constraint, noise: Noise, start: Unknowns) -> Fit:
    """`efficient` of a constraint, from the unknowns given."""
    return fit(constraint, noise, start, CLOSED_FORM_STEPS)


def fit_ml(constraint: Constraint, noise: Noise, start: Unknowns) -> Fit:
    """`maximum_likelihood` of a constraint, from the unknowns given."""
    return _require_converged(fit(constraint, noise, start, MAX_ML_STEPS))


def _require_converged(found: Fit) -> Fit:
    if not found.converged.all():
        failed = int(found.converged.size - found.converged.sum())
        of = "" if found.converged.ndim == 0 else f" on {failed} of {found.converged.size} problems"
        raise NotConvergedError(
            f"Method 'ml' did not converge{of} within {found.iterations} iterations: the residuals are too large for "
            "the noise given, or the motions hardly determine X. Look at the warnings and residuals of method "
            "'4dpa', and at the noise.",
            found,
        )
    return found


def bound(data: PosePairs | Motions, noise: Noise, X: Array | None = None) -> Array:
    """The Cramer-Rao bound of X (..., 6, 6): no unbiased estimator has a smaller covariance, to first order (T5).

    Model: the errors of the poses (or, with PairNoise, of the motions) are Gaussian with the covariance given; the true
    poses and W are unknown nuisances. The bound belongs to true values: those of simulated poses that carry their
    truth; else X and the poses as maximum likelihood corrects them; where ``X`` is given, X and the data as they are,
    whose noise then moves the bound.

    Parameters
    ----------
    data : PosePairs or Motions
    noise : PoseNoise or PairNoise
    X : (4, 4) or None
        The true X, if it is known for data that do not carry their truth.

    Returns
    -------
    (..., 6, 6) covariance of ``xi = (theta, tau)``: left rotation in rad, additive translation; parent frame of X.

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    >>> poses = uq.simulate(n_poses=20, noise=noise, seed=1)
    >>> np.round(np.sqrt(np.diag(uq.bound(poses, noise))) * 1e3, 2)  # mrad, mm
    array([0.44, 0.39, 0.57, 0.5 , 0.46, 0.58])
    """
    constraint = _checked(data, noise)
    poses = data.poses
    warn_left_out("bound()", data)
    if constraint.item == "pose" and X is None and poses is not None and poses.truth is not None:
        truth = poses.truth
        at = Unknowns(truth.X, truth.W)
        linear = constraint.linearise(at, truth.robot, truth.camera)
    elif X is None:
        return maximum_likelihood(data, noise).covariance_X
    else:
        at = start_of(data, constraint, as_transforms(X, "X", stack=False))
        linear = constraint.linearise(at, constraint.first, constraint.second)
    S = residual_covariance(linear.sides, noise)
    information = gram(whiten(cholesky_of(S), linear.J))
    if noise.prior is not None:
        information = information + noise.prior.information(constraint.p)
    solved = solve_information(information, linear, constraint, noise, S, None, False)
    covariance = solved.covariance[..., :6, :6]
    return (
        covariance if solved.open is None else closed_part(covariance, solved.open, lever_of(constraint), slice(0, 6))
    )


# Estimates at the Cramer-Rao bound by name; every other name is a published method.
ESTIMATORS = {"efficient": efficient, "ml": maximum_likelihood}
FITS = {"efficient": fit_efficient, "ml": fit_ml}


def _checked(data: PosePairs | Motions, noise: Noise) -> Constraint:
    """The constraint, once data and noise are known to be some."""
    require_type("data", data, (PosePairs, Motions), "PosePairs or Motions")
    require_type("noise", noise, (PoseNoise, PairNoise), "PoseNoise or PairNoise")
    return constraint_of(data, noise)


def fit_data(data: PosePairs | Motions, constraint: Constraint, noise: Noise, steps: int) -> Fit:
    """Run ``steps`` steps from 4DPA, or from the start of `sound_start`; leading axes are independent problems."""
    astray: NDArray[np.bool_] | None = None
    if noise.prior is None:
        with suppress(DegenerateMotionError):
            found = fit(constraint, noise, start_of(data, constraint, None), steps, halt_open=True)
            variances = np.diagonal(found.covariance[..., 3:6, 3:6], axis1=-2, axis2=-1)
            astray = np.asarray(variances.max(axis=-1) > lever_of(constraint) ** 2)
            if astray.any():
                astray = astray & constraint.one_axis
            if found.open is None and not astray.any():
                return found
    return fit(constraint, noise, sound_start(data, constraint, noise, astray=astray), steps)


def open_at(constraint: Constraint, at: Unknowns, prior: PosePrior | None) -> OpenDirections | None:
    """Return the directions that stay open near the unknowns of data that fit exactly."""
    noise = with_prior(isotropic_residuals(constraint, at), prior)
    return fit(constraint, noise, at, 1).opened


def fit(
    constraint: Constraint,
    noise: Noise,
    start: Unknowns,
    steps: int,
    weights: Array | None = None,
    *,
    halt_open: bool = False,
) -> Fit:
    """Run ``steps`` steps of Gauss-Helmert, or fewer once all problems have converged.

    Robust ``weights`` (..., n) in [0, 1] multiply the information of each pose or motion; 0 leaves it out.
    ``halt_open``: end after the first step if it finds open directions, as the start was then none.
    """
    unknowns, first, second = start, constraint.first, constraint.second
    errors: Errors = (None, None)
    lever = lever_of(constraint)
    for done in range(1, steps + 1):
        linear = constraint.linearise(unknowns, first, second)
        if steps > CLOSED_FORM_STEPS:
            linear = linear._replace(sides=_by_own_errors(linear.sides, errors))
        rho = linear.r
        for D, v in zip(linear.sides, errors, strict=True):
            if v is not None:
                rho = rho + (D @ v[..., None])[..., 0]
        S = residual_covariance(linear.sides, noise)
        factor = cholesky_of(S if weights is None else weighted(S, weights))
        white = whiten(factor, np.concatenate([linear.J, rho[..., None]], axis=-1))
        sums = gram(white)
        information, gradient = beside_prior(sums[..., :-1, :-1], sums[..., :-1, -1], noise, unknowns)
        covariance, opened = solve_information(
            information, linear, constraint, noise, S, weights, errors[0] is not None or errors[1] is not None
        )
        step = -(covariance @ gradient[..., None])[..., 0]
        residual = rho + (linear.J @ step[..., None, :, None])[..., 0]
        unknowns = unknowns.moved(step)
        if done == steps <= CLOSED_FORM_STEPS or (halt_open and done == 1 and opened is not None):
            converged = np.ones(step.shape[:-1], dtype=bool)
            break
        moved = (step[..., None, :] @ information @ step[..., None])[..., 0, 0]
        smallest = np.diagonal(information, axis1=-2, axis2=-1) @ _last_places(constraint, unknowns) ** 2
        converged = np.asarray((moved < np.maximum(STEP_SD**2, smallest)) & (done > 1))
        if converged.all():
            break
        errors = _errors(linear.sides, noise, factor, white[..., -1:] + white[..., :-1] @ step[..., None, :, None])
        del white  # of many poses the next step needs its memory
        first, second = (
            T if v is None else perturb(T, -v)
            for T, v in zip((constraint.first, constraint.second), errors, strict=True)
        )
    found = Fit(unknowns, covariance, linear, S, residual, done, converged, weights, opened, lever, noise.prior)
    found.__dict__["weighted_factor"] = factor  # of the last step, so that the property does not compute it again
    return found


def offset_sensitivity(fit: Fit, timing: Timing) -> Array:
    """Return by how much X and W move, (12,), per second of the time offset of the n poses that were fitted.

    ``g = -C J^T S^-1 j`` with ``j_i = D_i rate_i``: rad/s and m/s. At the joint optimum of X, W and an offset known
    with the variance v, the covariance of (X, W) is ``C + v g g^T`` (`synchronisation`).
    """
    j = fit.linear.sides[0 if timing.side == "robot" else 1] @ timing.rate[..., None]
    return fit.told(j).response[..., 0]


def corrected(fit: Fit, noise: Noise, first: Array, second: Array) -> tuple[Array, Array]:
    """The measured poses (motions) of both sides less the errors that the fit ascribes to them.

    What is left of their noise is, to first order, uncorrelated with the residuals.
    """
    factor = fit.factor
    if fit.weights is not None and is_joint(fit.S):  # a wrong pose must not reach the others through their noise
        factor = fit.weighted_factor
    errors = _errors(fit.linear.sides, noise, factor, whiten(factor, fit.residual[..., None]))
    one, other = (T if v is None else perturb(T, -v) for T, v in zip((first, second), errors, strict=True))
    return one, other


def _last_places(constraint: Constraint, unknowns: Unknowns) -> Array:
    """The rounding of rotations and translations of X and W (p), in rad and the unit of length."""
    longest = max(
        float(np.abs(T[..., :3, 3]).max()) for T in (constraint.first, constraint.second, *unknowns) if T is not None
    )
    return STEP_ROUNDING * np.tile(np.repeat([1.0, longest], 3), 1 if unknowns.W is None else 2)


def _by_own_errors(sides: tuple[Array, Array], errors: Errors) -> tuple[Array, Array]:
    """Derivatives by the errors v themselves: ``exp([-theta - d]x) = exp([-J_l(-theta) d]x) exp([-theta]x)``.

    It rotates Sigma by half of theta and leaves D v as it is: of second order in S, needed for the exact maximum only.
    """
    first, second = (
        D if v is None else np.concatenate([D[..., :3] @ left_jacobian(-v[..., :3]), D[..., 3:]], axis=-1)
        for D, v in zip(sides, errors, strict=True)
    )
    return first, second


def _errors(sides: tuple[Array, Array], noise: Noise, factor: Factor, white: Array) -> Errors:
    """``v = Sigma D^T S^-1 residual`` (..., n, 6) of both sides, from ``L^-1 residual`` (..., n, 6, 1)."""
    n = white.shape[-3]
    pull = pulled(factor, white)
    found: list[Array | None] = []
    for D, S in zip(sides, covariances_of(noise), strict=True):
        by_error = D.mT @ pull
        if S is None:
            found.append(None)
        elif is_joint(S):
            found.append((S @ by_error.reshape(*by_error.shape[:-3], 6 * n, 1)).reshape(by_error.shape[:-1]))
        else:
            found.append((S @ by_error)[..., 0])
    return found[0], found[1]


def inverse_information(information: Array) -> Array:
    """The covariance (..., p, p); raises `DegenerateMotionError` where the information is singular."""
    diagonal = np.diagonal(information, axis1=-2, axis2=-1)
    if not (diagonal > 0).all():
        silent = ~(diagonal > 0).reshape(-1, diagonal.shape[-1])[:, :6].all(axis=0)
        raise DegenerateMotionError(
            "The data do not determine X: components of its (theta, tau) leave no trace in the residuals. Add motions "
            "that rotate about different axes.",
            np.eye(6)[silent],
        )
    unit = 1.0 / np.sqrt(diagonal)
    scale = unit[..., :, None] * unit[..., None, :]
    values, vectors = np.linalg.eigh(information * scale)
    if not (values[..., 0] > SOLUTION_ROUNDING).all():
        where = np.unravel_index(int(np.argmin(values[..., 0])), values.shape[:-1])
        direction = unit[where] * vectors[where][:, 0]
        direction = direction[:6] / max(float(np.linalg.norm(direction[:6])), 1e-300)
        raise DegenerateMotionError(
            "The data do not determine X and W: (theta, tau) of X along "
            f"({', '.join(f'{x:.3f}' for x in direction)}) leaves no trace in the residuals. Add motions that rotate "
            "about another axis.",
            direction[None],
        )
    result = (vectors / values[..., None, :]) @ vectors.mT
    return np.asarray(0.5 * (result + result.mT) * scale)
