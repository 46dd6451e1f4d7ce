"""A stored result in the browser: the rig as it was calibrated, and how well a point is known that one drags.

The point p is in the base frame. Seen from robot pose k it lies at ``(G_k X)^-1 p`` in camera coordinates (eye-in-hand;
eye-to-hand ``X^-1 p``), where `Calibration.predict` gives its covariance.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...calibration.evidence.touches import Touches
from ...calibration.result import Calibration
from ...core.geometry.se3 import Array, inverse
from ...errors import InputError
from ...model.poses.pose_pairs import PosePairs
from ...rig.result import RigCalibration
from .browser_page import BrowserPage
from .drawing.rig_scene import RigScene
from .drawing.scene import Beside, Scene, touched
from .markup import covered, of_point, of_result, of_rig, preformatted
from .question import Answer
from .server import HOST, PORT


def view_page(
    result: Calibration | RigCalibration, host: str = HOST, port: int = PORT, touches: Touches | Path | None = None
) -> BrowserPage:
    """Return the page of a result, of one camera or of a rig."""
    if isinstance(result, RigCalibration):
        if touches is not None:
            raise InputError("Touches are shown beside the result of one camera, not beside that of a rig.")
        return RigPage(result, host, port)
    return ViewPage(result, host, port, touches)


class ViewPage(BrowserPage):
    """The page of one camera."""

    def __init__(
        self, result: Calibration, host: str = HOST, port: int = PORT, touches: Touches | Path | None = None
    ) -> None:
        poses = result.data
        if not isinstance(poses, PosePairs):
            raise InputError("The result holds no poses to show: it was made of motions, or by an earlier version.")
        found = None if touches is None else touched(result, touches)
        super().__init__(host, port)
        self.result, self.poses = result, poses
        self._answer, self._beside = Answer(poses.n, (), result.excluded, poses, result), Beside(touched=found)
        self._gui.add_html(of_result(result))
        self._words = self._gui.add_html("")
        kept = [k for k in range(poses.n) if k not in result.excluded]
        self._pose: Any = self._gui.add_number("From pose", kept[-1], min=0, max=poses.n - 1, step=1)
        if found is not None:
            with self._gui.add_folder("Touched points"):
                self._gui.add_html(preformatted(found.words))
        with self._gui.add_folder("Checks, and what is included"):
            self._gui.add_html(covered(result))
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
        of_robot: dict[str, Any] = {"robot": self.poses.robot[k]} if self.result.setup == "eye-in-hand" else {}
        try:
            covariance = self.result.predict(seen[:3], **of_robot).covariance
        except InputError as error:
            self._words.content = of_point(point, None, str(error))
            return None
        self._words.content = of_point(point, covariance, f"Seen from pose {k}, {np.linalg.norm(seen[:3]):.3f} m away.")
        return covariance

    def _select(self, pose: int) -> None:
        with self._drawing:
            if self._pose.value != pose:
                self._pose.value = pose
            self._scene.show(self._answer, pose, beside=self._beside)
            self.predict()


class RigPage(BrowserPage):
    """The page of a rig: all cameras, targets and arms, at one moment."""

    def __init__(self, result: RigCalibration, host: str = HOST, port: int = PORT) -> None:
        super().__init__(host, port)
        self.result = result
        self._gui.add_html(of_rig(result))
        self._words = self._gui.add_html("")
        self._scene = RigScene(self._server.viser, result)
        last = len(self._scene.moments) - 1
        self._moment: Any = self._gui.add_slider("Robot pose", 0, max(last, 1), 1, 0)
        self._moment.on_update(lambda _: self._show(int(self._moment.value)))
        self._show(0)

    def _show(self, k: int) -> None:
        with self._drawing, self._server.viser.atomic():
            self._words.content = preformatted(self._scene.show(min(k, len(self._scene.moments) - 1)))
