"""A stored result in the browser: the rig as it was calibrated, and how well a point is known that one drags.

The point p is in the base frame. Seen from robot pose k it lies at ``(G_k X)^-1 p`` in camera coordinates (eye-in-hand;
eye-to-hand ``X^-1 p``), where `Calibration.predict` gives its covariance.
"""

from __future__ import annotations

import threading
import webbrowser
from contextlib import suppress
from typing import Any

import numpy as np

from ..calibration.result import Calibration
from ..errors import InputError
from ..geometry.se3 import Array, inverse
from ..poses.pose_pairs import PosePairs
from .markup import of_point, of_result
from .question import Answer
from .scene import Scene
from .server import HOST, PORT, Server


class ViewPage:
    """The page of one result."""

    def __init__(self, result: Calibration, host: str = HOST, port: int = PORT) -> None:
        poses = result.data
        if not isinstance(poses, PosePairs):
            raise InputError("The result holds no poses to show: it was made of motions, or by an earlier version.")
        self.result, self.poses = result, poses
        self._answer = Answer(poses.n, (), result.excluded, poses, result)
        self._server = Server(host, port)
        self._stop, self._drawing = threading.Event(), threading.Lock()
        gui = self._server.viser.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.set_panel_label("uq-handeye")
        self._summary = gui.add_html(of_result(result))
        self._words = gui.add_html("")
        kept = [k for k in range(poses.n) if k not in result.excluded]
        self._pose: Any = gui.add_number("From pose", kept[-1], min=0, max=poses.n - 1, step=1)
        self._scene = Scene(self._server.viser, self._select)
        self._scene.show(self._answer)
        distance = float(np.median(np.linalg.norm(poses.camera[:, :3, 3], axis=-1)))
        W = result.W if result.W is not None else poses.robot[0] @ result.X @ poses.camera[0]
        start = W if result.setup == "eye-in-hand" else result.X @ poses.camera[kept[-1]]
        self._point = self._server.viser.scene.add_transform_controls(
            "/point", scale=0.25 * distance, disable_rotations=True, position=start[:3, 3]
        )
        self._point.on_update(self._dragged)
        self._pose.on_update(lambda _: self._select(int(self._pose.value)))
        self.predict()

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._server.url

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

    def _dragged(self, event: Any) -> None:
        self.predict()

    def _select(self, pose: int) -> None:
        with self._drawing:
            if self._pose.value != pose:
                self._pose.value = pose
            self._scene.show(self._answer, pose)
            self.predict()

    def open(self) -> None:
        """Open the page in the browser of this machine, where there is one."""
        with suppress(webbrowser.Error):
            webbrowser.open(self.url)

    def wait(self) -> None:
        """Stay until Ctrl-C."""
        while not self._stop.wait(0.5):
            pass

    def close(self) -> None:
        """End the page."""
        self._stop.set()
        self._server.close()
