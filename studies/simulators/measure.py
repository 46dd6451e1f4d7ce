"""Measure X from pictures that MuJoCo renders, with the camera that its model states and with usual mistakes.

    python -m pip install mujoco==4.0.0
    MUJOCO_GL=egl python -m studies.simulators.measure        (osmesa without a GPU driver)

writes ``measured.json`` beside this file: the corners of the pictures for the tests, and a line for each case. The
robot's poses follow from the joints by the model itself, so they are exact.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import uq_handeye as uq
from studies.common.scores import errors
from studies.simulators import cell
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.model.camera.adjustment.opencv import opencv
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.corners import Corners

FILE = Path(__file__).with_name("measured.json")
# Texels along a square of the board.
TEXELS = (2, 4, 8, 25, 100)
ROBOT = uq.PoseNoise.isotropic(robot=("0.0005deg", "0.002mm"), camera=None)


def rendered(folder: Path, texels: int, offset: tuple[float, float]) -> tuple[Corners, Array]:
    """Render the pictures; return their corners, and how far MuJoCo's flange is from the chain's (largest number)."""
    import mujoco

    cv2 = opencv()
    cv2.imwrite(str(folder / "board.png"), cell.board_picture(texels))
    (folder / "cell.xml").write_text(cell.model(str(folder / "board.png"), offset), encoding="utf-8")
    of = mujoco.MjModel.from_xml_path(str(folder / "cell.xml"))
    data, q = mujoco.MjData(of), cell.postures()
    poses = cell.chain().poses(q)
    (folder / "img").mkdir()
    apart = []
    with mujoco.Renderer(of, cell.SIZE[1], cell.SIZE[0]) as renderer:
        for k, posture in enumerate(q):
            data.qpos[:] = posture
            mujoco.mj_forward(of, data)
            flange = data.site("flange")
            apart.append(np.abs(np.column_stack([flange.xmat.reshape(3, 3), flange.xpos]) - poses[k, :3]).max())
            renderer.update_scene(data, "eye")
            cv2.imwrite(str(folder / "img" / f"img{k:02d}.png"), renderer.render()[..., ::-1])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return uq.detect_board(str(folder / "img"), cell.BOARD), np.array(apart)


def corner_rms(corners: Corners, offset: tuple[float, float]) -> float:
    """RMS distance (px) of the corners from where the model puts them, the board's four readings tried."""
    camera = cell.intrinsics(offset)
    T = np.linalg.inv(cell.chain().poses(cell.postures()) @ cell.true_X())
    middle = cell.BOARD.points.mean(axis=0)
    found = []
    for sign in (1, -1):
        at = sign * (corners.points - middle) * [1, -1, 1] + cell.BOARD_AT
        seen = (T[corners.row][:, :3, :3] @ at[..., None])[..., 0] + T[corners.row][:, :3, 3]
        pixels = seen[:, :2] / seen[:, 2:] * camera["fx"] + [camera["cx"], camera["cy"]]
        found.append(float(np.sqrt(np.median(np.sum((pixels - corners.pixels) ** 2, axis=1)) / np.log(4))))
    return min(found)


def of_corners(corners: Corners, given: Mapping[str, float] | None, *, exact: bool = True) -> dict[str, Any]:
    """Return X by the program and its error."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        seen = calibrate_camera(
            corners, cell.SIZE, "pinhole", coefficients=(), intrinsics=given, exact=exact and given is not None,
            shape="flat",
        )  # fmt: skip
        robot = cell.chain().poses(cell.postures())
        poses = uq.PosePairs(robot[seen.rows], seen.poses, camera_calibration=seen)
        result = uq.calibrate(poses, noise=uq.PoseNoise(ROBOT.robot, seen.covariance))
    e = errors(result.X, cell.true_X())
    contradicted = [one for one in result.findings if one.code == "camera.given_contradicted"]
    return {
        "mm": 1e3 * float(np.linalg.norm(e[3:])), "deg": float(np.degrees(np.linalg.norm(e[:3]))),
        "d2": float(e @ np.linalg.solve(np.asarray(result.covariance), e)), "usable": result.usable,
        "named": "; ".join([*contradicted[0].values["explanations"]]) if contradicted else "",
    }  # fmt: skip


def main() -> None:
    """Render, measure and write."""
    import mujoco

    table: list[dict[str, Any]] = []
    stored: dict[str, Any] = {"mujoco": mujoco.__version__, "joints": cell.postures().tolist()}
    for texels, offset in [*((one, (0.0, 0.0)) for one in TEXELS), (8, cell.OFFSET)]:
        with TemporaryDirectory() as name:
            corners, apart = rendered(Path(name), texels, offset)
        right, plus = cell.intrinsics(offset), cell.intrinsics((-offset[0], -offset[1]))
        half = {**right, "cx": right["cx"] + 0.5, "cy": right["cy"] + 0.5}
        cases: dict[str, Mapping[str, float] | None] = {"as the model states": right, "estimated": None}
        if texels == 8 and offset == (0.0, 0.0):
            cases["centre at (W / 2, H / 2)"] = half
        if offset != (0.0, 0.0):
            cases |= {"principalpixel with the other sign": plus, "principalpixel left out": cell.intrinsics()}
        for words, given in cases.items():
            line = {
                "texels": texels,
                "offset": offset,
                "camera": words,
                "chain": float(apart.max()),
            }
            line |= {"pictures": len(np.unique(corners.row)), "corner_rms": corner_rms(corners, offset)}
            table.append(line | of_corners(corners, given))
            print(json.dumps(table[-1]))
        if offset != (0.0, 0.0):
            stored["corners"] = {
                "row": corners.row.tolist(), "pixels": np.round(corners.pixels, 3).tolist(),
                "point": np.round(corners.points / cell.BOARD.side).astype(int)[:, :2].tolist(),
            }  # fmt: skip
    stored["table"] = table
    FILE.write_text(json.dumps(stored, separators=(",", ":")) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
