r"""The function `calibrate_camera`: intrinsics, camera poses and their joint covariance from corners of a board.

All poses of one camera share the errors of its intrinsics: an error of the focal length moves all of them along the
optical axis. The result therefore holds the joint covariance of the poses: the part of each pose by itself, and the
effect of the intrinsics on all of them (`bundle`, T4b). ``PoseNoise(camera=result.covariance)`` hands it on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.levels import CONTRADICTED, UNUSUAL
from ...core.limits import MAX_FOCAL_SD_SHARE, MIN_POSES
from ...errors import InputError, NotConvergedError, require_type
from ...findings import Finding, warn
from .adjustment.bent_edges import bias
from .adjustment.bundle import Bundle
from .adjustment.criterion import CLEAR_BIC_DIFFERENCE, Candidate
from .adjustment.disc_centres import offset
from .adjustment.initial_guess import unlike_a_board
from .adjustment.model_choice import CANDIDATES, USUAL, Lens, search
from .adjustment.outliers import spoilt, without_outliers
from .adjustment.picture_weights import picture_weights
from .adjustment.setting import Known, Setting
from .board_pattern import BoardPattern, board_pattern_of
from .board_shape import FLAT, MEASURED, BoardShape, polynomial_shape, possible_shapes
from .corners import MIN_CORNERS, Corners, without_pictures
from .given_intrinsics import (
    CAUTION_SD,
    GivenIntrinsics,
    centred,
    finding_of,
    freed,
    given_test,
    opened,
    with_default_deviations,
)
from .models import LINEAR, MODELS
from .residual_pattern import Pattern, pattern_of
from .result import CameraCalibration

# Shifts of corners by bent edges below this are not reported.
MIN_SHIFT_PX = 0.001
# Fits after which the places of discs no longer follow the camera; two or three suffice.
MAX_DISC_ROUNDS = 6
# Relative differences of width and height of the squares below this are not reported.
MIN_STRETCH = 5e-4
# Pixel noise above it is that of corners of another board.
MAX_PIXEL_NOISE_PX = 3.0
# Share of the corners that may be outliers.
MAX_LEFT_OUT_SHARE = 0.02
# Contradiction of given numbers, in standard deviations, below which they are not searched without them.
MAX_AGREEMENT_SD = 2.0
# Pixel noise above which the effect of other numbers may not be linear.
MAX_AGREEMENT_PX = 1.0
# Findings that wrong intrinsics make: they are not reported beside these.
EXPLAINED_BY_GIVEN = (
    "camera.residual_pattern", "camera.board_pattern", "camera.squares_stretched", "camera.corners_left_out",
    "camera.another_board",
)  # fmt: skip


def calibrate_camera(
    corners: Corners,
    image_size: tuple[int, int] | None = None,
    model: str = "auto",
    *,
    coefficients: Sequence[str] | None = None,
    intrinsics: Known | None = None,
    exact: bool = False,
    shape: str | BoardShape = "auto",
) -> CameraCalibration:
    """Intrinsics, poses of the board and their joint covariance, from corners.

    Parameters
    ----------
    corners : Corners
        At least three pictures, with the board tilted in different ways. Those that `detect_board` found (`window`)
        are moved to where they would be if the lens bent no edges, centres of discs (`diameter`) from the centroids
        of their images to the images of the centres; the result has them so.
    image_size : (width, height) or None
        Pixels. None: as the corners have it (`detect_board`).
    model : "pinhole", "brown", "fisheye" or "auto"
        "auto" takes the best of several by BIC, see `model_choice`.
    coefficients : names or None
        Which coefficients of the model are estimated; the others are 0. None: k1, k2, p1, p2 of "brown", all of
        "fisheye".
    intrinsics : {name: value or (value, standard deviation)} or None
        What is known beforehand, e.g. ``{"fx": (1080.0, 2.0), "k1": 0.0}`` from the maker of the camera. A value with a
        standard deviation is a Gaussian prior. Without one, focal lengths have 0.1 % and the centre 0.001 focal
        lengths; coefficients are fixed. The pictures test every number (`given_intrinsics`): those that they
        contradict by 3 standard deviations are estimated in place of the values given, with a caution, and from 5 on
        with a failure.
    exact : bool
        Keep the `intrinsics` as they are, without an error, whatever the pictures say. A contradiction is a caution.
    shape : "auto", "flat", "bow2", "bow3", "bow4", "plane1", "plane2", both as in "bow3+plane2", or BoardShape
        How the board differs from what was meant: height over its plane by polynomials of degree 2, 3 or 4, aspect and
        shear, and degree 2 in the plane; estimated together with the camera. "auto" takes the best by BIC, flat where
        the pictures show no other shape. A `BoardShape` is one that was measured before (`read_board`).

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
    require_type("corners", corners, Corners, "Corners (read_corners, detect_board)")
    size = _checked_size(corners.image_size if image_size is None else image_size, corners)
    known = _known(intrinsics, exact)
    if len(corners.on_board[0]) <= MIN_CORNERS and (open_ones := [name for name in LINEAR if name not in known]):
        raise InputError(
            f"{len(corners.on_board[0])} points, such as the corners of a single tag, do not calibrate a camera: give "
            f"its {', '.join(open_ones)} as `intrinsics` (--camera-matrix)."
        )
    lenses = _lenses(model, coefficients)
    of_board = len(corners.on_board[0]) > MIN_CORNERS
    adjusted = partial(_adjusted, corners, size, lenses, shape)
    about_given, given = list[Finding](), None
    if (of_given := _agreed(adjusted, known, size, exact) if known and of_board else None) is not None:
        found, (bundle, given, about_given) = of_given
    else:
        found = adjusted(opened(known) if known and of_board else known)
        if known and of_board and not centred(found.bundle, known):
            without = {name: value for name, value in opened(known).items() if name not in LINEAR}
            found = _best_of(found, lambda: adjusted(without))
        bundle = found.bundle
        if known:
            bundle, given, about_given = _with_given(found, known, size, exact)
    corners = found.corners
    if not bundle.converged:
        raise NotConvergedError(
            f"The bundle adjustment of the camera did not converge within {bundle.iterations} steps: look at the "
            "corners, or try another `model`.",
            bundle,
        )
    pattern = pattern_of(bundle, corners, size)
    board_pattern = board_pattern_of(bundle, corners)
    findings = [*_findings(bundle, corners, pattern, board_pattern, model == "auto"), *found.moved]
    if bundle.pixel_noise > MAX_PIXEL_NOISE_PX:
        values = {"pixels": bundle.pixel_noise, "board": corners.board.partition(" ")[0].partition("=")[2]}
        findings.insert(0, Finding("camera.another_board", "caution", values))
    findings += _alike(bundle, found.candidates)
    if any(one.code == "camera.given_contradicted" for one in about_given):
        findings = [one for one in findings if one.code not in EXPLAINED_BY_GIVEN]
    findings = about_given + findings
    if found.rejected:
        findings.append(Finding("camera.pictures_left_out", "caution", {"pictures": list(found.rejected)}))
    warn(findings)
    return CameraCalibration(bundle, corners, size, found.candidates, pattern, board_pattern, tuple(findings), given)


