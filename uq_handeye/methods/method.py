"""Common interface of all estimators of X: description, call and result.

Model: ``A_i X = X B_i`` with ``X = gripper_T_camera`` for eye-in-hand (``base_T_camera`` for eye-to-hand), A the
motions of the robot, B of the camera (`motions`). Angles in rad, lengths in the unit of the input.
"""

from __future__ import annotations

import inspect
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.checks import as_transforms
from ..core.geometry.se3 import Array
from ..errors import DegenerateMotionError, InputError, NotConvergedError
from ..model.errors.models import PairNoise
from .limit import solve_limit
from .pairs import MotionsLike, as_pairs


class Estimate(NamedTuple):
    """X of every problem, and whether its iteration came to an end."""

    X: Array  # (..., 4, 4)
    converged: NDArray[np.bool_]  # (...); always true in closed form
    iterations: NDArray[np.intp]  # (...); 0 in closed form


class Singular(Exception):
    """A solver's word that problem ``trial`` has no unique solution, and why."""

    def __init__(self, trial: int, why: str) -> None:
        super().__init__(why)
        self.trial, self.why = trial, why


def require(ok: NDArray[np.bool_], why: str) -> None:
    """Raise `Singular` for the first problem that is not ``ok`` (T,)."""
    if not ok.all():
        raise Singular(int(np.argmin(ok)), why)


def closed_form(X: Array) -> Estimate:
    """The `Estimate` of a method without iteration, X (T, 4, 4)."""
    return Estimate(X, np.ones(len(X), dtype=bool), np.zeros(len(X), dtype=np.intp))


@contextmanager
def explained(
    name: str, motions: Callable[[int], tuple[Array, Array]] | None = None, batch: tuple[int, ...] = ()
) -> Iterator[None]:
    """Turn `Singular` into the `DegenerateMotionError` of the method ``name``, on problems of leading axes ``batch``.

    ``motions`` gives A and B (N, 4, 4) of a problem, where they may tell better why.
    """
    try:
        yield
    except Singular as singular:
        if motions is not None:
            solve_limit(*motions(singular.trial))  # raises where it is the motions that leave X open
        at = f" (problem {tuple(int(i) for i in np.unravel_index(singular.trial, batch))})" if batch else ""
        raise DegenerateMotionError(
            f"Method {name!r} finds no unique X{at}: {singular.why} Another method may.", np.eye(6)
        ) from None


class Derivatives(Protocol):
    """First-order sensitivities of X for some trials T: ``Sigma_X = Q (sum over pairs F Sigma F^T) Q^T``.

    ``block`` takes motions (T, m, 4, 4) and which pairs these are and gives F (2, 6, 6, T, m), the derivatives by the
    errors ``xi = (theta, tau)`` of A and of B; after the last block, ``weight`` gives Q (T, 6, 6).
    """

    def block(self, A: Array, B: Array, pairs: slice) -> Array: ...

    def weight(self, N: int) -> Array: ...


# d (xi_A, xi_B) / dz (m, 12, k) of some pairs, for independent standard normal z
ErrorFactors = Callable[[slice], Array]


class PoseFactors(NamedTuple):
    """Errors of pairs by those of their two poses, which are independent from pose to pose."""

    pairs: NDArray[np.intp]  # (N, 2): the poses of each pair
    of: Callable[[slice], Array]  # d (xi_A, xi_B) / dz (2, m, 12, 12) of some pairs, z of the one and of the other pose


class LimitedCovariance(NamedTuple):
    """A covariance of X that holds in the limit of many data."""

    value: Array  # (6, 6)
    inverse: Array  # (6, 6) of the information H, without the scatter of the data
    share: float  # of the information, in the direction where it is largest, to which that limit does not apply


class Solver(Protocol):
    """The mathematics of a method, on checked motions (T, N, 4, 4): two functions, or a `MomentSolver`."""

    @property
    def estimate(self) -> Callable[[Array, Array, PairNoise | None], Estimate]: ...

    @property
    def derivatives(self) -> Callable[[Array, Array, PairNoise | None, Array], Callable[[slice], Derivatives]]: ...


