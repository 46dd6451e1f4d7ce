r"""The latent Gaussian model: unknown poses, errors that poses share, noise of each pose, with sizes that have priors.

Rows of the linearised constraint (`graph.constraint`), six of each of n poses, with the errors of each side
carried to them by D (n, 6, 6) of that side:

    r_i + J_i x + sum_c s_c D_i K_ci z_c + sum_w s_w D_i B_wi z_wi = 0,      z ~ N(0, I),   x flat or with a prior

x (p,) is the step of the unknown poses, c runs over components that all poses share, w over those drawn at each pose.
For given sizes s all of it is Gaussian: with ``V_i = known_i + sum_w s_w^2 D B B^T D^T = L_i L_i^T``,
``A = L^-1 [J, s_c D K_c]``, ``y = L^-1 r`` and ``P_0 = diag(prior of x or 0; 1, 1, ...)``

    H = A^T A + P_0,      (x, z) = -H^-1 A^T y,      Cov(x, z) = H^-1

the joint posterior of the poses and of every error. Minus the logarithm of the density of ``theta = log s``, given the
rows and with x and z integrated out, is, up to a constant,

    f = sum log|L_i| + log|H| / 2 + (|e|^2 + |z|^2 + |x|_prior^2) / 2 + sum ((theta - log median) / log factor)^2 / 2

with ``e = y + A (x, z)``. Its gradient comes from the same factors: with ``T = s_w^2 L^-1 D B B^T D^T L^-T``,

    df/dtheta_c = m_c - tr (H^-1)_cc - |z_c|^2 + prior
    df/dtheta_w = sum_i [tr T_i - tr(T_i A_i H^-1 A_i^T) - e_i^T T_i e_i] + prior

``m_c - tr (H^-1)_cc`` is the number of numbers of a component that the data determine. The second derivatives are
replaced by the average of observed and expected ones (average information, Gilmour, Thompson and Cullis 1995):
``W^T (1 - A H^-1 A^T) W / 2`` with the columns ``2 A_c z_c`` and ``2 T_w e``. Everything is O(n (p + m)^2).

Rows that share an independent error, such as that of one robot pose in all views of its time, are one block: i counts
groups of rows, of 6 each where a group is one pose. Groups of different sizes are kept in separate arrays (`Rows`).
Reference: Rue, Martino and Chopin (2009); the mode with flat priors is restricted maximum likelihood.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dtrmm
from scipy.linalg.lapack import dpotrf, dtrtri, dtrtrs

from ...core.geometry.checks import CHUNK
from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import TINY
from ...model.errors.cholesky import checked_cholesky, inverse_factor
from ...model.errors.columns import some_rows
from ...model.errors.term import SIDES, ErrorTerm
from .constraint import MIN_RESOLVED_SHARE, Linearised

# Added to the diagonal of H scaled to ones, which rounding may otherwise leave not positive definite. Results
# depend on it where the data hardly determine X: 4e-15 more changes covariances of real data by up to 1e-6.
RIDGE_OF_INFORMATION = 1e-14


@dataclass(frozen=True, eq=False)
class State:
    """Value, derivatives and posterior at one set of sizes."""

    theta: Array  # (k,) logarithms of the free sizes
    value: float  # f
    gradient: Array  # (k,)
    information: Array  # (k, k) average information with that of the priors
    determined: Array  # (components,) numbers that the data determine; of noise of each pose 0


@dataclass(frozen=True, eq=False)
class Solved:
    """f at one set of sizes, the mean of x and z, and the factors of H."""

    theta: Array  # (k,) logarithms of the free sizes
    s: Array  # (components,)
    halves: tuple[Array, ...]  # (d, d, 1, n) L^-1 of groups of equal size
    A: Array  # (p + m + 1, rows) transposed, with y as the last row
    C: Array  # Cholesky factor of H times unit on both sides
    unit: Array  # (p + m,)
    u: Array  # (p + m,) x and z
    value: float
    pulled: Array  # (k,) derivatives of the prior of the sizes

    def whole(self) -> Array:
        """R (p + m, p + m) with ``H^-1 = R^T R``, lower triangular."""
        return np.asarray(dtrtri(self.C, lower=1)[0] * self.unit)


class Slope(NamedTuple):
    """First derivatives at one set of sizes."""

    gradient: Array  # (k,)
    determined: Array  # (components,) numbers that the data determine; of noise of each pose 0
    Q: Array  # (p + m, rows) R A^T, with H^-1 = R^T R
    e: Array  # (rows,) whitened residuals


@dataclass(frozen=True, eq=False)
class Conditional:
    """Posterior of the unknown poses x, or of them and the errors e = s z, for given sizes."""

    theta: Array
    value: float
    mean: Array  # (p,) of x, or (p + m,) of x and s z
    covariance: Array  # (p, p) or (p + m, p + m)


class Rows(NamedTuple):
    """Groups of rows that are independent of each other, n of d rows each."""

    J: Array  # (n, d, p)
    r: Array  # (n, d)
    shared: Array  # (n, d, m)
    blocks: dict[int, Array]  # (n, d, d)
    known: Array | None  # (n, d, d)


class _Inner(NamedTuple):
    """A block that is 0 but for some rows of each group: noise of one of several cameras."""

    number: int  # of its component
    of: slice  # the rows
    block: Array  # (d', d', n)


class _Prepared(NamedTuple):
    """`Rows` with the groups along the last axis, for which one loop serves all of them."""

    columns: Array  # (p + m + 1, d, n) [J, D K, r]
    by_group: Array  # (n, d, p + m + 1), the same
    numbers: NDArray[np.intp]  # (b,) of the components of the blocks
    blocks: Array  # (b, d, d, n)
    known: Array | float  # (d, d, n)
    inner: tuple[_Inner, ...]  # blocks of further components

    @classmethod
    def of(cls, rows: Rows) -> _Prepared:
        columns = np.concatenate([rows.J, rows.shared, rows.r[..., None]], axis=-1)
        d, whole, inner = rows.r.shape[-1], dict[int, Array](), list[_Inner]()
        for number, block in rows.blocks.items():
            used = np.flatnonzero(np.einsum("nii->i", block)) if d > 6 else np.arange(d)
            if len(used) and 2 * (used[-1] + 1 - used[0]) <= d:
                of = slice(int(used[0]), int(used[-1]) + 1)
                inner.append(_Inner(number, of, np.ascontiguousarray(block[:, of, of].transpose(1, 2, 0))))
            else:
                whole[number] = block
        blocks = np.array([*whole.values()]).reshape(-1, *rows.r.shape, d)
        known = 0.0 if rows.known is None else np.ascontiguousarray(rows.known.transpose(1, 2, 0))
        return cls(
            np.ascontiguousarray(columns.transpose(2, 1, 0)), columns, np.array([*whole], dtype=np.intp),
            np.ascontiguousarray(blocks.transpose(0, 2, 3, 1)), known, tuple(inner),
        )  # fmt: skip

    def whitened(self, s: Array, scale: Array) -> tuple[Array, Array, Array, Array]:
        """``L^-1`` (d, d, t, n), ``[A, y]^T`` (t, p + m + 1, d, n), its products and ``sum log|L|`` (t,).

        By sizes (t, k); ``scale`` (t, p + m + 1): of the whitened columns.
        """
        q, d, n = self.columns.shape
        V = np.empty((d, d, len(s), n))
        V[:] = self.known[..., None, :] if isinstance(self.known, np.ndarray) else self.known
        if len(self.numbers):
            parts = (s[:, self.numbers] ** 2) @ self.blocks.reshape(len(self.numbers), -1)
            V += parts.reshape(-1, d, d, n).transpose(1, 2, 0, 3)
        for number, of, block in self.inner:
            V[of, of] += s[:, number, None] ** 2 * block[:, :, None]
        if d > 6:  # groups of several views: LAPACK and BLAS group by group, one loop for all of the small ones
            L = checked_cholesky(np.ascontiguousarray(V.transpose(2, 3, 0, 1)))
            L_inv = np.stack([dtrtri(one.T)[0].T for one in L.reshape(-1, d, d)]).reshape(L.shape)
            by_group = L_inv @ self.by_group
            by_group *= scale[:, None, None]
            flat = by_group.reshape(len(s), -1, q)
            half = np.asarray(L_inv, dtype=float).transpose(2, 3, 0, 1)
            logs = -np.log(np.einsum("iitn->tin", half)).sum(axis=(1, 2))
            return half, by_group.transpose(0, 3, 2, 1), flat.mT @ flat, logs
        half = inverse_factor(V)
        white = np.empty((len(s), q, d, n))
        for i in range(d):
            white[:, :, i] = np.einsum("ktn,qkn->tqn", half[i, : i + 1], self.columns[:, : i + 1])
        white *= scale[:, :, None, None]
        flat = white.reshape(len(s), q, -1)
        logs = -np.log(np.einsum("iitn->itn", half)).sum(axis=(0, 2))
        return half, white, flat @ flat.mT, logs


@dataclass(frozen=True, eq=False)
class LatentModel(ReadOnlyArrays):
    """The model at one linearisation; see the module."""

    J: Array  # (n, d, p), d = 6 where a group is one pose
    r: Array  # (n, d)
    components: tuple[ErrorTerm, ...]
    shared: Array  # (n, d, m) D K of all shared components, side by side
    blocks: dict[int, Array]  # (n, d, d) D B B^T D^T of the components that have a part drawn again, by their number
    known: Array | None = None  # (n, d, d) covariance that has no size
    prior: Array | None = None  # (p + 1, p + 1) what is known of x: added to [J, r]^T V^-1 [J, r]
    others: tuple[Rows, ...] = ()  # groups of other sizes d
    covariance_of_sizes: Array | None = None  # (k, k) of the logarithms of the free sizes; None: independent

    @classmethod
    def of(
        cls,
        linear: Linearised,
        components: Sequence[ErrorTerm],
        J: Array | None = None,
        known: Array | None = None,
        prior: Array | None = None,
    ) -> LatentModel:
        """Build the model of components at a linearised constraint.

        ``J`` in place of that of the constraint where unknowns are reduced; ``known`` (n, 6, 6) of the rows.
        """
        n = len(linear.r)
        carried = dict(zip(SIDES, linear.sides, strict=True))
        blocks, shared = {}, [np.zeros((n, 6, 0))]
        for k, part in enumerate(components):
            D = carried[part.side]
            if part.columns is not None:
                shared.append(D @ some_rows(part.columns, slice(None)))
            if part.block is not None:
                B = D @ part.block
                square = B @ B.mT
                blocks[k] = 0.5 * (square + square.mT)
        return cls(
            linear.J if J is None else J, linear.r, tuple(components), np.concatenate(shared, axis=-1), blocks,
            known, prior,
        )  # fmt: skip

    # ------------------------------------------------------------------------------------------- sizes

    @cached_property
    def free(self) -> NDArray[np.intp]:
        """Numbers of the components whose size is not known."""
        return np.array([k for k, part in enumerate(self.components) if not part.size.is_known], dtype=np.intp)

    @cached_property
    def medians(self) -> Array:
        """(k,) logarithms of the medians of the free sizes."""
        return np.log([self.components[k].size.median for k in self.free])

    @cached_property
    def spreads(self) -> Array:
        """(k,) standard deviations of the logarithms."""
        return np.log([self.components[k].size.factor for k in self.free])

    @cached_property
    def _owner(self) -> NDArray[np.intp]:
        """(m,) number of the component of each shared column."""
        return np.repeat(np.arange(len(self.components)), [part.count for part in self.components])

    @cached_property
    def _places(self) -> dict[int, slice]:
        """Places in (x, z) of the shared columns, by the number of the component."""
        ends = (self.p + np.cumsum([part.count for part in self.components])).tolist()
        counts = [part.count for part in self.components]
        return {k: slice(end - m, end) for k, (end, m) in enumerate(zip(ends, counts, strict=True)) if m}

    @property
    def p(self) -> int:
        """Number of unknowns of the poses."""
        return int(self.J.shape[-1])

    @cached_property
    def groups(self) -> tuple[Rows, ...]:
        """All rows, those of equal size together."""
        return (Rows(self.J, self.r, self.shared, self.blocks, self.known), *self.others)

    @cached_property
    def _prepared(self) -> tuple[_Prepared, ...]:
        return tuple(_Prepared.of(rows) for rows in self.groups)

    @cached_property
    def _known_points(self) -> dict[bytes, Solved]:
        """Solution of `of_poses` at its sizes, without the rows: `conditional` is evaluated at the same ones."""
        return {}

    @cached_property
    def _latest(self) -> dict[bytes, Solved]:
        """The last result of `solved`: what is computed at a mode is computed where the search ended."""
        return {}

    @cached_property
    def _prior_of_sizes(self) -> Array:
        """(k, k) information of the prior of the logarithms of the free sizes."""
        if self.covariance_of_sizes is None:
            return np.diag(1.0 / self.spreads**2)
        return np.asarray(np.linalg.inv(self.covariance_of_sizes))

    @cached_property
    def _usual_sizes(self) -> Array:
        """(components,) medians of the sizes."""
        return np.array([part.size.median for part in self.components])

    def sizes(self, theta: Array) -> Array:
        """(components,) sizes, known ones among them."""
        found = self._usual_sizes.copy()
        found[self.free] = np.exp(theta)
        return found

    # ------------------------------------------------------------------------------------------- one set of sizes

    def solved(self, theta: Array) -> Solved:
        """Return f, the mean of x and z, and the factors of H."""
        key = theta.tobytes()
        found = self._latest.get(key)
        if found is None:
            s = self.sizes(theta)
            halves, white, grams, logs = self._whitened(s[None])
            A = np.concatenate([part[0].reshape(part.shape[1], -1) for part in white], axis=-1)
            found = replace(self._of_sums(theta, s, grams[0], float(logs[0])), halves=halves, A=A)
            self._latest.clear()
            self._latest[key] = found
        return found

    def _whitened(self, s: Array) -> tuple[tuple[Array, ...], tuple[Array, ...], Array, Array]:
        """``L^-1`` and ``[A, y]^T`` of the groups, ``[A, y]^T [A, y]`` and ``sum log|L|`` at sizes s (t, k)."""
        scale = np.ones((len(s), self.p + len(self._owner) + 1))
        scale[:, self.p : -1] = s[:, self._owner]
        halves, white, grams, logs = zip(*(rows.whitened(s, scale) for rows in self._prepared), strict=True)
        return halves, white, sum(grams[1:], grams[0]), sum(logs[1:], logs[0])

    def _of_sums(self, theta: Array, s: Array, gram: Array, logs: float) -> Solved:
        """Solve by the sums of `_whitened` at sizes s."""
        p = self.p
        if self.prior is not None:
            index = np.r_[:p, -1]
            gram[np.ix_(index, index)] += self.prior
        H, pull, square = gram[:-1, :-1], gram[:-1, -1], float(gram[-1, -1])
        diagonal = np.einsum("ii->i", H)
        diagonal[p:] += 1.0
        unit = 1.0 / np.sqrt(np.maximum(diagonal, TINY))
        scaled = H * unit[:, None] * unit
        np.einsum("ii->i", scaled)[:] += RIDGE_OF_INFORMATION
        C, failed = dpotrf(scaled, lower=1)
        if failed:
            raise np.linalg.LinAlgError("The information of the poses and the errors is not positive definite.")
        half_way = dtrtrs(C, unit * pull, lower=1)[0]
        u = -unit * dtrtrs(C, half_way, lower=1, trans=1)[0]
        logs = logs + float(np.log(C.diagonal() / unit).sum())
        off = theta - self.medians
        pulled = self._prior_of_sizes @ off
        value = float(logs + 0.5 * (square + pull @ u) + 0.5 * off @ pulled)
        return Solved(theta, s, (), np.zeros((len(u) + 1, 0)), C, unit, u, value, pulled)

    def value(self, theta: Array) -> float:
        """f."""
        return self.solved(theta).value

    def at(self, theta: Array) -> State:
        """f with its derivatives."""
        solved = self.solved(theta)
        slope = self.slope(solved)
        return State(theta, solved.value, slope.gradient, self.information(solved, slope), slope.determined)

    def slope(self, at: Solved) -> Slope:
        """Return the gradient of f, and what the average information takes from it."""
        p, k = self.p, len(self.components)
        whole = at.whole()
        inverse_diagonal = np.einsum("ij,ij->j", whole, whole)
        columns = at.A[:-1]
        Q = np.asarray(dtrmm(1.0, whole, columns.T, side=1, lower=1, trans_a=1)).T  # whole A^T, (p + m, rows)
        e = at.A[-1] + at.u @ columns
        z, owner = at.u[p:], self._owner
        determined = np.bincount(owner, 1.0 - inverse_diagonal[p:], minlength=k).astype(float)  # integers of none
        gradient = determined - np.bincount(owner, z * z, minlength=k)
        for rows, half, part in self._parts(at.halves):
            if not len(rows.numbers) + len(rows.inner):
                continue
            d, n = half.shape[0], half.shape[-1]
            each = np.ascontiguousarray(Q[:, part].reshape(-1, d, n).transpose(2, 1, 0))
            e_i, by = e[part].reshape(d, n), half.transpose(2, 0, 1)
            left = -(each @ each.mT) - e_i.T[:, :, None] * e_i.T[:, None, :]
            np.einsum("nii->ni", left)[:] += 1.0  # 1 - A H^-1 A^T - e e^T
            inside = by.mT @ left @ by
            squares, flat_blocks = at.s[rows.numbers] ** 2, rows.blocks.reshape(len(rows.numbers), -1)
            gradient[rows.numbers] += squares * (flat_blocks @ inside.transpose(1, 2, 0).reshape(-1))
            for number, of, block in rows.inner:
                gradient[number] += at.s[number] ** 2 * np.vdot(block, inside[:, of, of].transpose(1, 2, 0))
        return Slope(gradient[self.free] + at.pulled, determined, Q, e)

    def information(self, at: Solved, slope: Slope) -> Array:
        """Return the average information (k, k) of the logarithms of the free sizes, with that of their priors."""
        e, Q = slope.e, slope.Q
        W = np.zeros((len(self.components), len(e)))
        for c, of in self._places.items():
            W[c] = -2.0 * (at.u[of] @ at.A[of])
        for rows, half, part in self._parts(at.halves):
            if not len(rows.numbers) + len(rows.inner):
                continue
            e_i = e[part].reshape(half.shape[0], half.shape[-1])
            back = np.einsum("jin,jn->in", half, e_i)
            pulled = np.einsum("bijn,jn->bin", rows.blocks, back)
            moved = np.einsum("ijn,bjn->bin", half, pulled).reshape(len(rows.numbers), -1)
            W[rows.numbers, part] += 2.0 * at.s[rows.numbers, None] ** 2 * moved
            for number, of, block in rows.inner:
                moved = np.einsum("ijn,jn->in", half[:, of], np.einsum("ijn,jn->in", block, back[of])).reshape(-1)
                W[number, part] += 2.0 * at.s[number] ** 2 * moved
        flat = W[self.free]
        across = flat @ Q.T
        return np.asarray(0.5 * (flat @ flat.T - across @ across.T) + self._prior_of_sizes)

    def _parts(self, halves: tuple[Array, ...]) -> Iterator[tuple[_Prepared, Array, slice]]:
        """Groups of equal size with ``L^-1`` (d, d, n) and their place among the rows."""
        start = 0
        for rows, half in zip(self._prepared, halves, strict=True):
            size = half.shape[0] * half.shape[-1]
            yield rows, half[:, :, 0], slice(start, start + size)
            start += size

    def of_poses(self, theta: Array) -> Conditional:
        """The posterior of the unknown poses alone, for given sizes."""
        at = self._latest.get(theta.tobytes())
        return self.of_poses_at(theta[None])[0] if at is None else self._of_poses(at)

    def of_poses_at(self, thetas: Array) -> list[Conditional]:
        """The posteriors of the unknown poses alone, for many sizes (d, k)."""
        found, p = [], self.p
        numbers = sum(rows.r.size for rows in self.groups) * (p + self.shared.shape[-1])
        together = max(1, 12 * CHUNK // numbers)  # as many sizes as a cache holds whitened rows of
        for start in range(0, len(thetas), together):
            some = thetas[start : start + together]
            sizes = np.array([self.sizes(theta) for theta in some])
            _, _, grams, logs = self._whitened(sizes)
            for theta, s, gram, log in zip(some, sizes, grams, logs.tolist(), strict=True):
                at = self._of_sums(theta, s, gram, log)
                self._known_points[theta.tobytes()] = at
                found.append(self._of_poses(at))
        return found

    def _of_poses(self, at: Solved) -> Conditional:
        half = dtrtrs(at.C, np.diag(at.unit)[:, : self.p], lower=1)[0]
        return Conditional(at.theta, at.value, at.u[: self.p], half.T @ half)

    def shares(self, theta: Array) -> Array:
        """(components,) largest share of the variance of the first 6 unknowns, of X, that a component has.

        A component moves x by its columns, as the posterior leaves them open, and by its noise at each pose, through
        the gain ``-H^-1 A^T L^-1``.
        """
        at, q = self.solved(theta), min(6, self.p)
        half = at.whole()
        of_x = half[:, :q].T @ half  # (q, p + m) of H^-1
        gain = of_x @ at.A[:-1]
        root = np.linalg.inv(np.linalg.cholesky(of_x[:, :q] + RIDGE_OF_INFORMATION * np.diag(np.diag(of_x[:, :q]))))
        found = np.zeros(len(self.components))
        for k in range(len(found)):
            columns = root @ of_x[:, self._places.get(k, slice(0))]
            variance = columns @ columns.T
            for rows, half, part in self._parts(at.halves):
                every = (_Inner(int(one), slice(None), of) for one, of in zip(rows.numbers, rows.blocks, strict=True))
                for number, of, block in (*every, *rows.inner):
                    if number == k:
                        pull = np.einsum("qin,ijn->qjn", gain[:, part].reshape(q, *half.shape[1:]), half[:, of])
                        each = np.einsum("qin,ijn->qjn", pull, block).reshape(q, -1) @ pull.reshape(q, -1).T
                        variance = variance + at.s[k] ** 2 * root @ each @ root.T
            found[k] = np.linalg.eigvalsh(variance)[-1]
        return np.clip(found, 0.0, 1.0)

    def absorbed(self, theta: Array) -> dict[int, Array]:
        """Moves (p, m) of the unknowns that the columns of a component are, one standard deviation each.

        By the number of the component, of those of whose rows the unknowns leave less than a hundredth of
        `MIN_RESOLVED_SHARE` of the energy: the data say nothing of such an error, and the unknowns take it in.
        """
        A, p, found = self.solved(theta).A.T, self.p, {}
        Q, R = np.linalg.qr(A[:, :p])
        for k, place in self._places.items():
            columns = A[:, place]
            inside = Q.T @ columns
            energy, left = (columns**2).sum(), ((columns - Q @ inside) ** 2).sum()
            if energy > 0 and left < MIN_RESOLVED_SHARE / 100.0 * energy:
                found[k] = -np.linalg.lstsq(R, inside, rcond=None)[0]
        return found

    def turns(self, theta: Array) -> dict[str, tuple[Array, Array]]:
        """Rotations (m, m) of the shared columns of each side to principal axes, and their energies (m,), ascending.

        Energies are those of the whitened rows at these sizes: noise has 1 of each number.
        """
        at, found = self.solved(theta), {}
        for side in SIDES:
            of = np.array([part.side == side for part in self.components], dtype=bool)
            A = at.A[self.p + np.flatnonzero(of[self._owner])]
            energy, turn = np.linalg.eigh(A @ A.T)
            found[side] = turn, energy
        return found

    def place(self, number: int) -> int:
        """Place in (x, z) of the first column of a component."""
        return int(self._places[number].start)

    def conditional(self, theta: Array) -> Conditional:
        """The joint posterior of the poses and of the errors in their units, for given sizes."""
        at = self._known_points.get(theta.tobytes()) or self.solved(theta)
        inverse = at.whole()
        scale = np.concatenate([np.ones(self.p), at.s[self._owner]])
        inverse = inverse * scale
        return Conditional(theta, at.value, at.u * scale, inverse.T @ inverse)
