r"""`calibrate_camera`: corners of a board in, intrinsics, camera poses and their joint covariance out.

What the poses of one camera have in common is its intrinsics: an error of the focal length moves all of them along the
optical axis. The result therefore carries, beside the poses, their joint covariance: of each its own part, and what the
intrinsics do to all (`bundle`, T4b). ``PoseNoise(camera=result.covariance)`` hands it to everything else.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, NotConvergedError
from ..findings import Finding, warn
from ..geometry.se3 import Array
from .bundle import Bundle, Prior, adjust, picture_weights
from .corners import Corners, without_pictures
from .initial_guess import first_guess, poses_of, unlike_a_board
from .model_choice import CANDIDATES, USUAL, Candidate, best, criterion
from .models import LINEAR, MODELS, CameraModel
from .outliers import spoilt, without_outliers
from .residual_pattern import Pattern, pattern_of
from .result import SMALL, UNCERTAIN, CameraCalibration, Known

# Pictures that must remain where others are left out as a whole.
FEWEST_PICTURES = 3


def calibrate_camera(
    corners: Corners,
    image_size: tuple[int, int] | None = None,
    model: str = "auto",
    *,
    coefficients: Sequence[str] | None = None,
    intrinsics: Known | None = None,
) -> CameraCalibration:
    """Intrinsics, poses of the board and their joint covariance, from corners.

    Parameters
    ----------
    corners : Corners
        At least three pictures, with the board tilted in different ways.
    image_size : (width, height) or None
        Pixels. None: as the corners say (`detect_board`).
    model : "pinhole", "brown", "fisheye" or "auto"
        "auto" takes the best of several by BIC, see `model_choice`.
    coefficients : names or None
        Which coefficients of the model are estimated; the others are 0. None: k1, k2, p1, p2 of "brown", all of
        "fisheye".
    intrinsics : {name: value or (value, deviation)} or None
        What is known beforehand: a value alone is exact, one with a standard deviation a Gaussian prior, e.g.
        ``{"fx": (1080.0, 2.0), "k1": 0.0}`` from the maker of the camera. With fx, fy, cx and cy among them the start
        needs no estimate.

    Returns
    -------
    CameraCalibration

    Raises
    ------
    InputError
        Corners, size, names or values that make no sense; pictures that do not determine the intrinsics.
    MissingExtraError
        OpenCV is not installed.
    NotConvergedError
        ``partial`` holds the `Bundle` that was reached.
    """
    if not isinstance(corners, Corners):
        raise InputError(
            f"Expected `corners` to be Corners (read_corners, detect_board), got {type(corners).__name__}."
        )
    size = _checked_size(corners.image_size if image_size is None else image_size, corners)
    known = dict(intrinsics or {})
    wrong: list[str] = []
    if (bad := unlike_a_board(corners)).any() and corners.n - bad.sum() >= FEWEST_PICTURES:
        wrong += np.array(corners.names)[bad].tolist()
        corners = _rejected(corners, bad)
    bundle, candidates, setting = _estimated(corners, size, model, coefficients, known)
    while (bad := spoilt(corners, bundle)).any() and corners.n - bad.sum() >= FEWEST_PICTURES:
        wrong += np.array(corners.names)[bad].tolist()
        corners = _rejected(corners, bad)
        bundle, candidates, setting = _estimated(corners, size, model, coefficients, known)
    weights = picture_weights(bundle, corners)
    at = bundle.parameters, bundle.poses
    bundle, _ = without_outliers(corners, partial(_fitted, corners, setting, at, weights=weights), bundle)
    if not bundle.converged:
        raise NotConvergedError(
            f"The bundle adjustment of the camera did not converge within {bundle.iterations} steps: look at the "
            "corners, or try another `model`.",
            bundle,
        )
    pattern = pattern_of(bundle, corners, size)
    findings = _findings(bundle, corners, pattern, candidates != ())
    if wrong:
        findings.append(Finding("camera.pictures_left_out", "caution", {"pictures": wrong}))
    warn(findings)
    return CameraCalibration(bundle, corners, size, candidates, pattern, tuple(findings))


def _estimated(
    corners: Corners, size: tuple[int, int], model: str, coefficients: Sequence[str] | None, known: dict[str, Any]
) -> tuple[Bundle, tuple[Candidate, ...], _Setting]:
    """The bundle without outlying corners, the models that were compared, and what was estimated."""
    if model == "auto":
        if coefficients is not None:
            raise InputError("`coefficients` are those of a model: name the `model`, or leave them to 'auto'.")
        name, chosen, candidates, found = _chosen(corners, size, known)
    elif model in MODELS:
        name, chosen, candidates = model, USUAL[model] if coefficients is None else tuple(coefficients), ()
        found = None
    else:
        raise InputError(f"Expected `model` to be auto or one of {', '.join(MODELS)}, got {model!r}.")
    setting = _Setting.of(MODELS[name], chosen, known)
    start = setting.start(corners, size) if found is None else setting.after(found)
    bundle, _ = without_outliers(corners, partial(_fitted, corners, setting, start))
    return bundle, candidates, setting


def _rejected(corners: Corners, bad: NDArray[np.bool_]) -> Corners:
    """Without some pictures, which were taken all the same: of pictures, unlike of a table, their number is known."""
    counted = () if corners.image_size is None else tuple(np.array(corners.names)[bad].tolist())
    return replace(without_pictures(corners, bad), missing=(*corners.missing, *counted))


@dataclass(frozen=True, eq=False)
class _Setting:
    """Which parameters are estimated, from where, and what is known of them."""

    model: CameraModel
    free: NDArray[np.bool_]
    values: Array  # nan where the start must find them
    prior: Prior | None

    @classmethod
    def of(cls, model: CameraModel, coefficients: Sequence[str], known: Known) -> _Setting:
        for name in (*coefficients, *known):
            if name not in model.names:
                raise InputError(
                    f"The model {model.name!r} has no parameter {name!r}; it has {', '.join(model.names)}."
                )
        mean, deviation = np.zeros(len(model.names)), np.full(len(model.names), np.inf)
        values = np.where(np.isin(model.names, LINEAR), np.nan, 0.0)
        free = np.isin(model.names, (*LINEAR, *coefficients))
        for k, name in enumerate(model.names):
            if name not in known:
                continue
            entry = known[name]
            value, sd = entry if isinstance(entry, tuple) else (entry, 0.0)
            if not (np.isfinite(value) and np.isfinite(sd) and sd >= 0):
                raise InputError(
                    f"Expected `intrinsics[{name!r}]` to be a number, or one and a deviation; got {entry!r}."
                )
            mean[k], deviation[k], values[k] = value, sd, value
            free[k] = sd > 0
        if not np.isfinite(deviation[free]).any():
            return cls(model, free, values, None)
        # What is not known gets so wide a prior that it says nothing.
        wide = np.where(np.isin(model.names, LINEAR), 1e6, 1e3)
        return cls(model, free, values, Prior(mean, np.diag(np.where(np.isfinite(deviation), deviation, wide) ** 2)))

    def start(self, corners: Corners, size: tuple[int, int]) -> tuple[Array, Array]:
        """Parameters and poses."""
        if np.isnan(self.values).any():
            parameters, poses = first_guess(self.model, corners, size)
            if np.isnan(self.values[:4]).all():
                return np.where(np.isnan(self.values) | (self.values == 0), parameters, self.values), poses
            parameters = np.where(np.isnan(self.values), parameters, self.values)
        else:
            parameters = self.values
        return parameters, poses_of(corners, (corners.pixels - parameters[2:4]) / parameters[:2])

    def after(self, found: Bundle) -> tuple[Array, Array]:
        """Parameters and poses to start from once another set of coefficients, not of a fisheye, was fitted."""
        before = dict(zip(found.model.names, found.parameters, strict=True))
        values = np.array([before.get(name, 0.0) for name in self.model.names])
        return np.where(self.free, values, self.values), found.poses


def _chosen(
    corners: Corners, size: tuple[int, int], known: dict[str, Any]
) -> tuple[str, tuple[str, ...], tuple[Candidate, ...], Bundle]:
    """Model and coefficients that `model_choice.best` takes, all on the corners that the fullest Brown model keeps.

    A candidate starts from the one before; a fisheye, and what does not converge from there, from the corners.
    """
    fullest = max((c for c in CANDIDATES if c[0] == "brown"), key=lambda c: len(c[1]))
    # What is known of k5 says nothing about a model without it.
    possible = [c for c in CANDIDATES if set(known) <= set(MODELS[c[0]].names)]
    settings = {c: _Setting.of(MODELS[c[0]], c[1], known) for c in possible}
    tried: list[tuple[Candidate, Bundle | None]] = []
    before: Bundle | None = None
    reason = ""
    for candidate in sorted(possible, key=lambda c: c != fullest):
        setting = settings[candidate]
        with suppress(InputError):
            fit = partial(_fitted, corners, setting, setting.start(corners, size))
            before, used = without_outliers(corners, fit)
            break
    else:
        used = np.ones(corners.m, dtype=bool)
    if before is not None and before.model.name == "fisheye":
        before = None
    for (name, coefficients), setting in settings.items():
        found: Bundle | None = None
        if before is not None and name != "fisheye":
            with suppress(InputError):
                found = _fitted(corners, setting, setting.after(before), used, None)
        if found is None or not found.converged:
            try:
                found = _fitted(corners, setting, setting.start(corners, size), used, None)
            except InputError as error:
                reason = str(error)
        if found is None or not found.converged:
            tried.append((Candidate(name, coefficients, float("inf"), float("inf")), None))
            continue
        rms = float(np.sqrt(np.mean(found.residuals[used] ** 2)))
        tried.append((Candidate(name, coefficients, criterion(found), rms), found))
        before = found if name != "fisheye" else before
    candidates = tuple(candidate for candidate, _ in tried)
    if (chosen := best(candidates)) is None:
        raise InputError(
            "No camera model fits the corners: are `image_size`, the points of the board and the pixels those of the "
            f"same pictures? {reason}"
        )
    found = dict(tried)[chosen]
    assert found is not None
    return chosen.model, chosen.coefficients, candidates, found


def _fitted(
    corners: Corners,
    setting: _Setting,
    start: tuple[Array, Array],
    used: NDArray[np.bool_],
    before: Bundle | None,
    weights: Array | None = None,
) -> Bundle:
    at = start if before is None else (before.parameters, before.poses)
    try:
        return adjust(setting.model, corners, at, free=setting.free, used=used, weights=weights, prior=setting.prior)
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"The model {setting.model.name!r} does not fit the corners: they look farther to the side than it can "
            "describe (try 'fisheye' or 'auto'), or those of one picture lie on a line."
        ) from error


def _findings(bundle: Bundle, corners: Corners, pattern: Pattern, automatic: bool) -> list[Finding]:
    """What a user has to know before trusting the result."""
    found = []
    deviations = np.sqrt(np.diag(bundle.covariance))
    of = dict(zip(bundle.model.names, zip(bundle.parameters, deviations, bundle.free, strict=True), strict=True))
    focal, sd, free = of["fx"]
    if free and sd > UNCERTAIN * focal:
        found.append(Finding("camera.focal_uncertain", "caution", {"share": sd / focal}))
    small = [
        {"name": name, "value": value, "std": sd}
        for name, (value, sd, free) in of.items()
        if free and name not in LINEAR and abs(value) < SMALL * sd
    ]
    if small and not automatic:
        found.append(Finding("camera.coefficients_near_zero", "caution", {"coefficients": small}))
    left_out = int((~bundle.used).sum())
    if left_out > 0.02 * corners.m:
        found.append(Finding("camera.corners_left_out", "caution", {"count": left_out, "n": corners.m}))
    if pattern.found:
        values = {"share": pattern.share, "model": bundle.model.name}
        found.append(Finding("camera.residual_pattern", "caution", values))
    return found


def _checked_size(image_size: Any, corners: Corners) -> tuple[int, int]:
    """(width, height), once the corners lie in a picture of that size."""
    try:
        width, height = (int(value) for value in image_size)
    except (TypeError, ValueError) as error:
        raise InputError(f"Expected `image_size` to be (width, height) in pixels, got {image_size!r}.") from error
    low, high = corners.pixels.min(axis=0), corners.pixels.max(axis=0)
    if width <= 0 or height <= 0 or low.min() < -1 or high[0] > width or high[1] > height:
        swapped = " Are width and height swapped?" if high[0] <= height and high[1] <= width else ""
        raise InputError(
            f"Expected the corners to lie within `image_size`, {width} x {height} pixels; they span u {low[0]:.0f} to "
            f"{high[0]:.0f}, v {low[1]:.0f} to {high[1]:.0f}.{swapped}"
        )
    return width, height
