"""Draw the rendered scenes of the page on calibration without a board.

    python docs/figures/scene.py

Needs the extra `camera`. The scenes are those of `studies.scene`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from studies.scene.pictures import Renderer, as_taken  # noqa: E402
from studies.scene.sessions import session  # noqa: E402
from uq_handeye.model.camera.adjustment.opencv import opencv  # noqa: E402

# Sessions, and the picture of each that is shown.
SHOWN = (("table", 3), ("dull", 7), ("in_hand", 1))
WIDTH, GAP = 420, 8


def main(folder: Path) -> None:
    """Write ``scenes.png`` into a folder."""
    cv2 = opencv()
    parts = []
    for name, k in SHOWN:
        made = session(name)
        grey = as_taken(Renderer(made.camera).picture(made.bodies, k), np.random.default_rng(k))
        height = round(WIDTH * grey.shape[0] / grey.shape[1])
        parts += [
            cv2.resize(grey, (WIDTH, height), interpolation=cv2.INTER_AREA),
            np.full((height, GAP), 255, np.uint8),
        ]
    cv2.imwrite(str(folder / "scenes.png"), np.hstack(parts[:-1]), [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main(ROOT / "docs" / "images")
