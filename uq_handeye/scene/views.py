"""Small copies of a few pictures with the points that they show, for the report."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..model.poses.scene_facts import SceneView
from .tracks import Tracks

# Width of the copies, and points that are marked in each at most.
WIDTH_PX, MAX_MARKED = 320, 200


def scene_views(tracks: Tracks, paths: Sequence[Path]) -> tuple[SceneView, ...]:
    """Return copies of the first, the middle and the last picture; ``paths``: files of the pictures of the tracks."""
    from PIL import Image

    found = []
    for k in np.unique(np.linspace(0, len(paths) - 1, 3).round().astype(int)):
        with Image.open(paths[k]) as picture:
            scale = WIDTH_PX / picture.width
            size = WIDTH_PX, max(1, round(scale * picture.height))
            small = picture.convert("RGB").resize(size)
        buffer = io.BytesIO()
        small.save(buffer, "JPEG", quality=60)
        at = tracks.pixels[tracks.of_each_picture[k]]
        at = at[:: max(1, len(at) // MAX_MARKED)]
        jpeg = base64.b64encode(buffer.getvalue()).decode()
        found.append(SceneView(paths[k].name, *size, jpeg, tuple((scale * at).round(1).ravel().tolist())))
    return tuple(found)
