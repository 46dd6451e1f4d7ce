"""The pictures of the live page and of stored results in the README and in docs/how-to/live.md.

    python docs/figures/live.py [FOLDER] [NAME ...]

Writes live.png (a session with a wrong pose), live_start.png (an empty one), live_phone.png (dark, 390 pixels wide),
view.png (a stored result with touches) and view_rig.png to FOLDER, docs/images if left out. A simulated cell: an arm
by its kinematics, a board, and pictures of it. Needs viser, Chromium with its driver, and Selenium (extra `test`).
"""

from __future__ import annotations

import base64
import io
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

import uq_handeye as uq
from uq_handeye.calibration.evidence.touches import Touches
from uq_handeye.core.geometry.se3 import Array, inverse
from uq_handeye.core.presentation.page import FLAGS, find_browser
from uq_handeye.use.live_session.api import live
from uq_handeye.use.live_session.view import view_page

sys.path.insert(0, str(Path(__file__).parent))
from shown import png, visible_words

SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars", "--ignore-gpu-blocklist")
DESK, PHONE = (1280, 800), (390, 844)
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.08mm"), camera=("0.05deg", "0.3mm"))
COLUMNS, ROWS, SQUARE = 10, 7, 0.03
FOCAL, SIZE = 620.0, (640, 480)


def board() -> Array:
    """Picture of the board, 2 pixels for each mm, with a white border."""
    squares = (np.indices((ROWS, COLUMNS)).sum(axis=0) % 2 * 255).astype(np.uint8)
    return np.pad(np.kron(squares, np.ones((60, 60), np.uint8)), 60, constant_values=255)


def pictures(views: Array, folder: Path) -> None:
    """Write what the camera sees of the board, its middle at the origin of the target."""
    K = np.array([[FOCAL, 0, SIZE[0] / 2], [0, FOCAL, SIZE[1] / 2], [0, 0, 1]])
    source = board()
    half = 0.5 * SQUARE * np.array([COLUMNS, ROWS])
    on_board = np.array([[SQUARE / 60, 0, -half[0] - SQUARE], [0, SQUARE / 60, -half[1] - SQUARE], [0, 0, 1]])
    for k, T in enumerate(views):
        H = K @ np.column_stack([T[:3, 0], T[:3, 1], T[:3, 3]]) @ on_board
        seen = cv2.warpPerspective(source, H, SIZE, borderValue=140)
        cv2.imwrite(str(folder / f"picture_{k:02d}.png"), cv2.GaussianBlur(seen, (3, 3), 0))


def cell(n: int = 18, seed: int = 4) -> uq.PosePairs:
    """A UR5e that looks at a board before it from ``n`` sides."""
    X = np.eye(4)
    X[:3, 3] = 0.0, -0.06, 0.05
    W = np.array([[0.0, -1, 0, 0.42], [1, 0, 0, 0.0], [0, 0, 1, 0.0], [0, 0, 0, 1]])
    return uq.simulate(n, noise=NOISE, X=X, W=W, distance=("0.36m", "0.52m"), tilt="28deg", roll="70deg", seed=seed)