class _Adjusted(NamedTuple):
    """A camera by its pictures, and what was done to them."""

    setting: Setting
    bundle: Bundle
    candidates: tuple[Candidate, ...]
    corners: Corners
    rejected: tuple[str, ...]
    moved: tuple[Finding, ...]


def _known(intrinsics: Known | None, exact: bool) -> dict[str, float | tuple[float, float]]:
    """Return the numbers that are given, each with its standard deviation, or alone where it is fixed."""
    given = dict(intrinsics or {})
    return (
        {name: float(np.ravel(value)[0]) for name, value in given.items()} if exact else with_default_deviations(given)
    )


def _adjusted(
    corners: Corners, size: tuple[int, int], lenses: Sequence[Lens], shape: str | BoardShape, known: Known
) -> _Adjusted:
    """Return the best camera for the corners, once wrong pictures and corners are left out."""
    wrong: list[str] = []
    if (bad := unlike_a_board(corners)).any() and corners.n - bad.sum() >= MIN_POSES:
        wrong += np.array(corners.names)[bad].tolist()
        corners = _rejected(corners, bad)
    shapes = _shapes(shape, corners)
    moved: list[Finding] = []
    taken, rounds = np.zeros((corners.m, 2)), 0  # seen centres of discs less the images of their centres
    while True:
        setting, bundle, candidates = search(corners, size, lenses, shapes, known)
        if (bad := spoilt(corners, bundle)).any() and corners.n - bad.sum() >= MIN_POSES:
            wrong += np.array(corners.names)[bad].tolist()
            taken = taken[~bad[corners.picture]]
            corners = _rejected(corners, bad)
        elif corners.window is not None:
            # Once: with the camera found from corners that were moved d changes by less than 0.001 pixels.
            d = bias(bundle, corners)
            moved = _moved(d[corners.window != 0])
            corners = replace(corners, pixels=corners.pixels - d, window=None)
        elif corners.diameter is not None:
            d, rounds = offset(bundle, corners), rounds + 1
            if np.abs(d - taken).max() < MIN_SHIFT_PX or rounds == MAX_DISC_ROUNDS:
                corners = replace(corners, diameter=None)
                break
            corners, taken = replace(corners, pixels=corners.pixels - (d - taken)), d
        else:
            break
    weights, s = picture_weights(bundle, corners), bundle.pixel_noise
    at = bundle.parameters, bundle.poses
    fit = partial(setting.fit, corners, at, weights=weights, pixel_noise=s)
    bundle, _ = without_outliers(corners, fit, bundle)
    return _Adjusted(setting, bundle, candidates, corners, tuple(wrong), tuple(moved))


