"""The result of a rig in the browser: all arms, cameras and targets at one robot pose, each camera with its ellipsoid.

The world is the base of the first arm, z up, m. A camera or target that an arm carries is at ``B G_k X``, the others at
``X``.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import TYPE_CHECKING

import numpy as np

from ...calibration.report.rig_sections import poses_table
from ...calibration.rig_result import RigCalibration
from ...core.geometry.se3 import Array
from ...core.presentation.colours import AMBER, BLUE, GREEN, ORANGE, PURPLE, SKY, rgb
from ...core.rounding import EPS
from ...model.rig.description import WORLD
from .browser_page import BrowserPage
from .markup import panel
from .nodes import DARK, PALE, Anchor, Colour, Nodes, nice
from .scene import AXES, FRUSTUM, LINE, OF_X
from .server import HOST, PORT

if TYPE_CHECKING:
    import viser

# Colours of the cameras, one after the other.
PALETTE: tuple[Colour, ...] = tuple(map(rgb, (BLUE, AMBER, GREEN, PURPLE, SKY, ORANGE)))
# Sides of their labels, so that those of neighbours keep clear.
ANCHORS: tuple[Anchor, ...] = ("center-right", "bottom-center", "top-left")


# Columns of the table of poses that the panel has room for: frame, sizes of the errors, number of views.
COLUMNS_OF_POSES = (0, 4, 5, 6)


class RigScene:
    """One rig on one page."""

    def __init__(self, server: viser.ViserServer, result: RigCalibration) -> None:
        self.nodes, self.result = Nodes(server), result
        rig = result.rig
        names = (name for arm in rig.arms.values() for name in arm.names)
        self.moments: tuple[Hashable, ...] = tuple(dict.fromkeys(names))
        depths = [np.linalg.norm(view.poses[:, :3, 3], axis=-1) for view in rig.views]
        self._distance = float(np.median(np.concatenate(depths)))
        self._placed = False

    def carriers(self, moment: int) -> dict[str, Array]:
        """Return the poses of the world and of the flanges that are known at a moment, by their names."""
        found = {WORLD: np.eye(4)}
        for name, arm in self.result.rig.arms.items():
            if self.moments[moment] in arm.names:
                k = arm.names.index(self.moments[moment])
                found[name] = self.result.arms[name].base @ arm.poses[k]
        return found

    def show(self, moment: int) -> str:
        """Draw the rig at a robot pose, and return what is shown."""
        result, at, distance = self.result, self.carriers(moment), self._distance
        points = [np.zeros(3)]
        with self.nodes.drawing():
            for name, arm in result.rig.arms.items():
                base = result.arms[name].base
                self.nodes.frame(f"/arms/{name}", base, 0.3 * distance, f"base of {name}")
                self.nodes.axes(f"/flanges/{name}", base @ arm.poses, AXES * distance)
                points += [base[:3, 3], *(base @ arm.poses)[:, :3, 3]]
                if name in at:
                    self._joined(f"/links/{name}", base, at[name], 4)
            cameras = [(name, result.cameras[name], place) for name, place in result.rig.cameras.items() if place in at]
            known = [one.sizes[1] for _, one, _ in cameras if np.isfinite(one.sizes[1])]
            factor = nice(FRUSTUM * distance / max(max(known, default=1.0), EPS))
            for k, (name, one, place) in enumerate(cameras):
                T = at[place] @ one.X
                self.nodes.camera(
                    f"/cameras/{name}", T, 1.6 * FRUSTUM * distance, PALETTE[k % len(PALETTE)], filled=True
                )
                size, (shift, _) = one.sizes[1], result.facts.select("error of pose", one.frame)
                said = f"{name}: {shift.short} {shift.unit}" if np.isfinite(size) else f"{name}: not determined"
                self.nodes.label(f"/cameras/{name}/name", said, np.eye(4), ANCHORS[k % len(ANCHORS)])
                R, S = at[place][:3, :3], one.covariance[3:, 3:]
                if np.isfinite(size):
                    self.nodes.ellipsoid(f"/ellipsoids/{name}", T[:3, 3], R @ S @ R.T, factor, OF_X)
                if place != WORLD:
                    self._joined(f"/mounts/{name}", at[place], T, 1)
                points.append(T[:3, 3])
            for name, place in result.rig.targets.items():
                if place in at:
                    T = at[place] @ result.targets[name].W
                    if any(view.scene for view in result.rig.views if view.target == name):  # its points are not known
                        self.nodes.frame(f"/targets/{name}", T, 0.12 * distance, name)
                    else:
                        self.nodes.board(f"/targets/{name}", T, 0.4 * distance, DARK)
                        self.nodes.label(f"/targets/{name}/name", name, np.eye(4), "top-center")
                    points.append(T[:3, 3])
            if not self._placed:
                self._placed = True
                self.nodes.look_at(np.array(points))
        return f"Robot pose {self.moments[moment]}. Ellipsoids: 1 sigma of the camera's position x {factor}."

    def _joined(self, name: str, one: Array, two: Array, thick: float) -> None:
        ends = np.stack([one[:3, 3], two[:3, 3]])[None]
        self.nodes.lines(name, ends, PALE, thick * LINE * self._distance)


class RigPage(BrowserPage):
    """The page of a rig: all cameras, targets and arms, at one moment."""

    def __init__(self, result: RigCalibration, host: str = HOST, port: int = PORT) -> None:
        super().__init__(host, port)
        self.result = result
        words = f"Rig of {result.rig.words}"
        self._gui.add_html(panel("result", result, words, poses_table(result, result.pairs), COLUMNS_OF_POSES))
        self._words = self._gui.add_html("")
        self._scene = RigScene(self._server.viser, result)
        last = len(self._scene.moments) - 1
        self._moment = self._gui.add_slider("Robot pose", 0, max(last, 1), 1, 0)
        self._moment.on_update(lambda _: self._show(int(self._moment.value)))
        self._show(0)

    def _show(self, k: int) -> None:
        with self._drawing, self._server.viser.atomic():
            self._words.content = panel("preformatted", self._scene.show(min(k, len(self._scene.moments) - 1)))
