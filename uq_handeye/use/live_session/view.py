"""A stored result in the browser: the calibrated camera, and the uncertainty of a point that the user drags.

A point p in the base frame lies at ``(G_k X)^-1 p`` in camera coordinates, seen from robot pose k (eye-in-hand;
eye-to-hand ``X^-1 p``), where `Calibration.predict` gives its covariance. The result of a rig has a page of its own.
"""

from __future__ import annotations

from functools import singledispatch
from pathlib import Path
from typing import Any

import numpy as np

from ...calibration.evidence.touches import Touches
from ...calibration.result import Calibration
from ...calibration.rig_result import RigCalibration
from ...calibration.stored_result import not_a_result
from ...core.geometry.se3 import Array, inverse
from ...errors import InputError
from ...model.poses.pose_pairs import PosePairs
from .browser_page import BrowserPage
from .markup import of_point, panel
from .question import Answer
from .rig_page import RigPage
from .scene import Extras, Scene, scene_of, touched
from .server import HOST, PORT


@singledispatch
def view_page(result: object, host: str = HOST, port: int = PORT, touches: Touches | Path | None = None) -> BrowserPage:
    """Return the page of a result, of one camera or of several."""
    raise not_a_result(result)


@view_page.register
def _of_camera(
    result: Calibration, host: str = HOST, port: int = PORT, touches: Touches | Path | None = None
) -> BrowserPage:
    return ViewPage(result, host, port, touches)


@view_page.register
def _of_rig(
    result: RigCalibration, host: str = HOST, port: int = PORT, touches: Touches | Path | None = None
) -> BrowserPage:
    if touches is not None:
        raise InputError("Touches are shown with the result of one camera, not with that of a rig.")
    return RigPage(result, host, port)


class ViewPage(BrowserPage):
    """The page of one camera."""

    def __init__(
        self, result: Calibration, host: str = HOST, port: int = PORT, touches: Touches | Path | None = None
    ) -> None:
        poses = result.data
        if not isinstance(poses, PosePairs):
            raise InputError("The result holds no poses to show: it was made of motions, or updated without them.")
        found = None if touches is None else touched(result, touches)
        super().__init__(host, port)
        self.result, self.poses = result, poses
        self._answer, self._extras = (
            Answer(poses.n, (), result.excluded, poses, result), Extras(touched=found, scene=scene_of(poses))
        )  # fmt: skip
        self._gui.add_html(panel("result", result))
        self._words = self._gui.add_html("")
        kept = [k for k in range(poses.n) if k not in result.excluded]
        self._pose: Any = self._gui.add_number("From pose", kept[-1], min=0, max=poses.n - 1, step=1)
        if found is not None:
            with self._gui.add_folder("Touched points"):
                self._gui.add_html(panel("preformatted", found.words))
        with self._gui.add_folder("Checks, and what is included"):
            self._gui.add_html(panel("covered", result))
        self._scene = Scene(self._server.viser, self._select)
        distance = float(np.median(np.linalg.norm(poses.camera[:, :3, 3], axis=-1)))
        W = result.W if result.W is not None else poses.robot[0] @ result.X @ poses.camera[0]
        start = W if result.setup == "eye-in-hand" else result.X @ poses.camera[kept[-1]]
        self._point = self._server.viser.scene.add_transform_controls(
            "/point", scale=0.25 * distance, disable_rotations=True, position=start[:3, 3]
        )
        self._point.on_update(self._moved)
        self._pose.on_update(lambda _: self._select(int(self._pose.value)))
        self._select(kept[-1])

    def _moved(self, _: object) -> None:
        self.predict()

    def predict(self) -> Array | None:
        """Show how well the point is known, and return its covariance (3, 3) in the base frame; None: not known."""
        k = int(self._pose.value)
        at = self.poses.robot[k] @ self.result.X if self.result.setup == "eye-in-hand" else self.result.X
        point = np.asarray(self._point.position, dtype=float)
        seen = inverse(at) @ np.append(point, 1.0)
        robot = self.poses.robot[k] if self.result.setup == "eye-in-hand" else None
        try:
            covariance = self.result.predict(seen[:3], robot=robot).covariance
        except InputError as error:
            self._words.content = of_point(point, None, str(error))
            return None
        self._words.content = of_point(point, covariance, f"Seen from pose {k}, {np.linalg.norm(seen[:3]):.3f} m away.")
        return covariance

    def _select(self, pose: int) -> None:
        with self._drawing:
            if self._pose.value != pose:
                self._pose.value = pose
            self._scene.show(self._answer, pose, extras=self._extras)
            self.predict()
