r"""Uncertainty budget of a point or of X in the terms of JCGM 100 (GUM): variance by source, combined and expanded.

The covariance is the sum over the sources, of type A (evaluated from the data) or B (declared: data sheets, priors,
what is assumed). A standard uncertainty of a group of components, such as X's translation, is per axis: the root of the
mean of their variances; or that in the direction in which the sum is largest. With u_k those of the sources, u_c the
combined one and R_kl the covariance of the estimated variances k and l relative to them (0 for type B)

    u_c^2 = sum_k u_k^2,    nu_k = 2 / R_kk,    nu_eff = 2 u_c^4 / sum_kl R_kl u_k^2 u_l^2

which is Welch and Satterthwaite's formula (JCGM 100, G.2b) where the estimates are independent, and that of
`graph.reference` for one component. The coverage factor is k = t_p(nu_eff), ``U = k u_c``.

Type A: noise that was estimated from residuals or corners, with the correlation of neighbouring poses, and a clock
offset estimated from two streams. Type B: noise as given or fixed by a data sheet, shared errors with their priors.
Type A, B: errors of an arm whose standard deviation comes from both, that of the population of such arms and the
residuals. Degrees of freedom are known where the noise was estimated; elsewhere they count as infinite. So they do
where sizes are integrated over: the covariance contains their uncertainty, and needs no wider factor (JCGM 101, 6.4.9).
That of a t distribution of this covariance, ``t_p(nu) sqrt(1 - 2 / nu)``, exceeds the normal one by at most 2 %.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri, stdtrit

from ...core.files.json_values import JsonObject
from ...core.files.records import Record, attributes, parts_of
from ...core.geometry.se3 import Array
from ...core.rounding import CHAIN_ROUNDING, TINY
from ...errors import InputError
from ...model.errors.columns import carried_sum
from ...model.errors.joint_covariance import joint_of
from ...model.errors.key import ErrorKey, Kind, Owner
from ...model.errors.key_text import text_of_source
from ...model.errors.keys import CLOCK_OFFSET, INTRINSICS, MOTION, SIZES_OPEN
from ...model.errors.models import Noise, is_joint, require_count
from ...model.errors.noise_estimate import NoiseEstimate
from ...model.errors.square_roots import pulled, whiten
from ..graph.gauss_helmert import Fit
from ..graph.posterior import Posterior
from ..graph.rows import factor_of
from ..graph.shared_estimates import of_moves
from .task_space import _points, by_pose

# A source of a budget: an error, or some that the data cannot separate.
Source: TypeAlias = tuple[ErrorKey, ...]
# Prior knowledge of the unknown pose whose six numbers begin at that place.
PRIORS = {0: ErrorKey(Owner.ALL, Kind.PRIOR_OF_X), 6: ErrorKey(Owner.ALL, Kind.PRIOR_OF_W)}
_COMPONENTS = ("theta_x", "theta_y", "theta_z", "tau_x", "tau_y", "tau_z")


class Expanded(NamedTuple):
    """An expanded uncertainty ``U = k u`` in rad or m, with what it is made of."""

    u: float  # combined standard uncertainty
    dof: float  # effective degrees of freedom; infinite where all of it is declared
    k: float  # coverage factor
    U: float


@dataclass(frozen=True, eq=False)
class Budget(Record):
    """The covariance of an estimate as a sum over noise sources.

    p components: 6 of X, then 6 of W where there is one; or 3 of a task point.
    """

    _stored: ClassVar[str] = "sources keys types relative dof components covariances group_shares combined"
    _in_file: ClassVar[str] = f"{_stored} shares"

    keys: tuple[Source, ...]
    covariances: Annotated[Array, "sources", "p", "p"]  # (sources, p, p), in rad and m
    X: Array  # (4, 4)
    types: tuple[str, ...] = ()  # "A" or "B" of each source, "A, B" of some together; empty: all "B"
    relative: Annotated[Array, "sources", "sources"] | None = None  # (sources, sources) R of the module; None: 0

    def __post_init__(self) -> None:
        count = len(self.keys)
        object.__setattr__(self, "types", tuple(self.types) or ("B",) * count)
        R = np.zeros((count, count)) if self.relative is None else np.array(self.relative, dtype=float)
        if len(self.types) != count or not set(self.types) <= {"A", "B", "A, B"} or R.shape != (count, count):
            raise InputError(f"Expected types A or B and relative covariances of {count} sources, got {self.types}.")
        object.__setattr__(self, "relative", R)
        super().__post_init__()

    @property
    def sources(self) -> tuple[str, ...]:
        """The sources in words."""
        return tuple(text_of_source(map(str, source)) for source in self.keys)

    @property
    def dof(self) -> Array:
        """(sources,) degrees of freedom; infinite where the source is declared."""
        own = np.diag(self._relative)
        return np.asarray(np.where(own > 0, 2.0 / np.maximum(own, TINY), np.inf))

    @property
    def standard(self) -> dict[str, Array]:
        """For each group the standard uncertainties (sources,), per axis, rad or m; 0 where a coupling takes away."""
        return {name: np.sqrt(np.maximum(self._variances(part, False), 0.0)) for name, part in self.groups.items()}

    @property
    def combined(self) -> dict[str, float]:
        """For each group the combined standard uncertainty u_c per axis, rad or m."""
        return {name: float(np.sqrt(self._variances(part, False).sum())) for name, part in self.groups.items()}

    def expanded(self, level: float = 0.95, *, worst: bool = False) -> dict[str, Expanded]:
        """For each group the uncertainty for a coverage of ``level``, per axis or in the worst direction."""
        if not 0 < level < 1:
            raise InputError(f"Expected `level` to lie between 0 and 1, got {level!r}.")
        return {name: self._expanded(self._variances(part, worst), level) for name, part in self.groups.items()}

    def expanded_along(self, rows: Array, level: float = 0.95) -> tuple[Expanded, ...]:
        """Return the uncertainty of each linear combination of the components, rows (m, p), for a coverage of
        ``level``.
        """
        return tuple(self._expanded(self.covariances @ row @ row, level) for row in np.asarray(rows, dtype=float))

    def _expanded(self, v: Array, level: float) -> Expanded:
        """Return the expanded uncertainty of the sum of variances v (sources,)."""
        spread = float(v @ self._relative @ v)
        dof = 2.0 * float(v.sum()) ** 2 / spread if spread > 0 else float("inf")
        k = float(stdtrit(dof, 0.5 + 0.5 * level)) if np.isfinite(dof) else float(ndtri(0.5 + 0.5 * level))
        u = float(np.sqrt(max(v.sum(), 0.0)))
        return Expanded(u, dof, k, k * u)

    def in_worst_direction(self) -> dict[str, Array]:
        """Return for each group the variances (sources,) along the direction in which their sum is largest.

        That of a coupling of rotation and translation may be below 0.
        """
        return {name: self._variances(part, True) for name, part in self.groups.items()}

    @property
    def _relative(self) -> Array:
        assert self.relative is not None  # since it was made
        return self.relative

    def _variances(self, part: slice, worst: bool) -> Array:
        """(sources,) of a group of components: their mean, or that along the direction in which the sum is largest."""
        S = self.covariances[:, part, part]
        if not worst:
            return np.asarray(np.trace(S, axis1=1, axis2=2) / S.shape[-1])
        along = np.linalg.eigh(S.sum(axis=0))[1][:, -1]
        return np.asarray(S @ along @ along)

    @property
    def covariance(self) -> Array:
        """(p, p), the sum over the sources."""
        return np.asarray(self.covariances.sum(axis=0))

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the p components."""
        if len(self.covariance) == 3:
            return ("x", "y", "z")
        names = tuple(f"X {name}" for name in _COMPONENTS)
        return names if len(self.covariance) == 6 else names + tuple(f"W {name}" for name in _COMPONENTS)

    @property
    def groups(self) -> dict[str, slice]:
        """Blocks of components whose variances add: rotation and translation of X (and W), or the point."""
        p = len(self.covariance)
        if p == 3:
            return {"point": slice(0, 3)}
        return {
            f"{of} {kind}": slice(k, k + 3)
            for of, start in (("X", 0), ("W", 6))[: p // 6]
            for kind, k in (("rotation", start), ("translation", start + 3))
        }

    @property
    def shares(self) -> Array:
        """(sources, p) of the variance of each component; each column sums to 1."""
        return _shares(np.diagonal(self.covariances, axis1=1, axis2=2))

    @property
    def group_shares(self) -> dict[str, Array]:
        """For each group the shares (sources,) of its trace."""
        variances = np.diagonal(self.covariances, axis1=1, axis2=2)
        return {name: _shares(variances[:, part].sum(axis=1)) for name, part in self.groups.items()}

    def budget_at(self, point: ArrayLike) -> Budget:
        """The budget of a point (3,) in camera coordinates (m), expressed in the parent frame of X."""
        p = _points(point)
        if p.shape != (3,) or len(self.covariance) == 3:
            raise InputError(f"Expected one `point` (3,) and the budget of X, got shape {p.shape}.")
        J = by_pose(self.X[:3, :3] @ p)
        return replace(self, covariances=J @ self.covariances[:, :6, :6] @ J.T)

    def merged(self, *groups: Sequence[str | ErrorKey]) -> Budget:
        """Merge the sources of each group into one, such as those that cannot be separated by the data.

        They are given by their keys, or in words.

        Raises `InputError` for names that are no sources or that two groups share.
        """
        named = [list(map(str, group)) for group in groups]
        wanted = [name for group in named for name in group]
        of = dict(zip(self.sources, self.keys, strict=True))
        unknown = [name for name in wanted if name not in of]
        if unknown or len(set(wanted)) < len(wanted):
            raise InputError(
                f"Expected the names to merge to be different sources out of {', '.join(self.sources)}, got "
                f"{', '.join(wanted)}."
            )
        groups_of = {name: group for group in named for name in group}
        labels = [tuple(key for part in groups_of.get(name, (name,)) for key in of[part]) for name in self.sources]
        return self._gathered(labels, self.covariances, self.types, self._relative)

    def _gathered(self, labels: Sequence[Source], covariances: Array, types: Sequence[str], relative: Array) -> Budget:
        """Merge the covariances of one label into one source; R is that of the sums, each weighted by its mean
        share.
        """
        names = tuple(dict.fromkeys(labels))
        of = np.array([[label == name for label in labels] for name in names], dtype=float)
        size = np.trace(covariances / np.maximum(np.diag(covariances.sum(axis=0)), TINY), axis1=1, axis2=2)
        weight = of * np.maximum(size, TINY)
        weight = weight / weight.sum(axis=1, keepdims=True)
        kinds = [{kind for label, kind in zip(labels, types, strict=True) if label == name} for name in names]
        mixed = tuple(kind.pop() if len(kind) == 1 else "A, B" for kind in kinds)
        merged = np.einsum("ms,sij->mij", of, covariances)
        return Budget(names, merged, self.X, mixed, weight @ relative @ weight.T)

    def renamed(self, source: Source, key: ErrorKey) -> Budget:
        """Return the budget with another key of one source."""
        return replace(self, keys=tuple((key,) if one == source else one for one in self.keys))

    def plus(self, key: ErrorKey, covariance: Array) -> Budget:
        """Add the covariance (p, p) of one more source, or to one that is there."""
        parts = np.concatenate([self.covariances, [covariance]])
        kind = self.types[self.keys.index((key,))] if (key,) in self.keys else "B"
        return self._gathered((*self.keys, (key,)), parts, (*self.types, kind), np.pad(self._relative, (0, 1)))

    def table(self) -> str:
        """Shares in percent, one row per source with its type and one column per group, as text."""
        width = max(len(name) for name in ("source", *self.sources))
        shares = self.group_shares
        lines = ["  ".join([f"{'source':<{width}}", "type", *(f"{name:>13}" for name in shares)])]
        for k, source in enumerate(self.sources):
            parts = (f"{100 * part[k]:11.1f} %" for part in shares.values())
            lines.append("  ".join([f"{source:<{width}}", f"{self.types[k]:<4}", *parts]))
        return "\n".join(lines)

    @property
    def in_file(self) -> JsonObject:
        """Parts that a result file holds."""
        return attributes(self, self._stored)

    @classmethod
    def of(cls, data: JsonObject, X: Array) -> Budget:
        """Return the budget that `to_dict` wrote, for the X that it belongs to."""
        found = cls(**parts_of(cls, data, "analysis.budget", X=X))
        R, size = found._relative, found.covariances.shape[-1]
        if (np.diag(R) < 0).any() or not np.allclose(R, R.T):
            raise InputError("Expected relative covariances of the variances of the budget, symmetric and >= 0.")
        if (np.diagonal(found.covariances.sum(axis=0)) < 0).any():
            raise InputError("Expected the variances of the budget to add up to 0 or more.")
        if size not in (6, 12):
            raise InputError(f"Expected the budget of X, or of X and W, got one of {size} numbers.")
        return found


def budget(
    fit: Fit,
    noise: Noise,
    *,
    merged: Sequence[Sequence[str]] = (),
    beside: Mapping[ErrorKey, Array] | None = None,
    within: Mapping[ErrorKey, Array] | None = None,
) -> Budget:
    """The budget of X (and of W) of one fit; see `budget_of_sensitivities`.

    With robust weights it is the covariance that this noise gives the weighted estimate. ``beside`` are moves of X
    and W, (p,) or (p, r), by one standard deviation of errors that the noise does not hold.
    """
    if fit.covariance.ndim != 2:
        raise InputError(f"Expected the `fit` of one problem, got leading axes {fit.covariance.shape[:-2]}.")
    J = fit.linear.J
    factor = fit.weighted_factor
    C = fit.closed_projection @ fit.covariance
    gain = -C @ pulled(factor, whiten(factor, J)).mT  # (n, p, 6)
    first, second = (gain @ D for D in fit.linear.sides)
    found = budget_of_sensitivities(first, second, noise, fit.X, merged=merged, within=within)
    for _, start, _, known in [] if fit.prior is None else fit.prior.parts():
        gain_of_prior = C[:, start : start + 6]
        found = found.plus(PRIORS[start], gain_of_prior @ known @ gain_of_prior.T)
    for key, move in (beside or {}).items():
        found = found.plus(key, of_moves(move))
    return found


def budget_of_posterior(
    posterior: Posterior, prior_sd: Mapping[ErrorKey, float], X: Array, noise: ErrorKey, dof: float
) -> Budget:
    """Return the budget of X and W by their posterior: errors and sizes as `parts_of_posterior` has them, and the rest,
    of the noise of all measurements (``noise``; ``dof``: infinite where it was given).
    """
    p = posterior.p
    parts = parts_of_posterior(posterior, prior_sd)
    rest = posterior.covariance[:p, :p] - sum(parts.values(), np.zeros((p, p)))
    sources = ((noise,), *((key,) for key in parts))
    relative = np.zeros((len(sources), len(sources)))
    relative[0, 0] = 2.0 / dof
    types = ("A" if np.isfinite(dof) else "B", *("B" for _ in parts))
    return Budget(sources, np.array([rest, *parts.values()]), X, types, relative)


def parts_of_posterior(posterior: Posterior, prior_sd: Mapping[ErrorKey, float]) -> dict[ErrorKey, Array]:
    """Return the covariance (p, p) of X and W by each error of the posterior, and by sizes that are open.

    Errors e that had the deviations sd beforehand make ``P_xe diag(sd^-2) P_ex``. With open sizes that is the mean over
    their points, with the deviations of each, and what the points move X and W by is a source of its own.
    """
    p, points, found = posterior.p, posterior.points, dict[ErrorKey, Array]()
    weights, A = (np.ones(1), posterior.A) if points is None else (points.weights, posterior.A)
    C = posterior.covariance[None] if points is None else A @ points.covariances @ A.T
    for key, numbers in posterior.numbers.items():
        sd = np.array([prior_sd.get(posterior.keys[k], 1.0) for k in numbers]) * np.ones((len(weights), 1))
        if points is not None and key in points.keys:
            theta = points.theta[:, points.keys.index(key)]
            sd = sd * np.exp(theta - weights @ theta)[:, None]
        effect = C[:, :p, p + np.array(numbers)] / sd[:, None]
        found[key] = np.einsum("d,dik,djk->ij", weights, effect, effect)
    if points is not None:
        moves = points.means @ A[:p].T
        found[SIZES_OPEN] = (weights * moves.T) @ moves
    return found


def by_posterior(found: Budget, posterior: Posterior, prior_sd: Mapping[ErrorKey, float]) -> Budget:
    """Return the budget of a fit with what its posterior says of errors and of open sizes.

    The noise of the poses has the rest, in the proportions of the fit: ``T N_k T^T``, with T from their sum to it. The
    budget of the fit is kept where nothing is left for the noise: parts of correlated errors count twice what they
    share.
    """
    p = len(found.covariance)
    parts: dict[Source, Array] = {(key,): S for key, S in parts_of_posterior(posterior, prior_sd).items()}
    if posterior.points is None or p != posterior.p:
        return found
    others = {*PRIORS.values(), CLOCK_OFFSET, MOTION}
    noise = np.array([source not in parts and others.isdisjoint(source) for source in found.keys], dtype=bool)
    kept = [parts.get(source, S) for source, S in zip(found.keys, found.covariances, strict=True)]
    covariances = np.array(kept)
    rest = posterior.covariance[:p, :p] - covariances[~noise].sum(axis=0)
    variances = np.diag(rest)
    if not noise.any() or (variances <= 0).any():
        return found
    if np.linalg.eigvalsh(rest / np.sqrt(np.outer(variances, variances)))[0] < 0:
        return found
    T = factor_of(rest) @ np.linalg.inv(factor_of(covariances[noise].sum(axis=0)))
    covariances[noise] = T @ covariances[noise] @ T.T
    return replace(found, covariances=0.5 * (covariances + covariances.mT))


def budget_of_sensitivities(
    D_robot: Array | None,
    D_camera: Array | None,
    noise: Noise,
    X: Array,
    *,
    merged: Sequence[Sequence[str]] = (),
    within: Mapping[ErrorKey, Array] | None = None,
) -> Budget:
    """The budget of an estimate with the derivatives D (n, p, 6) by the errors of every pose (or motion) of each side.

    Parameters
    ----------
    D_robot, D_camera : (n, p, 6) or None
        None where that side is exact. On motions those by A and by B.
    noise : PoseNoise or PairNoise
    X : (4, 4)
        The estimate.
    merged : groups of names
        See `Budget.merged`. Sources are named "robot rotation", "robot translation", "robot coupling", and so for
        "camera"; on motions "A" and "B". A coupling that is zero is left out. Of a `JointCovariance` they are instead
        what each pose has by itself, "camera (each pose)", shared errors (`ErrorKey.source`), and "camera (shared)".
    within : keys and covariances (n, 6, 6), or None
        Parts of what each robot pose has by itself that are sources of their own, such as the noise of joints.

    Raises
    ------
    InputError
        Derivatives missing for a side with noise, noise of another number of poses, unknown names.
    """
    parts: list[tuple[ErrorKey, Array]] = []
    for (name, S), D in zip(noise.sides.items(), (D_robot, D_camera), strict=True):
        if S is None:
            continue
        if D is None:
            raise InputError(f"Expected derivatives for `{name}`, which has noise, got None.")
        require_count(S, len(D), name, "rows of the derivatives")
        joint = joint_of(S)
        own, named = S if joint is None else joint.own, within if within and name == "robot" else {}
        rest = _without(own, list(named.values())) if named else own
        if joint is None or named or (all(joint.keys) and INTRINSICS not in joint.keys):
            parts += _by_kind(Owner(name), D, rest) if not named or rest.any() else []
        else:  # errors of the intrinsics, beside which each pose has no noise of its own by rotation and translation
            parts.append((ErrorKey(Owner(name), Kind.EACH_POSE), _summed(D, D @ own)))
        parts += [(part, _summed(D, D @ covariance)) for part, covariance in named.items()]
        if joint is not None:
            whole, shared = carried_sum(D, joint.columns), ErrorKey(Owner(name), Kind.SHARED)
            errors = [shared if key is None else key.source for key in joint.keys]
            for key in dict.fromkeys(errors):  # the columns of each error that has a key, and the others
                of_error = whole[:, [known == key for known in errors]]
                parts.append((key, of_error @ of_error.T))
    keys, covariances = zip(*parts, strict=True)
    S = np.stack(covariances)
    result = Budget(tuple((key,) for key in keys), 0.5 * (S + S.mT), np.asarray(X, dtype=float))
    return result.merged(*merged) if merged else result


def _without(own: Array, parts: Sequence[Array]) -> Array:
    """Covariances (n, 6, 6) without some of their parts; 0 where the difference is rounding."""
    rest = own - np.sum(parts, axis=0)
    size = np.sqrt(np.diagonal(own, axis1=-2, axis2=-1))
    return np.where(np.abs(rest) > CHAIN_ROUNDING * size[..., :, None] * size[..., None, :], rest, 0.0)


def _by_kind(owner: Owner, D: Array, S: Array) -> list[tuple[ErrorKey, Array]]:
    """Sources and covariances of rotation, translation and, where there is one, their coupling."""
    turn, shift = D.copy(), D.copy()
    turn[..., 3:], shift[..., :3] = 0.0, 0.0
    of_shift = _pulled(shift, S)
    cross = _summed(turn, of_shift)
    found = [(Kind.ROTATION, _summed(turn, _pulled(turn, S))), (Kind.TRANSLATION, _summed(shift, of_shift))]
    blocks = S.reshape(len(S) // 6, 6, -1, 6).swapaxes(1, 2) if is_joint(S) else S
    found += [(Kind.COUPLING, cross + cross.T)] if blocks[..., :3, 3:].any() else []
    return [(ErrorKey(owner, kind), covariance) for kind, covariance in found]


def _summed(D: Array, E: Array) -> Array:
    """``sum_k D_k E_k^T`` (p, p)."""
    return np.asarray(np.einsum("kpi,kqi->pq", D, E, optimize=True))


def _pulled(D: Array, S: Array) -> Array:
    """Row k of ``D S``: sum over l of ``D_l S_lk`` (n, p, 6)."""
    if not is_joint(S):
        return np.asarray(D @ S)
    n, p, _ = D.shape
    return np.asarray((D.swapaxes(0, 1).reshape(p, 6 * n) @ S).reshape(p, n, 6).swapaxes(0, 1))


def _shares(variances: Array) -> Array:
    """Return shares of the sum over the first axis; 0 where it is 0."""
    total = variances.sum(axis=0)
    return np.asarray(variances / np.where(total > 0, total, 1.0))


def with_types(budget: Budget, estimate: NoiseEstimate | None, from_corners: bool) -> Budget:
    """The budget of a fit with the types of its sources; ``from_corners``: they gave the covariance of camera poses."""
    index: dict[ErrorKey, int] = {}  # of the variance of a source, among those of the estimate
    data, both = {CLOCK_OFFSET}, set[ErrorKey]()
    if from_corners:
        kinds = (Kind.ROTATION, Kind.TRANSLATION, Kind.COUPLING, Kind.EACH_POSE, Kind.SHARED)
        data |= {*(ErrorKey(Owner.CAMERA, kind) for kind in kinds), INTRINSICS}
    if estimate is not None:
        given = {part.key for part in estimate.components if part.status in ("fixed", "given")}
        index = {key: k for k, key in enumerate(estimate.keys) if key not in given}
        data |= set(index)
        both = {part.key for part in estimate.components if part.status == "population"}
    keys = [source[0] for source in budget.keys]  # of a fit: nothing is merged yet
    types = tuple("A" if key in data else "A, B" if key in both else "B" for key in keys)
    return replace(budget, types=types, relative=_relative(keys, index, estimate))


def _relative(keys: Sequence[ErrorKey], index: Mapping[ErrorKey, int], estimate: NoiseEstimate | None) -> Array:
    """Covariances of the variances of the sources, relative to them."""
    R = np.zeros((len(keys), len(keys)))
    if estimate is None:
        return R
    rows_of = [(k, index[key]) for k, key in enumerate(keys) if key in index]
    known = [(k, of) for k, of in rows_of if estimate.variances[of] > 0]
    if known:
        rows, of = np.array(known).T
        v = estimate.variances[of]
        R[np.ix_(rows, rows)] = estimate.covariance[np.ix_(of, of)] / np.outer(v, v)
    return R