def _best_of(first: _Adjusted, other: Callable[[], _Adjusted]) -> _Adjusted:
    """Return the second of two cameras if it can be found and its corners fit better."""
    try:
        second = other()
    except (InputError, NotConvergedError):
        return first
    return second if second.bundle.pixel_noise < first.bundle.pixel_noise else first


def _agreed(
    adjusted: Callable[[Known], _Adjusted], known: Known, size: tuple[int, int], exact: bool
) -> tuple[_Adjusted, tuple[Bundle, GivenIntrinsics, list[Finding]]] | None:
    """Return the camera with the numbers given, and what `_with_given` does, where the pictures clearly agree.

    None: they may contradict the numbers, or show a board that is not flat, which could be their doing.
    """
    try:
        found = adjusted(known)
    except (InputError, NotConvergedError):
        return None
    given, bundle = GivenIntrinsics.of(known, exact), found.bundle
    test = given_test(bundle, found.corners, given.values)
    if (
        test is None
        or found.rejected
        or bundle.pixel_noise > MAX_AGREEMENT_PX
        or (~bundle.used).mean() > MAX_LEFT_OUT_SHARE
        or bundle.shape.name not in (FLAT, MEASURED)
        or max(test.sigma, test.half_pixel) >= MAX_AGREEMENT_SD
    ):
        return None
    return found, (bundle, given, [finding_of(test, size, bundle.model.name, exact)])


def _with_given(
    found: _Adjusted, known: Known, size: tuple[int, int], exact: bool
) -> tuple[Bundle, GivenIntrinsics, list[Finding]]:
    """Return the fit with the numbers given, or without those that the pictures contradict, and what they say."""
    given, model = GivenIntrinsics.of(known, exact).values, found.bundle.model.name
    fitted = _fit_known(found, known)
    test = given_test(found.bundle, found.corners, given)
    if test is not None and test.contradicted:
        # Far from the numbers given, along what the pictures hardly determine, they are no sums of linear effects.
        nearby = given_test(replace(fitted, pixel_noise=found.bundle.pixel_noise), found.corners, given)
        test = test if nearby is None or nearby.contradicted else nearby
    finding = None if test is None else finding_of(test, size, model, exact)
    if finding is not None and finding.code == "camera.given_contradicted":
        if exact:  # what wrong numbers leave is noise of these corners
            squares = np.sum(fitted.residuals**2, axis=1) * fitted.weights[found.corners.picture]
            s = float(np.sqrt(squares[fitted.used].sum() / max(fitted.freedom, 1)))
            fitted = _fit_known(found, known, s)
        else:
            known = freed(known, [one["name"] for one in finding.values["contradicted"]])
            fitted = _fit_known(found, known)
    return fitted, GivenIntrinsics.of(known, exact), [] if finding is None else [finding]


def _fit_known(found: _Adjusted, known: Known, pixel_noise: float | None = None) -> Bundle:
    """Return the fit of the same pictures, corners and weights with known numbers."""
    bundle = found.bundle
    coefficients = [n for n, free in zip(bundle.model.names, bundle.free, strict=False) if free and n not in LINEAR]
    setting = Setting.of(bundle.model, coefficients, known, bundle.shape)
    return setting.fit(
        found.corners,
        setting.after(bundle),
        used=bundle.used,
        weights=bundle.weights,
        pixel_noise=bundle.pixel_noise if pixel_noise is None else pixel_noise,
    )


def _lenses(model: str, coefficients: Sequence[str] | None) -> Sequence[Lens]:
    """Models with their free coefficients, out of which the best is taken."""
    if model == "auto":
        if coefficients is not None:
            raise InputError("`coefficients` are those of a model: name the `model`, or leave them to 'auto'.")
        return CANDIDATES
    if model not in MODELS:
        raise InputError(f"Expected `model` to be auto or one of {', '.join(MODELS)}, got {model!r}.")
    return [(model, USUAL[model] if coefficients is None else tuple(coefficients))]