@contextmanager
def browser(size: tuple[int, int]) -> Iterator[Any]:
    """A browser of that many pixels, with software WebGL."""
    options = webdriver.ChromeOptions()
    options.binary_location = str(find_browser())
    with tempfile.TemporaryDirectory() as profile:
        for flag in (*(flag for flag in FLAGS if flag != "--disable-gpu"), *SOFTWARE, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
        try:
            metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
            driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
            yield driver
        finally:
            driver.quit()


def shot(driver: Any, url: str, then: str = "") -> bytes:
    """Return the page as PNG once it has been drawn, without the note on software WebGL."""
    driver.get(url)
    time.sleep(5.0)
    close = "document.querySelectorAll('.mantine-Notification-closeButton').forEach(b => b.click());"
    driver.execute_script(close + then)
    time.sleep(3.0)
    data = driver.execute_cdp_cmd("Page.captureScreenshot", {"format": "png"})["data"]
    return png(Image.open(io.BytesIO(base64.b64decode(data))), visible_words(driver))


def session(folder: Path, n: int = 14) -> Any:
    """A session of ``n`` poses, one of them wrong."""
    poses = cell()
    camera = np.array(poses.camera)
    camera[9, :3, 3] += 0.006, -0.004, 0.01
    pictures(camera, folder)
    shown = live(folder, tolerance="1mm,0.1deg", port=0, kinematics=uq.Kinematics.from_name("ur5e"))
    for k in range(n):
        shown.session.add(poses.robot[k], camera[k], ask=k >= n - 2)
    while shown.session.fill():
        pass
    return shown


def live_png() -> bytes:
    with tempfile.TemporaryDirectory() as folder, session(Path(folder)) as shown, browser(DESK) as driver:
        return shot(driver, shown.url)


def live_phone_png() -> bytes:
    with tempfile.TemporaryDirectory() as folder, session(Path(folder)) as shown, browser(PHONE) as driver:
        return shot(driver, shown.url + "&darkMode")


def live_start_png() -> bytes:
    with tempfile.TemporaryDirectory() as folder, live(Path(folder), port=0) as shown, browser(DESK) as driver:
        return shot(driver, shown.url)


def touches(result: Any, poses: uq.PosePairs) -> Touches:
    """Five points before the robot that the camera saw and the tool touched, the last one 4 mm off."""
    points = np.array([[0.35, -0.12, 0.0], [0.35, 0.12, 0.0], [0.55, -0.12, 0.0], [0.55, 0.12, 0.0], [0.45, 0.2, 0.05]])
    rng, seen_from = np.random.default_rng(2), poses.robot[[0, 2, 3, 5, 7]]
    at = inverse(seen_from @ poses.truth.X)
    seen = (at @ np.column_stack([points, np.ones(5)])[..., None])[:, :3, 0]
    missed = points + rng.normal(0.0, 3e-4, points.shape)
    missed[4] += 0.003, 0.0, 0.003
    return Touches(seen, missed, seen_from, touch_sd=3e-4, seen_covariance=np.tile(4e-8 * np.eye(3), (5, 1, 1)))


def view_png() -> bytes:
    poses = cell(24)
    result = uq.calibrate(poses, noise=NOISE, kinematics=uq.Kinematics.from_name("ur5e"))
    return _viewed(view_page(result, port=0, touches=touches(result, poses)))


def view_rig_png() -> bytes:
    poses = cell(14)
    apart = {"left": (0.0, 0.0, 0.0), "middle": (0.06, 0.0, 0.0), "right": (0.12, 0.0, 0.0)}
    fixed, tag = np.array([[-1.0, 0, 0, 0.9], [0, 0.6, -0.8, 0.5], [0, -0.8, -0.6, 0.7], [0, 0, 0, 1]]), np.eye(4)
    tag[:3, 3] = 0.0, 0.08, 0.02
    seen = {("cell", "tag"): inverse(fixed) @ poses.robot @ tag}
    for name, shift in apart.items():
        T = np.eye(4)
        T[:3, 3] = shift
        seen[name, "board"] = inverse(poses.truth.X @ T) @ inverse(poses.robot) @ poses.truth.W
    rng, views = np.random.default_rng(3), []
    for pair, T in seen.items():
        T[:, :3, 3] += rng.normal(0.0, 4e-4, (len(T), 3))
        views.append(uq.View(*pair, T))
    on = dict.fromkeys(apart, "arm") | {"cell": "world"}
    rig = uq.Rig({"arm": poses.robot}, on, {"board": "world", "tag": "arm"}, views)
    sizes = dict.fromkeys(on, ("0.05deg", "0.4mm")) | {"arm": ("0.02deg", "0.08mm")}
    return _viewed(view_page(uq.calibrate(rig, noise=sizes), port=0))


def _viewed(page: Any) -> bytes:
    try:
        with browser(DESK) as driver:
            return shot(driver, page.url)
    finally:
        page.close()


PICTURES: dict[str, Callable[[], bytes]] = {
    name.removesuffix("_png"): make for name, make in globals().copy().items() if name.endswith("_png")
}


def main(folder: Path, names: Iterable[str] = PICTURES) -> None:
    """Write the pictures of these names."""
    for name in names:
        (folder / f"{name}.png").write_bytes(PICTURES[name]())


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "images", sys.argv[2:] or PICTURES)
