"""Search for the camera model and the shape of the board, by the Bayesian information criterion (`criterion`).

All lenses are fitted with a flat board, then all shapes with the best lens, and so on in turn until the choice no
longer changes. Each starts from the best of those that are nested in it, simple ones first: with few pictures a lens of
many coefficients may converge to a focal length far off, from which a simple one does not recover. Models that are not
nested, such as a fisheye and a lens with polynomials in the plane, are both fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import numpy as np

from ....core.geometry.se3 import Array
from ....errors import InputError
from ..board_shape import BoardShape
from ..corners import Corners
from ..models import MODELS
from .bundle import Bundle
from .criterion import CLEAR_BIC_DIFFERENCE, Candidate, best, criterion
from .outliers import without_outliers
from .setting import Known, Setting

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
# Coefficients that a model has unless the caller names others.
USUAL = {
    "pinhole": (),
    "brown": ("k1", "k2", "p1", "p2"),
    "fisheye": ("k1", "k2", "k3", "k4"),
    "brown_full": ("k1", "k2", "p1", "p2"),
    "inverse_brown": ("k1", "k2", "p1", "p2"),
    "fisheye624": ("k0", "k1", "k2", "k3", "p0", "p1"),
}
Lens = tuple[str, tuple[str, ...]]  # a model and the coefficients that are free


class ModelFit(NamedTuple):
    """Result of the search for a model."""

    setting: Setting
    bundle: Bundle
    candidates: tuple[Candidate, ...]  # that were compared; empty where there was no choice


def search(
    corners: Corners, size: tuple[int, int], lenses: Sequence[Lens], shapes: Sequence[BoardShape], known: Known
) -> ModelFit:
    """The best of all ``lenses`` with all ``shapes``, simple ones first, on the corners that a first fit keeps.

    Raises `InputError` where none fits.
    """
    if len(lenses) == len(shapes) == 1:
        return _first_fit(corners, size, lenses[0], shapes[0], known)
    # A known k5 does not apply to a model without it.
    lenses = [lens for lens in lenses if set(known) <= set(MODELS[lens[0]].names)] or lenses
    found: ModelFit | None = None
    reasons = []
    for fisheye in (False, True):
        members = [lens for lens in lenses if MODELS[lens[0]].wide == fisheye]
        if not members:
            continue
        try:
            other = _best_of(corners, size, members, shapes, known, found)
        except InputError as error:
            reasons.append(error)
            continue
        tried = (*(found.candidates if found else ()), *other.candidates)
        if found is None or _bic(other) < _bic(found) - CLEAR_BIC_DIFFERENCE:
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
    return ModelFit(setting, bundle, candidates)


def _first_fit(corners: Corners, size: tuple[int, int], lens: Lens, shape: BoardShape, known: Known) -> ModelFit:
    """Fit the corners only, without outliers."""
    setting = Setting.of(MODELS[lens[0]], lens[1], known, shape)
    bundle, _ = without_outliers(corners, partial(setting.fit, corners, setting.start(corners, size)))
    return ModelFit(setting, bundle, ())


def _best_of(
    corners: Corners,
    size: tuple[int, int],
    lenses: Sequence[Lens],
    shapes: Sequence[BoardShape],
    known: Known,
    other: ModelFit | None,
) -> ModelFit:
    """Return the best of nested lenses; ``other`` is the best of the lenses that these are not nested with."""
    # A first fit leaves the denominator of the rational model to later ones.
    few = [lens for lens in lenses if "k6" not in lens[1]] or lenses
    lens = max(few, key=lambda lens: len(lens[1]))
    if other is None:
        first = _first_fit(corners, size, lens, shapes[0], known)
    else:
        setting = Setting.of(MODELS[lens[0]], lens[1], known, other.setting.shape)
        first = ModelFit(setting, setting.fit(corners, _as_fisheye(other.bundle, corners), other.bundle.used), ())
        if not _bic(first) < _bic(other) - CLEAR_BIC_DIFFERENCE:  # then no shape of the board will make it the best
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
                found = ModelFit(setting, setting.fit(corners, start, first.bundle.used), ())
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
            compared = tuple(one for (lens, name), one in tried.items() if lens == here[0] or name == here[1])
            return fitted[here]._replace(candidates=compared)
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


def _bic(found: ModelFit) -> float:
    bundle = found.bundle
    if not bundle.converged:
        return float("inf")
    return criterion(_squares(bundle), 2 * int(bundle.used.sum()), len(bundle.poses), int(bundle.free.sum()))


def _candidate(found: ModelFit, lens: Lens) -> Candidate:
    rms = float(np.sqrt(np.mean(found.bundle.residuals[found.bundle.used] ** 2)))
    cx, cy = found.bundle.parameters[2:4].tolist()
    return Candidate(*lens, _bic(found), rms, found.bundle.shape.name, (cx, cy))
