r"""Prior of X and W before the data: a Gaussian on any of their twelve numbers.

Model: with a mean pose (R_0, t_0) the unknown pose has the error ``xi = (theta, tau)``, ``R = exp([theta]x) R_0``,
``t = t_0 + tau`` (rad, m, left rotation, additive translation, parent frame of the pose), Gaussian with zero mean and
the information Lambda (6, 6), the inverse of its covariance; what is not known has the information 0. The mean is a
measurement like any other: minus twice the log-likelihood grows by ``xi^T Lambda xi``. A small move d of the pose
moves xi by ``K d``, ``K = blkdiag(J_l^-1(theta), I)``, so that a Gauss-Newton step has

    information += K^T Lambda K,      gradient += K^T Lambda xi
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.files.json_values import JsonObject
from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array, left_jacobian, logarithm, perturb
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import SOLUTION_ROUNDING
from ...errors import InputError
from .joint_covariance import Index


@dataclass(frozen=True, eq=False)
class PosePrior(ReadOnlyArrays):
    """A Gaussian on X, on W or on both (module).

    ``X``, ``W``: means (..., 4, 4), None where nothing is known; ``information_X``, ``information_W``: (6, 6).
    """

    X: Array | None = None
    information_X: Array | None = None
    W: Array | None = None
    information_W: Array | None = None

    def __post_init__(self) -> None:
        for name in ("X", "W"):
            mean, information = getattr(self, name), getattr(self, f"information_{name}")
            if (mean is None) != (information is None):
                raise InputError(f"Expected the prior of {name} to have a mean and an information, got one of them.")
            if mean is None or information is None:
                continue
            mean = as_transforms(mean, f"prior_{name}", stack=False)
            L = np.asarray(information, dtype=float)
            if L.shape != (6, 6) or not np.isfinite(L).all() or not np.allclose(L, L.T):
                raise InputError(f"Expected the information of the prior of {name} to be symmetric numbers (6, 6).")
            object.__setattr__(self, name, mean)
            object.__setattr__(self, f"information_{name}", L)
        if self.X is None and self.W is None:
            raise InputError("Expected a prior of X, of W or of both, got none.")
        super().__post_init__()

    @classmethod
    def of(cls, X: Any = None, W: Any = None) -> PosePrior | None:
        """Build a prior from ``(pose, covariance)`` of X and of W; None where both are.

        Parameters
        ----------
        X, W : tuple of a pose (4, 4) and a covariance (6, 6), a prior of X, or None
            Infinity on the diagonal: that component is not known; it then has no covariances with others.

        Raises
        ------
        InputError
            A pose or a covariance that is none; one that is singular or indefinite.
        """
        parts = [(None, None) if of is None else _mean_and_information(of, f"prior_{name}")
                 for name, of in (("X", X), ("W", W))]  # fmt: skip
        return None if X is None and W is None else cls(*parts[0], *parts[1])

    def parts(self) -> list[tuple[str, int, Array, Array]]:
        """Name, first of its six unknowns, mean and information of each pose that is known."""
        found = []
        for start, name in ((0, "X"), (6, "W")):
            mean, information = getattr(self, name), getattr(self, f"information_{name}")
            if mean is not None:
                found.append((name, start, mean, information))
        return found

    @property
    def rank(self) -> int:
        """Number of independent numbers that are known."""
        return sum(int(np.linalg.matrix_rank(_unit_diagonal(part[3])[0], hermitian=True)) for part in self.parts())

    def information(self, p: int) -> Array:
        """(p, p) at the means, p = 12 of (X, W) or 6 of X."""
        result = np.zeros((p, p))
        for _, start, _, known in self.parts():
            result[start : start + 6, start : start + 6] = known
        return result

    def rows(self, index: Index | tuple[int, ...] | slice) -> PosePrior:
        """Return the prior of some of the problems that the means belong to."""
        X, W = (T if T is None or T.ndim == 2 else T[index] for T in (self.X, self.W))
        return replace(self, X=X, W=W)

    def without_W(self) -> PosePrior | None:
        """Return the prior of X only."""
        return None if self.X is None else PosePrior(self.X, self.information_X)

    def normal_equations(self, X: Array, W: Array | None) -> tuple[Array, Array, Array]:
        """``K^T Lambda K`` (..., p, p), ``K^T Lambda xi`` (..., p) and ``xi^T Lambda xi`` (...) at X and W."""
        p = 6 if W is None else 12
        information = np.zeros((*X.shape[:-2], p, p))
        gradient, square = np.zeros((*X.shape[:-2], p)), np.zeros(X.shape[:-2])
        for name, start, mean, known in self.parts():
            at = X if name == "X" else W
            assert at is not None  # motions have no prior of W
            xi, K = _error(at, mean)
            some = slice(start, start + 6)
            pull = K.mT @ known
            information[..., some, some] = pull @ K
            gradient[..., some] = (pull @ xi[..., None])[..., 0]
            square += (xi * (known @ xi[..., None])[..., 0]).sum(axis=-1)
        return information, gradient, square

    def drawn(self, X: Array, W: Array | None, batch: tuple[int, ...], rng: np.random.Generator) -> PosePrior:
        """Draw ``batch`` means (..., 4, 4) about the true X and W: what would have been measured."""
        return self.moved(X, W, rng.standard_normal((*batch, 6 * len(self.parts()))))

    def moved(self, X: Array, W: Array | None, z: Array) -> PosePrior:
        """The same of standard normal z (..., 6 for each pose that is known)."""
        means: dict[str, Any] = {}
        for k, (name, _, _, known) in enumerate(self.parts()):
            at = X if name == "X" else W
            assert at is not None  # motions have no prior of W
            errors = z[..., 6 * k : 6 * k + 6] @ _root_of_inverse(known).T
            means[name] = perturb(np.broadcast_to(at, (*z.shape[:-1], 4, 4)), errors)
        return replace(self, **means)

    def to_dict(self) -> JsonObject:
        """Plain numbers, by name."""
        return {name: {"mean": mean.tolist(), "information": known.tolist()} for name, _, mean, known in self.parts()}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> PosePrior:
        """The inverse of `to_dict`."""
        parts = {name: (np.asarray(part["mean"], dtype=float), np.asarray(part["information"], dtype=float))
                 for name, part in data.items()}  # fmt: skip
        return cls(*parts.get("X", (None, None)), *parts.get("W", (None, None)))


def _error(at: Array, mean: Array) -> tuple[Array, Array]:
    """xi of a pose relative to the mean (..., 6), and K (..., 6, 6) of the module."""
    theta = logarithm(at[..., :3, :3] @ mean[..., :3, :3].mT)
    xi = np.concatenate([theta, at[..., :3, 3] - mean[..., :3, 3]], axis=-1)
    K = np.zeros((*xi.shape, 6))
    K[..., :3, :3], K[..., 3:, 3:] = np.linalg.inv(left_jacobian(theta)), np.eye(3)
    return xi, K


def _mean_and_information(value: Any, name: str) -> tuple[Array, Array]:
    """Return mean and information of a prior of X, or of a pose and a covariance, infinite where nothing is known."""
    if isinstance(value, PosePrior) and value.X is not None and value.information_X is not None:
        return value.X, value.information_X
    try:
        mean, covariance = value
    except (TypeError, ValueError):
        raise InputError(f"Expected `{name}` to be (pose (4, 4), covariance (6, 6)), got {value!r:.60}.") from None
    try:
        S = np.array(covariance, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"Expected the covariance of `{name}` to be numbers (6, 6).") from None
    if S.shape != (6, 6) or np.isnan(S).any():
        raise InputError(f"Expected the covariance of `{name}` to be numbers (6, 6), got shape {S.shape} or NaN.")
    known = np.isfinite(np.diag(S))
    if (np.diag(S)[known] <= 0).any():
        raise InputError(
            f"Expected the variances of `{name}` to be above 0, or infinite where a component is not known, got "
            f"{np.diag(S)[known].min():.3g}."
        )
    part = S[np.ix_(known, known)]
    if not known.any() or not np.isfinite(part).all():
        raise InputError(f"Expected `{name}` to have finite variances of what is known, got {np.diag(S)}.")
    deviations = np.sqrt(np.diag(part))
    correlation = part / np.outer(deviations, deviations)
    if np.abs(correlation - correlation.T).max() > 1e-6:
        raise InputError(f"Expected the covariance of `{name}` to be symmetric.")
    smallest = float(np.linalg.eigvalsh(0.5 * (correlation + correlation.T))[0])
    if smallest < SOLUTION_ROUNDING:
        raise InputError(
            f"Expected the covariance of `{name}` to be positive definite, got a correlation matrix with the "
            f"eigenvalue {smallest:.3g}: {'it is indefinite' if smallest < -1e-8 else 'it is singular'}. Give infinite "
            "variances where nothing is known, and small ones above 0 where much is."
        )
    information = np.zeros((6, 6))
    inverse = np.linalg.inv(0.5 * (correlation + correlation.T)) / np.outer(deviations, deviations)
    information[np.ix_(known, known)] = 0.5 * (inverse + inverse.T)
    return as_transforms(mean, name, stack=False), information


def _unit_diagonal(information: Array) -> tuple[Array, Array]:
    """Scaled to a unit diagonal, 0 where there is no information; and the diagonal, 1 there."""
    diagonal = np.diag(information)
    diagonal = np.where(diagonal > 0, diagonal, 1.0)
    scale = 1.0 / np.sqrt(diagonal)
    return np.asarray(information * np.outer(scale, scale)), diagonal


def _root_of_inverse(information: Array) -> Array:
    """L (6, 6) with ``L L^T`` the covariance of what is known, 0 for the rest."""
    unit, diagonal = _unit_diagonal(information)
    values, vectors = np.linalg.eigh(unit)
    known = values > SOLUTION_ROUNDING
    root = np.where(known, 1.0 / np.sqrt(np.where(known, values, 1.0)), 0.0)
    return np.asarray(vectors * root / np.sqrt(diagonal)[:, None])
