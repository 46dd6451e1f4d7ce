r"""Choice of the camera model and the shape of the board by the Bayesian information criterion, never radial terms
only.

Of candidates with p free parameters in common, that leave the sum of squares Q of the N coordinates that count in n
pictures (G. Schwarz, Annals of Statistics 6 (1978)):

    BIC = nu ln(Q / nu) + p ln nu  nu / (nu - p - 2),    nu = N - 6 n

the smallest is best. nu and not N: the poses of the pictures take 6 numbers each, whatever the candidate. Their
marginal likelihood has the exponent nu / 2; with N the profile likelihood counts what they take as evidence (J. Neyman,
E. Scott, Econometrica 16 (1948)), which for boards of few corners takes coefficients that are not there. The last
factor is the correction for few residuals (A. McQuarrie, Statistics & Probability Letters 44 (1999)): ln Q falls by
more than chi-square says where p is no small part of nu; with many corners it is 1.
The criterion takes residuals of different corners as independent. Where they are not it takes more coefficients than
there are; that does little harm, as X is then only a little less certain, while one that is missing shifts X.

A lens that distorts is not centred to the last micron either. Too small for the criterion, the decentring p1, p2 still
rotates X by several standard deviations where it is taken as 0: with k1 = -0.1, p1 = 3e-4, p2 = -2e-4 and 20 pictures
of 54 corners the criterion alone took k1 only, and the truth lay in its 95 % ellipsoid in 6 sets of 24; with p1 and p2
free in 23. Where a radial model has the smallest BIC, `best` therefore takes the best of those that hold p1 and p2
as well. A camera without any distortion, as in rendered pictures, remains a pinhole. For the same reason a fisheye,
which has no decentring, is taken only where its BIC is smaller by CLEARLY: through a narrow lens both fit as well.

The best of many camera models and board shapes: all lenses are fitted with a flat board, then all shapes with the best
lens, and so on in turn until the best stays. Each starts from the best of those that are nested in it, simple ones
first: from few pictures a rich lens finds a focal length far off, from which a plain one does not find back. Models
that are not nested, a fisheye beside a lens with polynomials in the plane, are fitted both.

Estimated parameters of a camera and its board, their prior, and the start of a fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.se3 import Array
from ....errors import InputError
from ..board_shape import FLAT, BoardShape
from ..corners import Corners
from ..models import LINEAR, MODELS, CameraModel
from .bundle import Asked, Bundle, Prior, adjust
from .initial_guess import AMBIGUOUS, better_start, first_guess, poses_of
from .outliers import without_outliers

# A value, which is exact, or a value and its standard deviation.
Known = Mapping[str, float | tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Setting(Asked):
    """Choice of the estimated ones of p parameters, with their start and prior."""

    values: Array = field(default_factory=lambda: np.zeros(0))  # (p,) nan where the start must find them

    @classmethod
    def of(cls, model: CameraModel, coefficients: Sequence[str], known: Known, shape: BoardShape) -> Setting:
        for name in (*coefficients, *known):
            if name not in model.names:
                raise InputError(
                    f"The model {model.name!r} has no parameter {name!r}; it has {', '.join(model.names)}."
                )
        names = (*model.names, *shape.names)
        mean, deviation = np.zeros(len(names)), np.concatenate([np.full(len(model.names), np.inf), shape.sd])
        values = np.where(np.isin(names, LINEAR), np.nan, 0.0)
        free = np.isin(names, (*LINEAR, *coefficients, *shape.names))
        for k, name in enumerate(model.names):
            if name not in known:
                continue
            entry = known[name]
            value, sd = (*np.atleast_1d(entry), 0.0)[:2]
            if not (np.isfinite(value) and np.isfinite(sd) and sd >= 0):
                raise InputError(
                    f"Expected `intrinsics[{name!r}]` to be a number, or one and its standard deviation; got {entry!r}."
                )
            mean[k], deviation[k], values[k] = value, sd, value
            free[k] = sd > 0
        if not np.isfinite(deviation[free]).any():
            return cls(model, shape, free, None, values)
        # What is not known gets so wide a prior that it says nothing.
        wide = np.where(np.isin(names, LINEAR), 1e6, 1e3)
        prior = Prior(mean, np.diag(np.where(np.isfinite(deviation), deviation, wide) ** 2))
        return cls(model, shape, free, prior, values)

    def start(self, corners: Corners, size: tuple[int, int]) -> tuple[Array, Array]:
        """Parameters and poses."""
        if np.isnan(self.values).any():
            guess, poses = first_guess(self.model, corners, size)
            parameters = np.concatenate([guess, np.zeros(self.shape.q)])
            if np.isnan(self.values[:4]).all():
                return np.where(np.isnan(self.values) | (self.values == 0), parameters, self.values), poses
            parameters = np.where(np.isnan(self.values), parameters, self.values)
        else:
            parameters = self.values
        poses = poses_of(corners, (corners.pixels - parameters[2:4]) / parameters[:2])
        if len(self.shape.points) < AMBIGUOUS:
            poses = better_start(self.model, parameters, self.shape, corners, poses)
        return parameters, poses

    def after(self, found: Bundle) -> tuple[Array, Array]:
        """Parameters and poses to start from once others were fitted, both of a fisheye or neither."""
        before = dict(zip(found.names, found.parameters, strict=True))
        values = np.array([before.get(name, 0.0) for name in self.names])
        return np.where(self.free, values, self.values), found.poses

    def fit(
        self,
        corners: Corners,
        start: tuple[Array, Array],
        used: NDArray[np.bool_],
        before: Bundle | None = None,
        weights: Array | None = None,
        pixel_noise: float | None = None,
    ) -> Bundle:
        """The bundle from a start, or from one that was fitted ``before`` with this setting."""
        at = start if before is None else (before.parameters, before.poses)
        try:
            asked = Asked(self.model, self.shape, self.free, self.prior)
            return adjust(asked, corners, at, used=used, weights=weights, pixel_noise=pixel_noise)
        except np.linalg.LinAlgError as error:
            raise InputError(
                f"The model {self.model.name!r} does not fit the corners: they look farther to the side than it can "
                "describe (try 'fisheye' or 'auto'), or those of one picture lie on a line."
            ) from error


# Candidates of "auto", from few parameters to many: model and coefficients that are free.
CANDIDATES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("pinhole", ()),
    ("brown", ("k1",)),
    ("brown", ("k1", "k2")),
    ("brown", ("k1", "k2", "p1", "p2")),
    ("brown", ("k1", "k2", "p1", "p2", "k3")),
    ("brown", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    ("fisheye", ("k1", "k2", "k3", "k4")),
)
# A difference of BIC that speaks clearly (R. Kass, A. Raftery, J. Amer. Stat. Assoc. 90 (1995)).
CLEARLY = 10.0
DECENTRING = frozenset(("p1", "p2"))
# Coefficients that a model has unless the caller names others.
USUAL = {"pinhole": (), "brown": ("k1", "k2", "p1", "p2"), "fisheye": ("k1", "k2", "k3", "k4")}


class Candidate(NamedTuple):
    """A model that was tried."""

    model: str
    coefficients: tuple[str, ...]
    bic: float  # infinite where the fit did not succeed
    rms: float  # pixels per coordinate, of what is left
    shape: str = FLAT  # of the board

    @property
    def lens(self) -> str:
        """Model and coefficients."""
        return self.model + (f" ({', '.join(self.coefficients)})" if self.coefficients else "")


def best(candidates: Sequence[Candidate]) -> Candidate | None:
    """The one to take; None if no fit succeeded."""
    fitted = [c for c in candidates if np.isfinite(c.bic)]
    found = min((c for c in fitted if c.model != "fisheye"), key=lambda c: c.bic, default=None)
    if found is not None and found.model == "brown" and not set(found.coefficients) >= DECENTRING:
        whole = [c for c in fitted if c.model == "brown" and set(c.coefficients) >= DECENTRING]
        found = min(whole, key=lambda c: c.bic, default=found)
    wide = min((c for c in fitted if c.model == "fisheye"), key=lambda c: c.bic, default=None)
    return wide if found is None or (wide is not None and wide.bic < found.bic - CLEARLY) else found


def criterion(squares: float, coordinates: int, pictures: int, parameters: int) -> float:
    """BIC of what is left, see the module."""
    nu = max(coordinates - 6 * pictures, 1)
    return float(nu * np.log(max(squares, np.finfo(float).tiny) / nu) + price(parameters, nu))


def price(parameters: int, nu: int) -> float:
    """Return what BIC adds for the parameters, with the correction for few residuals."""
    return float(parameters * np.log(nu) * nu / max(nu - parameters - 2, 1))


# A first fit has at most so many coefficients: the denominator of the rational model is left to later ones.
FIRST = 5
Lens = tuple[str, tuple[str, ...]]  # a model and the coefficients that are free


class Found(NamedTuple):
    """Result of the search for a model."""

    setting: Setting
    bundle: Bundle
    candidates: tuple[Candidate, ...]  # that were compared; empty where there was no choice


def search(
    corners: Corners, size: tuple[int, int], lenses: Sequence[Lens], shapes: Sequence[BoardShape], known: Known
) -> Found:
    """The best of all ``lenses`` with all ``shapes``, simple ones first, on the corners that a first fit keeps.

    Raises `InputError` where none fits.
    """
    if len(lenses) == len(shapes) == 1:
        return _first_fit(corners, size, lenses[0], shapes[0], known)
    # What is known of k5 says nothing about a model without it.
    lenses = [lens for lens in lenses if set(known) <= set(MODELS[lens[0]].names)] or lenses
    found: Found | None = None
    reasons = []
    for fisheye in (False, True):
        members = [lens for lens in lenses if (lens[0] == "fisheye") == fisheye]
        if not members:
            continue
        try:
            other = _best_of(corners, size, members, shapes, known, found)
        except InputError as error:
            reasons.append(error)
            continue
        tried = (*(found.candidates if found else ()), *other.candidates)
        if found is None or _bic(other) < _bic(found) - CLEARLY:
            found = other
        found = found._replace(candidates=tried)
    if found is None:
        if len(lenses) == 1:
            raise reasons[0]
        raise InputError(
            "No camera model fits the corners: are `image_size`, the points of the board and the pixels those of the "
            f"same pictures? {reasons[0]}"
        )
    setting, bundle, candidates = found
    bundle, _ = without_outliers(corners, partial(setting.fit, corners, (bundle.parameters, bundle.poses)), bundle)
    return Found(setting, bundle, candidates)


def _first_fit(corners: Corners, size: tuple[int, int], lens: Lens, shape: BoardShape, known: Known) -> Found:
    """Fit the corners only, without outliers."""
    setting = Setting.of(MODELS[lens[0]], lens[1], known, shape)
    bundle, _ = without_outliers(corners, partial(setting.fit, corners, setting.start(corners, size)))
    return Found(setting, bundle, ())


def _best_of(
    corners: Corners,
    size: tuple[int, int],
    lenses: Sequence[Lens],
    shapes: Sequence[BoardShape],
    known: Known,
    other: Found | None,
) -> Found:
    """Return the best of nested lenses; ``other`` is the best of the lenses that these are not nested with."""
    few = [lens for lens in lenses if len(lens[1]) <= FIRST] or lenses
    lens = max(few, key=lambda lens: len(lens[1]))
    if other is None:
        first = _first_fit(corners, size, lens, shapes[0], known)
    else:
        setting = Setting.of(MODELS[lens[0]], lens[1], known, other.setting.shape)
        first = Found(setting, setting.fit(corners, _as_fisheye(other.bundle, corners), other.bundle.used), ())
        if not _bic(first) < _bic(other) - CLEARLY:  # then no shape of the board will make it the best
            return first._replace(candidates=(_candidate(first, lens),))
    by_name = {shape.name: shape for shape in shapes}
    fitted = {(lens, first.setting.shape.name): first}
    tried = {key: _candidate(found, lens) for key, found in fitted.items()}

    def fit(lens: Lens, name: str) -> None:
        """Fit a candidate from the best of those that are nested in it; a flat one also from the first fit."""
        setting = Setting.of(MODELS[lens[0]], lens[1], known, by_name[name])
        flat = shapes[0].name
        nested = [fitted[key].bundle for key in fitted if set(key[0][1]) <= set(lens[1]) and key[1] in (name, flat)]
        starts = [setting.after(bundle) for bundle in sorted(nested, key=_squares)[:1]]
        if name == flat or not starts:
            starts.append(setting.after(first.bundle))
        tried[lens, name] = Candidate(*lens, float("inf"), float("inf"), name)
        with suppress(InputError):
            if not nested and other is None:
                starts.append(setting.start(corners, size))
        for start in starts:
            with suppress(InputError):
                found = Found(setting, setting.fit(corners, start, first.bundle.used), ())
                if _bic(found) < tried[lens, name].bic:
                    fitted[lens, name], tried[lens, name] = found, _candidate(found, lens)

    here, across = (lenses[0], shapes[0].name), False
    while True:
        for key in [(here[0], name) for name in by_name] if across else [(lens, here[1]) for lens in lenses]:
            if key not in tried:
                fit(*key)
        if (chosen := best(list(tried.values()))) is None:
            raise InputError(f"The model {lenses[0][0]!r} does not fit the corners, whatever the shape of the board.")
        before, here = here, next(key for key, one in tried.items() if one is chosen)
        if across and here == before:
            beside = tuple(one for (lens, name), one in tried.items() if lens == here[0] or name == here[1])
            return fitted[here]._replace(candidates=beside)
        across = not across


def _as_fisheye(found: Bundle, corners: Corners) -> tuple[Array, Array]:
    """Return the start of a fisheye that sees what a lens with a plane picture was found to see.

    With the angle phi of a corner from the axis and its distance r from the centre in focal lengths the coefficients
    are the least squares solution of ``phi + k1 phi^3 + ... + k4 phi^9 = r``.
    """
    fx, fy, cx, cy = found.parameters[:4]
    poses = found.poses[corners.picture]
    points = (poses[:, :3, :3] @ corners.points[..., None])[..., 0] + poses[:, :3, 3]
    phi = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
    r = np.hypot((corners.pixels[:, 0] - cx) / fx, (corners.pixels[:, 1] - cy) / fy)
    powers = phi[:, None] ** np.array([3, 5, 7, 9])
    k = np.linalg.lstsq(powers[found.used], (r - phi)[found.used], rcond=None)[0]
    return np.concatenate([[fx, fy, cx, cy], k, found.bend]), found.poses


def _squares(bundle: Bundle) -> float:
    return float(np.sum(bundle.residuals[bundle.used] ** 2))


def _bic(found: Found) -> float:
    bundle = found.bundle
    if not bundle.converged:
        return float("inf")
    return criterion(_squares(bundle), 2 * int(bundle.used.sum()), len(bundle.poses), int(bundle.free.sum()))


def _candidate(found: Found, lens: Lens) -> Candidate:
    rms = float(np.sqrt(np.mean(found.bundle.residuals[found.bundle.used] ** 2)))
    return Candidate(*lens, _bic(found), rms, found.bundle.shape.name)