class Functions(NamedTuple):
    """A `Solver` by its functions."""

    estimate: Callable[[Array, Array, PairNoise | None], Estimate]
    derivatives: Callable[[Array, Array, PairNoise | None, Array], Callable[[slice], Derivatives]]


@dataclass(frozen=True, kw_only=True, repr=False)
class Published:
    """Description of a published method: `published` reads it from ``methods.toml``."""

    name: str
    authors: str
    year: int
    title: str  # of the publication, with where it appeared
    doi: str | None = None  # None: the journal gave none
    structure: str  # "separated": rotation first, then translation; or "simultaneous"
    form: str  # "closed form", "iterative" or "convex program"
    minimises: str

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name}: {self.authors} {self.year}, {self.structure}, {self.form})"


@cache
def _table() -> dict[str, dict[str, Any]]:
    return tomllib.loads(Path(__file__).with_name("methods.toml").read_text(encoding="utf-8"))


def published(name: str) -> dict[str, Any]:
    """Return the fields of a method that ``methods.toml`` has."""
    entry = dict(_table()[name])
    entry["title"] += f". {entry.pop('appeared')}"
    return {"name": name, **entry}


@dataclass(frozen=True, kw_only=True, repr=False)
class Method(Published):
    """A published estimator of X: ``method(A, B) -> X`` over leading batch axes.

    ``estimate`` says also whether it converged; the call itself raises `NotConvergedError` rather than hand out an X
    that did not.
    """

    singular: str  # when it has no answer, beyond what AX = XB itself leaves open
    solver: Solver
    mathematics: str | None  # the model, and what was chosen where the publication leaves it open
    extra: str | None = None  # the optional extra of the package that it needs
    weighted: bool = False  # whether X depends on the noise model
    # of X (4, 4) by A and B (N, 4, 4), where X is no smooth function of the data; derivatives are then those on average
    covariance: Callable[[Array, Array, Array, PairNoise | ErrorFactors | PoseFactors], LimitedCovariance] | None = None

    @property
    def smooth(self) -> bool:
        """Return whether X is differentiable by the data, so that derivatives give its covariance."""
        return self.covariance is None

    @property
    def description(self) -> str:
        """The mathematics of the method, and what was chosen where the publication leaves something open."""
        return inspect.cleandoc(self.mathematics or "")

    @property
    def reference(self) -> str:
        """Authors, year, title and DOI in one line."""
        return f"{self.authors} ({self.year}). {self.title}. doi:{self.doi}"

    def __call__(self, A: MotionsLike, B: MotionsLike) -> Array:
        """X (..., 4, 4) of the motions A and B (..., N, 4, 4).

        Raises
        ------
        InputError
            Wrong shapes or values; an optional extra that is not installed.
        DegenerateMotionError
            The motions do not determine X, or not by this method.
        NotConvergedError
            The iteration did not end; ``partial`` holds the `Estimate`.
        """
        return require_converged(self, self.estimate(A, B)).X

    def estimate(self, A: MotionsLike, B: MotionsLike, noise: PairNoise | None = None) -> Estimate:
        """X with its convergence, problem by problem; ``noise`` serves the methods that weight by it."""
        A, B = as_pairs(A, B)
        A, B = as_transforms(A, "A"), as_transforms(B, "B")
        if noise is not None and not self.weighted:
            raise InputError(f"Method {self.name!r} takes no noise model.")
        batch, N = A.shape[:-3], A.shape[-3]
        flat_A, flat_B = A.reshape(-1, N, 4, 4), B.reshape(-1, N, 4, 4)
        with explained(self.name, lambda k: (flat_A[k], flat_B[k]), batch):
            found = self.solver.estimate(flat_A, flat_B, noise)
        return Estimate(found.X.reshape(*batch, 4, 4), found.converged.reshape(batch), found.iterations.reshape(batch))


def require_converged(method: Method, estimate: Estimate) -> Estimate:
    """The estimate, or `NotConvergedError` if any of its problems did not converge."""
    if not estimate.converged.all():
        failed = int(estimate.converged.size - estimate.converged.sum())
        of = "" if estimate.converged.ndim == 0 else f" on {failed} of {estimate.converged.size} problems"
        raise NotConvergedError(
            f"Method {method.name!r} did not converge{of} within {int(estimate.iterations.max())} iterations.", estimate
        )
    return estimate
