r"""Test of whether tags were detected in the raw or the rectified picture, where a ``camera_info`` has both intrinsics.

With the residuals of the corners r_0 under K and D and r_1 under P, ``g = r_1 - r_0`` is the effect of the wrong lens.
The share of it in r_0,

    a = - sum g r_0 / sum g^2

is 0 for corners of the raw picture and 1 for those of the rectified one, whatever the noise of the corners is. Its
standard error is that of the sums over groups of neighbouring detections, whose errors are alike.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from ...core.presentation.numbers import digits
from ...errors import InputError
from ...model.camera.adjustment.two_minima import both_minima
from ...model.camera.corners import Corners
from ...model.camera.rays import rays
from .camera_info import CameraInfo
from .tags import MAX_CORNER_RESIDUAL_PX, TagTrack, adjusted, corners_of, pixels_off

RAW, RECTIFIED = "raw", "rectified"
WORDS = {RAW: "K and D, of the raw picture", RECTIFIED: "P, of the rectified picture"}
# Fewest detections that decide; fewer give no standard error.
MIN_DETECTIONS = 8
# The largest standard error of the share with which it decides. The share must lie two of them from one half.
MAX_SHARE_SD = 0.2
# Difference of the rays of both lenses, in pixels RMS, below which the wrong one does no harm.
HARMLESS_RAY_DIFFERENCE_PX = 0.3


class Lens(NamedTuple):
    """The intrinsics to use, a note on where they come from, and a warning if they are in doubt."""

    info: CameraInfo
    note: str
    warning: str = ""


def lens_of(track: TagTrack, info: CameraInfo, side: float, given: str | None = None) -> Lens:
    """Return the intrinsics of the picture that the corners lie in; ``given`` says which, None: they decide.

    The second camera of a rectified pair is warned of: X is that of its own centre, not of the first camera's.
    """
    found = _lens_of(track, info, side, given)
    if not found.info.rectified or abs(info.baseline) < 1e-4:  # m: one camera, no pair
        return found
    warning = (
        f"The camera_info of {info.frame} is that of the second camera of a rectified pair (P[3] is not 0): X is the "
        f"pose of this camera, {digits(1e3 * info.baseline, 4)} mm along x of the first one. In the frame of the first "
        "camera X differs by that."
    )
    return found._replace(warning=" ".join(filter(None, (found.warning, warning))))


def _lens_of(track: TagTrack, info: CameraInfo, side: float, given: str | None) -> Lens:
    of = {RAW: replace(info, P=np.zeros(4)), RECTIFIED: info}
    source = "intrinsics of camera_info: "
    if given is not None:
        if given == RECTIFIED and not info.rectified:
            raise InputError(
                "--camera-matrix rectified: the camera_info has no matrix P of a rectified picture. Remove it."
            )
        return Lens(of[given], f"{source}{WORDS[given]}, as given")
    if not info.rectified:
        return Lens(info, f"{source}{WORDS[RAW]}")
    if not info.distorted:
        return Lens(info, f"{source}{WORDS[RECTIFIED]}")
    corners = corners_of(track, side)[1]
    seen = {name: rays(*one.lens(), corners.pixels) for name, one in of.items()}
    if not all(np.isfinite(part).all() for part in seen.values()):  # as those of the rectified one reach farther
        return Lens(info, f"{source}{WORDS[RECTIFIED]}")
    off = np.array([_residuals(corners, one) for one in of.values()])  # (2, n, 8)
    off = off[:, np.abs(off).max(axis=2).min(axis=0) < MAX_CORNER_RESIDUAL_PX]
    fits = np.sqrt(np.sum(off**2, axis=(1, 2)) / max(2 * off.shape[1], 1))  # eight coordinates less six
    fit = dict(zip(of, (f"{value:.2g} px" for value in fits), strict=True))
    chosen = _decided(off)
    taken = chosen or RECTIFIED
    other = RAW if taken == RECTIFIED else RECTIFIED
    note = f"{source}{WORDS[taken]}; the corners fit to {fit[taken]}, with {WORDS[other]}, to {fit[other]}"
    if chosen:
        return Lens(of[taken], note)
    if _apart(seen[RAW], seen[RECTIFIED]) * info.linear()[0] < HARMLESS_RAY_DIFFERENCE_PX:
        return Lens(of[taken], f"{note}, which does not decide; if it was the raw one, give --camera-matrix raw")
    warning = (
        f"The camera_info has D and P, and the corners do not decide whether the tag was detected in the raw picture "
        f"or in the rectified one (they fit to {fit[RAW]} and {fit[RECTIFIED]}). The rectified one was taken (P). If "
        'it was the raw one, give camera_matrix="raw" (--camera-matrix raw).'
    )
    return Lens(of[taken], note, warning)


def _residuals(corners: Corners, info: CameraInfo) -> Array:
    """Return the residuals (n, 8) of the better pose of each detection, pixels."""
    bundle = adjusted(corners, info)
    return pixels_off(corners, bundle, both_minima(bundle, corners).poses[0])


def _decided(off: Array, groups: int = 20) -> str | None:
    """Return the picture that residuals (2, n, 8) of both lenses speak for; None: neither.

    ``groups`` are the groups of neighbouring detections. A share of more than 1/2 below 0 or above 1 says that neither
    lens is right.
    """
    raw, difference = off[0], off[1] - off[0]
    whole = float(np.sum(difference**2))
    if off.shape[1] < MIN_DETECTIONS or not whole > 0.0:
        return None
    share = -float(np.sum(difference * raw)) / whole
    scores = np.sum(difference * (raw + share * difference), axis=1)
    sums = [part.sum() for part in np.array_split(scores, min(groups, len(scores)))]
    error = float(np.sqrt(np.sum(np.square(sums)))) / whole
    from_middle = abs(share - 0.5)
    if error > MAX_SHARE_SD or from_middle < 2.0 * error or from_middle > 1.0:
        return None
    return RAW if share < 0.5 else RECTIFIED


def _apart(one: Array, other: Array) -> float:
    """Return the RMS angle (rad) between rays (m, 3)."""
    one, other = (part / np.linalg.norm(part, axis=1, keepdims=True) for part in (one, other))
    return float(np.sqrt(np.mean(np.sum(np.cross(one, other) ** 2, axis=1))))
