"""Reference distribution of ``d^2 = xi^T Sigma^-1 xi``, the squared error xi of X in units of its covariance Sigma.

Its quantiles give the size of an ellipsoid that contains X with a stated probability. It is chi-square where Sigma is
known, and wider where Sigma was estimated from the same data.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scipy.special import chdtrc, chdtri, fdtrc, fdtri

from ...core.files.records import Record
from ...errors import InputError


@dataclass(frozen=True)
class Reference(Record):
    """Distribution of d^2 of the components of X, 6 unless directions of X stay open, along which an error has no d^2.

    - ``chi-square``: the covariance is that of known noise.
    - ``F``: it is that of noise estimated from the same data, ``d^2 / 6 ~ F(6, dof)`` (`effective_dof`).
    - ``t``: it is that of a mixture over the sizes of the errors (`integration`), a multivariate t with this
      covariance: ``d^2 dof / (6 (dof - 2)) ~ F(6, dof)``, dof above 2.
    - ``Hotelling``: it comes from the residuals of few poses, ``d^2 (dof - 5) / (6 dof) ~ F(6, dof - 5)`` (`sandwich`).
    """

    _in_file: ClassVar[str] = "kind dof components=some_open"
    _if_any: ClassVar[str] = "components"

    kind: str = "chi-square"
    dof: float | None = None
    components: int = 6

    def __post_init__(self) -> None:
        if self.kind not in ("chi-square", "F", "t", "Hotelling"):
            raise InputError(f"Expected the reference to be chi-square, F, t or Hotelling, got {self.kind!r}.")
        least = 2 if self.kind == "t" else 0
        if (self.dof is None) != (self.kind == "chi-square") or (self.dof is not None and not self.dof > least):
            raise InputError(
                f"Expected degrees of freedom with F, t and Hotelling only, above {least}, got {self.dof!r} with "
                f"{self.kind}."
            )
        if self.components not in range(1, 7):
            raise InputError(f"Expected 1 to 6 components of X that are determined, got {self.components!r}.")

    @property
    def some_open(self) -> int | None:
        """Number of components where some are open."""
        return None if self.components == 6 else self.components

    @property
    def _stretch(self) -> float:
        """Variance of F's own scale: a t is stated with its covariance, which is dof / (dof - 2) times its scale."""
        assert self.dof is not None
        return (self.dof - 2.0) / self.dof if self.kind == "t" else 1.0

    @property
    def determined(self) -> bool:
        """True if there are quantiles: Hotelling needs more than 5 degrees of freedom."""
        return self.kind != "Hotelling" or (self.dof is not None and self.dof > 5)

    def quantile(self, level: float) -> float:
        """The d^2 below which the share ``level`` of all errors lies; infinite where that is not determined."""
        if not 0 < level < 1:
            raise InputError(f"Expected `level` to lie between 0 and 1, got {level!r}.")
        if self.dof is None:
            return float(chdtri(self.components, 1 - level))
        if not self.determined:
            return float("inf")
        if self.kind in ("F", "t"):
            return self._stretch * self.components * float(fdtri(self.components, self.dof, level))
        return 6 * self.dof / (self.dof - 5) * float(fdtri(6, self.dof - 5, level))

    def p_value(self, d2: float) -> float:
        """The probability of a d^2 at least as large."""
        if self.dof is None:
            return float(chdtrc(self.components, d2))
        if not self.determined:
            return 1.0
        if self.kind in ("F", "t"):
            return float(fdtrc(self.components, self.dof, d2 / (self._stretch * self.components)))
        return float(fdtrc(6, self.dof - 5, d2 * (self.dof - 5) / (6 * self.dof)))

    def __str__(self) -> str:
        if self.dof is None:
            return f"chi-square with {self.components} degrees of freedom"
        if self.kind == "F":
            return f"{self.components} F({self.components}, {self.dof:.3g})"
        if self.kind == "t":
            return f"a multivariate t with {self.dof:.3g} degrees of freedom"
        return f"Hotelling's distribution with {self.dof:.3g} degrees of freedom"