def _shapes(shape: str | BoardShape, corners: Corners) -> Sequence[BoardShape]:
    """Shapes of the board, out of which the best is taken."""
    if isinstance(shape, BoardShape):
        return [shape]
    points, _ = corners.on_board
    return possible_shapes(points) if shape == "auto" else [polynomial_shape(shape, points)]


def _rejected(corners: Corners, bad: NDArray[np.bool_]) -> Corners:
    """Without some pictures, which were taken all the same: of pictures, unlike of a table, their number is known."""
    counted = () if corners.image_size is None else tuple(np.array(corners.names)[bad].tolist())
    return replace(without_pictures(corners, bad), missing=(*corners.missing, *counted))


def _moved(d: Array) -> list[Finding]:
    """Report how far corners (k, 2) were moved, in pixels; nothing where no edge is bent."""
    distance = np.linalg.norm(d, axis=1)
    if distance.max(initial=0.0) < MIN_SHIFT_PX:
        return []
    values = {"largest": float(distance.max()), "rms": float(np.sqrt(np.mean(distance**2)))}
    return [Finding("camera.bent_edges", "note", values)]


def _findings(
    bundle: Bundle, corners: Corners, pattern: Pattern, board_pattern: BoardPattern, automatic: bool
) -> list[Finding]:
    """Return what a user has to know before trusting the result."""
    found = []
    deviations = np.sqrt(np.diag(bundle.covariance))
    of = dict(zip(bundle.names, zip(bundle.parameters, deviations, bundle.free, strict=True), strict=True))
    focal, sd, free = of["fx"]
    if free and sd > MAX_FOCAL_SD_SHARE * focal:
        found.append(Finding("camera.focal_uncertain", "caution", {"share": sd / focal}))
    small = [
        {"name": name, "value": value, "std": sd}
        for name, (value, sd, free) in of.items()
        if free and name in bundle.model.coefficients and value**2 < UNUSUAL.chi_square(1) * sd**2
    ]
    if small and not automatic:
        found.append(Finding("camera.coefficients_near_zero", "caution", {"coefficients": small}))
    left_out = int((~bundle.used).sum())
    if left_out > MAX_LEFT_OUT_SHARE * corners.m:
        found.append(Finding("camera.corners_left_out", "caution", {"count": left_out, "n": corners.m}))
    if pattern.found:
        values = {"share": pattern.share, "model": bundle.model.name, "tried_all": automatic}
        found.append(Finding("camera.residual_pattern", "caution", values))
    elif board_pattern.found:  # a wrong model makes such a pattern, too
        values = {"share": board_pattern.share, "shape": bundle.shape.name}
        found.append(Finding("camera.board_pattern", "caution", values))
    stretch, sd = bundle.board.stretch
    if abs(stretch) > max(MIN_STRETCH, np.sqrt(CONTRADICTED.chi_square(1)) * sd):
        found.append(Finding("camera.squares_stretched", "caution", {"stretch": stretch, "std": sd}))
    return found


def _alike(bundle: Bundle, candidates: Sequence[Candidate]) -> list[Finding]:
    """Return a finding where another model fits as well and has its centre elsewhere: X turns by the difference."""
    of_shape = [one for one in candidates if one.shape == bundle.shape.name and one.centre is not None]
    least = min((one.bic for one in of_shape), default=np.inf)
    chosen = [name for name, free in zip(bundle.model.names, bundle.free, strict=False) if free and name not in LINEAR]
    f, centre = float(bundle.parameters[:2].mean()), bundle.parameters[2:4]
    others = [
        (float(np.linalg.norm(np.array(one.centre) - centre)) / f, one.lens)
        for one in of_shape
        if one.bic < least + CLEAR_BIC_DIFFERENCE and (one.model, list(one.coefficients)) != (bundle.model.name, chosen)
    ]
    sd = float(np.sqrt(np.trace(bundle.covariance[2:4, 2:4]))) / f
    angle, lens = max(others, default=(0.0, ""))
    if sd == 0.0 or angle <= sd:  # an exact centre belongs to the user's model
        return []
    values = {"lens": lens, "angle": angle, "std": sd}
    return [Finding("camera.models_alike", "caution" if angle > CAUTION_SD * sd else "note", values)]


def _checked_size(image_size: tuple[int, int] | None, corners: Corners) -> tuple[int, int]:
    """(width, height), once the corners lie in a picture of that size."""
    try:
        width, height = (int(value) for value in image_size or ())
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
