r"""Test of given intrinsics by the corners of the pictures, and the readings that would explain a contradiction.

Model: the numbers given are ``k_0`` with the covariance ``S_0`` (0 where they are exact or, as the coefficients of a
lens without deviations, fixed). The pictures by themselves determine ``k`` with the information I, the Schur complement
of all that is estimated in addition (poses, shape of the board, intrinsics that are not given; T4b of `bundle`), so
that ``d = k - k_0`` has the covariance ``C = I^-1 + S_0``. I may be singular, as few pictures do not determine all
numbers;

    C^-1 = (1 + I S_0)^-1 I,       C^-1 d = (1 + I S_0)^-1 b,      b = I d

need the gradient b only. Three statements follow, each to first order from one linearisation:

- all numbers together: ``chi2 = d^T C^-1 d``, chi-square with as many degrees of freedom as I has directions;
- one number by itself, the others as given: ``z_j = (C^-1 d)_j / sqrt((C^-1)_jj)``, standard normal, and likewise
  both coordinates of the centre by the same shift;
- the numbers A of a contradiction, found one after the other, the one that explains most first, until the rest agrees:
  they are off by ``(C^-1)_AA^-1 (C^-1 d)_A``, with the covariance ``(C^-1)_AA^-1``.

Other data that depend on the numbers given, such as robot poses, add their information and gradient to ``C^-1`` and
``C^-1 d``.

Corners of one picture have errors in common. Where the gradients of the pictures scatter more than the pixel noise
explains, ``rho = tr(I^-1 sum_i g_i g_i^T) / rank > 1``, I and b are divided by rho. The level of the finding is that of
all the tests together (Sidak), as a number of standard deviations.

A *reading* is what a file may have meant: its numbers changed by a rule without a free parameter, such as half a pixel.
It explains a contradiction where the numbers so changed agree with the pictures, by the same chi2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, erfc, ndtri

from ...core.geometry.se3 import Array
from ...core.limits import MAX_LEFT_SHARE
from ...core.rounding import SOLUTION_ROUNDING
from ...findings import Finding, Severity
from .adjustment.bundle import Bundle, Sight
from .adjustment.setting import Known
from .corners import Corners
from .models import LINEAR, MODELS

# Standard deviation of focal lengths and centre that are given without one, in focal lengths: that of the shared errors
# of finished poses (`model.errors.sizes`).
DEFAULT_SD_SHARE = 1e-3
# Standard deviations from which on a contradiction is a caution, and from which on X is not usable.
CAUTION_SD, FAILURE_SD = 3.0, 5.0
# The same of a centre that is off by half a pixel in both coordinates to within so many standard deviations: with the
# other tests together, right numbers are blamed in less than 1 % of the sets.
HALF_PIXEL_CAUTION_SD, MAX_HALF_PIXEL_SD = 2.75, 2.0
# Standard deviations of the search for the model of the lens and the shape of the board, in which given numbers are
# open: of focal lengths and centre in focal lengths, of coefficients without unit.
OPEN_SD = {"fx": 0.05, "fy": 0.05, "cx": 0.05, "cy": 0.05}
OPEN_COEFFICIENT_SD = dict.fromkeys(("p0", "p1", "p2", "s0", "s1", "s2", "s3", "s4"), 0.02) | {
    "tau_x": 0.05,
    "tau_y": 0.05,
}
OPEN_RADIAL_SD = 0.3
# A contradiction of the open prior by this many of its standard deviations: the search is repeated without it.
MAX_OPEN_SHIFT_SD = 2.0
# Factors between the resolution of a file and that of the pictures that are tried.
RESOLUTIONS = (2.0, 0.5, 1.5, 2 / 3, 3.0, 1 / 3, 4.0, 0.25, 0.75, 4 / 3, 1.25, 0.8)
# Reductions of the picture whose centre may have been divided without regard to half a pixel.
REDUCTIONS = (2, 4, 8)
# Shift of the centre (px) from which on it is described as a crop.
MIN_CROP_PX = 4.0
# Readings are listed up to this difference of their chi-square from that of the best.
MAX_READING_DIFFERENCE = 6.0


def with_default_deviations(values: Known) -> dict[str, float | tuple[float, float]]:
    """Return given intrinsics in which focal lengths and centre without a deviation have the default one.

    Coefficients without a deviation stay fixed. A standard deviation of 0 is exact.
    """
    means = {name: float(np.ravel(value)[0]) for name, value in values.items()}
    focal = [means[name] for name in ("fx", "fy") if name in means]
    if not focal:
        return dict(values)
    f = float(np.mean(focal))
    return {
        name: (means[name], abs(f) * DEFAULT_SD_SHARE) if name in LINEAR and np.ndim(value) == 0 else value
        for name, value in values.items()
    }


def opened(values: Known) -> dict[str, float | tuple[float, float]]:
    """Return given intrinsics with wide standard deviations, for the search of the model of the lens and the board."""
    means = {name: float(np.ravel(value)[0]) for name, value in values.items()}
    f = float(np.mean([means[name] for name in ("fx", "fy") if name in means] or [1000.0]))
    sd = {
        name: OPEN_SD[name] * abs(f) if name in OPEN_SD else OPEN_COEFFICIENT_SD.get(name, OPEN_RADIAL_SD)
        for name in means
    }
    return {name: (mean, max(sd[name], np.ravel(values[name])[-1] if np.ndim(values[name]) else 0.0))
            for name, mean in means.items()}  # fmt: skip


def centred(bundle: Bundle, values: Known) -> bool:
    """Return whether a fit of `opened` numbers stayed near them, so that its prior did not hold it back."""
    wide = opened(values)
    at = dict(zip(bundle.names, bundle.parameters.tolist(), strict=True))
    return all(
        abs(at[name] - mean) <= MAX_OPEN_SHIFT_SD * sd
        for name, (mean, sd) in ((name, tuple(np.ravel(value))) for name, value in wide.items())
        if name in at and name in LINEAR
    )


class GivenIntrinsics(NamedTuple):
    """Numbers that were given beforehand, by name: value and standard deviation (0: fixed), and whether as exact."""

    values: Mapping[str, tuple[float, float]]
    exact: bool

    @classmethod
    def of(cls, known: Known, exact: bool) -> GivenIntrinsics:
        """Return given numbers as they are used."""
        pairs = {name: (*np.ravel(value).tolist(), 0.0)[:2] for name, value in known.items()}
        return cls({name: (float(mean), float(sd)) for name, (mean, sd) in pairs.items()}, exact)


@dataclass(frozen=True, eq=False)
class GivenTest:
    """Given intrinsics against the data; see the module."""

    names: tuple[str, ...]
    given: Array  # (m,) k_0
    sd: Array  # (m,) of the given numbers
    precision: Array  # (m, m) C^-1
    pull: Array  # (m,) C^-1 d

    def with_more(self, precision: Array, pull: Array) -> GivenTest:
        """Return the test with the precision and the pull of further, independent data."""
        return replace(self, precision=self.precision + precision, pull=self.pull + pull)

    @cached_property
    def _inverse(self) -> tuple[Array, int]:
        return _pseudo_inverse(self.precision)

    @property
    def dof(self) -> int:
        """Number of directions in which the data say something of the numbers."""
        return self._inverse[1]

    def chi2(self, given: Array | None = None) -> float:
        """``d^T C^-1 d``, for the numbers given or others in their place."""
        v = self.pull if given is None else self.pull - self.precision @ (given - self.given)
        return float(v @ self._inverse[0] @ v)

    def along(self, direction: Array) -> float:
        """Return the pull along a direction in standard deviations."""
        size = float(direction @ self.precision @ direction)
        return float(direction @ self.pull) / float(np.sqrt(size)) if size > 0 else 0.0

    @property
    def sigma(self) -> float:
        """The contradiction in standard deviations, at the level of all tests together.

        Half a pixel of the centre is the usual mistake: that direction is tested by itself, in addition to the others.
        """
        single = np.abs([self.along(direction) for direction in np.eye(len(self.names))])
        joint, largest, tests = self.chi2(), float(single.max()), len(self.names) + 1
        of_all = _sigma(float(chdtrc(self.dof, joint)), tests, np.sqrt(joint))
        return max(self.half_pixel, of_all, _sigma(float(erfc(largest / np.sqrt(2))), tests, largest))

    @property
    def half_pixel(self) -> float:
        """Pull of both coordinates of the centre by the same shift, in standard deviations."""
        return abs(self.along(self._centre))

    @property
    def _centre(self) -> Array:
        return np.isin(self.names, ["cx", "cy"]).astype(float)

    @property
    def contradicted(self) -> bool:
        """Return whether the data contradict the numbers; half a pixel is recognised from less, where just it fits."""
        if self.sigma >= CAUTION_SD:
            return True
        shift = 0.5 * float(np.sign(self.along(self._centre))) * self._centre
        of_half = abs(replace(self, pull=self.pull - self.precision @ shift).along(self._centre))
        return self.half_pixel >= HALF_PIXEL_CAUTION_SD and of_half < MAX_HALF_PIXEL_SD

    def blamed(self) -> list[int]:
        """Return the numbers of the contradiction, the one that explains most first."""
        P, v, chosen = self.precision, self.pull, list[int]()
        while len(chosen) < len(v):
            rest = max(self.chi2() - (_explained(P, v, chosen) if chosen else 0.0), 0.0)
            if chosen and _sigma(float(chdtrc(max(self.dof - len(chosen), 1), rest)), 1, np.sqrt(rest)) < CAUTION_SD:
                break
            others = [j for j in range(len(v)) if j not in chosen and P[j, j] > 0]
            if not others:
                break
            chosen.append(max(others, key=lambda j: _explained(P, v, [*chosen, j])))
        return chosen

    def wanted(self, numbers: Sequence[int]) -> tuple[Array, Array, Array]:
        """Return the values by the pictures, their standard deviations, and by how many sigma those given are off."""
        index = list(numbers)
        C = np.linalg.pinv(self.precision[np.ix_(index, index)], hermitian=True)
        off = C @ self.pull[index]
        total = np.sqrt(np.diag(C))
        own = np.sqrt(np.maximum(np.diag(C) - self.sd[index] ** 2, (0.01 * total) ** 2))
        return self.given[index] + off, own, off / total

    def agrees(self, given: Array) -> bool:
        """Return whether other numbers in the place of those given agree with the data, or nearly so by comparison."""
        chi2 = self.chi2(given)
        return chi2 < MAX_LEFT_SHARE * self.chi2() or _sigma(float(chdtrc(self.dof, chi2)), 1, 0.0) < CAUTION_SD


def _explained(P: Array, v: Array, index: list[int]) -> float:
    return float(v[index] @ np.linalg.pinv(P[np.ix_(index, index)], hermitian=True) @ v[index])


def _sigma(p: float, tests: int, beyond: float) -> float:
    """Return the standard deviations of the smallest of several p-values; ``beyond`` where it is next to 0."""
    if p < 1e-200:
        return float(max(beyond, -ndtri(1e-200)))
    whole = -np.expm1(tests * np.log1p(-min(p, 1.0 - 1e-16)))
    return float(max(-ndtri(0.5 * whole), 0.0))


def _pseudo_inverse(S: Array) -> tuple[Array, int]:
    """Return the inverse of a covariance or information along the directions that it has, and their number."""
    scale = np.sqrt(np.maximum(np.diag(S), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(S / np.outer(scale, scale))
    kept = values > SOLUTION_ROUNDING * len(S)
    root = vectors[:, kept] / np.sqrt(values[kept])
    return (root @ root.T) / np.outer(scale, scale), int(kept.sum())


def given_test(bundle: Bundle, corners: Corners, given: Mapping[str, tuple[float, float]]) -> GivenTest | None:
    """Test given numbers by the corners, linearised at a bundle in which they may be open; None where they say nothing.

    Coefficients that are given and that the bundle's model does not have are not tested.
    """
    model, shape = bundle.model, bundle.shape
    names = [name for name in model.names if name in given]
    if not names:
        return None
    at = [model.names.index(name) for name in names]
    free = bundle.free.copy()
    free[at] = True
    counts = bundle.used * np.sqrt(bundle.weights)[corners.picture]
    r, A, B = Sight.of(model, shape, corners, counts).rows(bundle.parameters, bundle.poses, free)
    s = bundle.pixel_noise
    E = (A - B @ np.linalg.solve(B.mT @ B, B.mT @ A)) / s
    scores = -(E.mT @ (r / s)[..., None])[..., 0]  # (n, f): gradients of the log-likelihood
    H, g = np.einsum("nij,nik->jk", E, E), scores.sum(axis=0)
    open_ones = np.flatnonzero(free)
    tested = np.isin(open_ones, at)
    # Priors of what is not given, such as of the shape of the board.
    if bundle.prior is not None:
        others = open_ones[~tested]
        inverse_prior = np.linalg.inv(bundle.prior.covariance[np.ix_(others, others)])
        rest = np.flatnonzero(~tested)
        H[np.ix_(rest, rest)] += inverse_prior
        g[rest] -= inverse_prior @ (bundle.parameters - bundle.prior.mean)[others]
    project = np.eye(len(g))[tested]
    if (~tested).any():
        project[:, ~tested] = -H[np.ix_(tested, ~tested)] @ _pseudo_inverse(H[np.ix_(~tested, ~tested)])[0]
    information = project @ H @ project.T
    information = 0.5 * (information + information.T)
    back, dof = _pseudo_inverse(information)
    if dof == 0:
        return None
    off = back @ (project @ g)
    means, sd = np.array([given[name] for name in names]).T
    # Gradients of the pictures at their own optimum scatter by the noise, and more where corners err together.
    tested_columns = E @ project.T
    each = scores @ project.T - (tested_columns.mT @ (tested_columns @ off)[..., None])[..., 0]
    rho = max(float(np.sum((each @ back) * each)) / dof * len(each) / max(len(each) - 1, 1), 1.0)
    information, b = information / rho, (information @ (bundle.parameters[at] - means) + project @ g) / rho
    of_prior = np.eye(len(names)) + information * sd**2
    precision = np.linalg.solve(of_prior, information)
    return GivenTest(tuple(names), means, sd, 0.5 * (precision + precision.T), np.linalg.solve(of_prior, b))


# ------------------------------------------------------------------------------------------------ readings


def readings(test: GivenTest, size: tuple[int, int], model: str) -> list[str]:
    """Return the readings of the given numbers that agree with the pictures, the best first."""
    found: list[tuple[float, str]] = []
    said: set[str] = set()
    for words, changes in _candidates(dict(zip(test.names, test.given.tolist(), strict=True)), size, model):
        if not changes or words in said:
            continue
        numbers = np.array([changes.get(name, value) for name, value in zip(test.names, test.given, strict=True)])
        if test.agrees(numbers):
            found.append((test.chi2(numbers), words))
            said.add(words)
    found.sort(key=lambda one: one[0])
    best = [words for chi2, words in found[:3] if chi2 < found[0][0] + MAX_READING_DIFFERENCE]
    return best or _crop(test)


def _crop(test: GivenTest) -> list[str]:
    """Return the reading as another crop, where the centre alone is off by more than a few pixels."""
    index = [j for j, name in enumerate(test.names) if name in ("cx", "cy")]
    if len(index) < 2:
        return []
    P, v = test.precision, test.pull
    if (np.diag(P)[index] <= 0).any():
        return []
    values, _, _ = test.wanted(index)
    shift = test.given[index] - values
    rest = max(test.chi2() - _explained(P, v, index), 0.0)
    dof = max(test.dof - 2, 1)
    if np.abs(shift).max() < MIN_CROP_PX or _sigma(float(chdtrc(dof, rest)), 1, np.sqrt(rest)) > CAUTION_SD:
        return []
    return [f"another crop, shifted by {shift[0]:.1f} and {shift[1]:.1f} px"]


def _candidates(
    k: Mapping[str, float], size: tuple[int, int], model: str
) -> list[tuple[str, dict[str, float]]]:  # fmt: skip
    """Return readings in words, and the numbers that each of them changes."""
    found: list[tuple[str, dict[str, float]]] = []
    centre = [(name, side) for name, side in zip(("cx", "cy"), size, strict=True) if name in k]
    for du, dv in product((-0.5, 0.0, 0.5), repeat=2):
        changes = {name: k[name] + d for (name, _), d in zip(centre, (du, dv), strict=False) if d}
        words = "half a pixel" if du == dv else f"half a pixel ({' and '.join(changes)} only)" if not du * dv else (
            "half a pixel in opposite directions")  # fmt: skip
        from_corner = " (counted from the corner of the first pixel)" if du == dv == -0.5 else ""
        found.append((words + from_corner, changes))
    for chosen in ([0], [1], [0, 1]):
        some = [centre[j] for j in chosen if j < len(centre)]
        changes = {name: side - 1 - k[name] for name, side in some}
        words = f"the offset of {' and '.join(changes)} from the middle has the other sign"
        found.append((words, changes))
        if len(some) == len(centre) == 2:
            turned = changes | {name: -k[name] for name in ("p1", "p2") if name in k}
            found.append((f"the pictures are upside down, or {words}", turned))
        elif chosen == [0] and k.get("p2"):
            found.append((f"the pictures are mirrored, or {words}", changes | {"p2": -k["p2"]}))
    linear = [name for name in LINEAR if name in k]
    for ratio in RESOLUTIONS:
        plain = {name: ratio * k[name] for name in linear}
        of = f"intrinsics of another resolution ({1 / ratio:.4g} times that of the pictures)"
        found.append((of, plain))
        shifted = {name: value + (0.5 * (ratio - 1) if name[0] == "c" else 0.0) for name, value in plain.items()}
        found.append((of, shifted))
    for n in REDUCTIONS:
        half = {name: k[name] + 0.5 / n - 0.5 for name, _ in centre}
        found.append((f"cx and cy were divided by {n} without regard to half a pixel", half))
    if {"fx", "fy"} <= set(k):
        found.append(("fx and fy are exchanged", {"fx": k["fy"], "fy": k["fx"]}))
    if {"cx", "cy"} <= set(k):
        found.append(("cx and cy are exchanged", {"cx": k["cy"], "cy": k["cx"]}))
    return found + _coefficient_readings(k, size, model)


def _coefficient_readings(
    k: Mapping[str, float], size: tuple[int, int], model: str
) -> list[tuple[str, dict[str, float]]]:  # fmt: skip
    """Return the readings of the coefficients of a lens: other orders, other signs, the other way round."""
    found: list[tuple[str, dict[str, float]]] = []
    names = [name for name in MODELS[model].coefficients if name in k]
    d = [k[name] for name in names]
    if not any(d):
        return found
    if {"p1", "p2"} <= set(names):
        found.append(("p1 and p2 are exchanged", {"p1": k["p2"], "p2": k["p1"]}))
        found.append(("p1 and p2 have the other sign", {"p1": -k["p1"], "p2": -k["p2"]}))
    if names[:5] == ["k1", "k2", "p1", "p2", "k3"]:
        for order in (("k1", "k2", "k3", "p1", "p2"), ("k1", "k2", "k3", "p2", "p1"), ("p1", "p2", "k1", "k2", "k3")):
            changes = dict(zip(order, d[:5], strict=True))
            found.append((f"coefficients in the order {', '.join(order)}", changes))
    if names[:4] == ["k1", "k2", "p1", "p2"] and len(names) < 8 and "k3" in names and len(d) > 4:
        found.append(("coefficients of a model with k3 before p1 and p2, p2 first",
                      dict(zip(("k1", "k2", "k3", "p2", "p1"), d[:5], strict=True))))  # fmt: skip
    if len(names) >= 8 and model in ("brown", "brown_full"):
        azure = ("k1", "k2", "k3", "k4", "k5", "k6", "p2", "p1")
        found.append(("coefficients in the order k1 to k6, p2, p1", dict(zip(azure, d[:8], strict=True))))
        azure = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
        found.append(("coefficients in the order k1 to k6, p1, p2", dict(zip(azure, d[:8], strict=True))))
    found.append(("coefficients have the other sign", {name: -k[name] for name in names}))
    if (other := _inverted(k, names, size, model)) is not None:
        found.append(("coefficients are those of the inverse model (pixel to ray)", other))
    return found


def _inverted(
    k: Mapping[str, float], names: Sequence[str], size: tuple[int, int], model: str, nodes: int = 21
) -> dict[str, float] | None:  # fmt: skip
    """Return the coefficients by which the model projects as it now takes distortion out; None where it has none.

    The numbers given map a pixel's normalised coordinates to those of its ray; the coefficients that map rays to
    pixels are fitted over the picture by Gauss-Newton steps.
    """
    lens = MODELS[model]
    if model not in ("brown", "brown_full") or not set(LINEAR) <= set(k):
        return None
    fx, fy, cx, cy = (k[name] for name in LINEAR)
    u, v = np.meshgrid(np.linspace(0, size[0] - 1, nodes), np.linspace(0, size[1] - 1, nodes))
    seen = np.stack([(u.ravel() - cx) / fx, (v.ravel() - cy) / fy, np.ones(u.size)], axis=-1)
    unit = np.array([1.0, 1.0, 0.0, 0.0, *(k.get(name, 0.0) for name in lens.coefficients)])
    rays = np.append(lens.project(unit, seen).pixels, np.ones((u.size, 1)), axis=1)
    at = np.array([1.0, 1.0, 0.0, 0.0, *np.zeros(len(lens.coefficients))])
    free = np.isin(lens.names, names)
    for _ in range(10):
        found = lens.project(at, rays, free)
        J = found.by_parameters.reshape(-1, int(free.sum()))
        step = np.linalg.lstsq(J, (seen[:, :2] - found.pixels).ravel(), rcond=1e-9)[0]
        at[free] += step
        if not np.isfinite(at).all():
            return None
    return dict(zip(lens.names, at.tolist(), strict=True)) | {name: k[name] for name in LINEAR}


# ------------------------------------------------------------------------------------------------ finding


def finding_of(test: GivenTest, size: tuple[int, int], model: str, exact: bool, data: str = "pictures") -> Finding:
    """Return whether the data agree with the given numbers; ``exact``: the user keeps them whatever they say."""
    sigma, chi2 = test.sigma, test.chi2()
    if not test.contradicted:
        agreement = {"chi2": chi2, "dof": test.dof, "p_value": float(chdtrc(test.dof, chi2))}
        return Finding("camera.given_agree", "note", agreement)
    blamed = test.blamed()
    numbers = [
        {"name": test.names[j], "given": float(test.given[j]), "wanted": float(w), "std": float(s), "sigma": float(z)}
        for j, w, s, z in zip(blamed, *test.wanted(blamed), strict=True)
    ]
    values = {
        "contradicted": numbers, "sigma": sigma, "chi2": chi2, "dof": test.dof,
        "explanations": readings(test, size, model), "kept": exact, "data": data,
    }  # fmt: skip
    severity: Severity = "caution" if exact or sigma < FAILURE_SD else "failure"
    return Finding("camera.given_contradicted", severity, values)


def freed(given: Known, blamed: Sequence[str]) -> dict[str, float | tuple[float, float]]:
    """Return what is left of given numbers: without the focal lengths or the centre, where these are blamed.

    Coefficients that are blamed, all together, keep wide standard deviations: many of them have nearly the same effect.
    """
    groups = ({"fx", "fy"}, {"cx", "cy"})
    out = set[str]()
    for name in blamed:
        out |= next((group for group in groups if name in group), set(given) - set(LINEAR))
    wide = opened({name: value for name, value in given.items() if name not in LINEAR})
    return {name: wide.get(name, value) if name in out else value for name, value in given.items()
            if name not in out or name not in LINEAR}  # fmt: skip
