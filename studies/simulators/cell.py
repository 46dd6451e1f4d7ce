"""An arm with a camera on its hand above a board, as an MJCF model, and what MuJoCo says of its camera.

A MuJoCo camera looks along its -z with y up, so its optical frame is turned by half a turn about x. A picture of W x H
has its principal point in the middle, ((W - 1) / 2, (H - 1) / 2) where the centre of the first pixel is (0, 0), and
``f = H / 2 / tan(fovy / 2)``; ``principalpixel="a b"`` moves it by (-a, -b).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import Array, inverse, pose

SIZE = (640, 480)
FOCAL = 580.0
OFFSET = (20.0, 10.0)  # principalpixel
BOARD = uq.Board(9, 6, 0.025)
BOARD_AT = (0.5, 0.02, -0.3)
RIM_SQUARES = 2  # of white around the squares, in squares in all
CAMERA_AT, CAMERA_EULER_DEG = (0.03, -0.05, 0.06), (187.0, 4.0, 62.0)
NOMINAL_DEG = (0.0, 30.0, 100.0, 50.0, 0.0, 0.0)
SPREAD_RAD = (0.35, 0.3, 0.3, 0.5, 1.2, 0.35)
PICTURES, SEED, MARGIN_PX = 20, 48, 15
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0")
PLACES = ("0 0 0.163", "0 0.138 0", "0 -0.131 0.425", "0 0 0.392", "0 0.127 0", "0 0 0.1")
HALF_BOARD = 0.5 * BOARD.side * (np.array([BOARD.columns, BOARD.rows]) + 1 + RIM_SQUARES)


def model(texture: str = "board.png", offset: tuple[float, float] = (0.0, 0.0)) -> str:
    """Return the MJCF model; ``texture`` is the picture of the board, its rim included."""
    bodies = "".join(
        f'<body name="link_{k}" pos="{at}"><joint name="joint_{k}" axis="{axis}" range="-180 180"/>'
        f'<geom type="sphere" size="0.01" pos="0 0 -9"/>'
        for k, (axis, at) in enumerate(zip(AXES, PLACES, strict=True), 1)
    )
    width, height = SIZE
    pixel = 1e-5  # m, of the sensor
    eye = (
        f'<camera name="eye" pos="{_text(CAMERA_AT)}" euler="{_text(CAMERA_EULER_DEG)}" resolution="{width} {height}" '
        f'sensorsize="{width * pixel} {height * pixel}" focalpixel="{FOCAL} {FOCAL}" principalpixel="{_text(offset)}"/>'
    )
    return f"""<mujoco model="cell">
<visual><global offwidth="{width}" offheight="{height}"/><quality offsamples="8"/><map znear="0.01"/>
<headlight ambient="0.6 0.6 0.6" diffuse="0.3 0.3 0.3" specular="0 0 0"/></visual>
<asset><texture name="board" type="2d" file="{texture}"/>
<material name="board" texture="board" specular="0" shininess="0"/></asset>
<worldbody><geom name="board" type="plane" size="{_text(HALF_BOARD)} 0.1" pos="{_text(BOARD_AT)}" material="board"/>
<body name="foot">{bodies}<site name="flange" pos="0 0.05 0"/>{eye}{"</body>" * len(AXES)}</body>
</worldbody></mujoco>"""


def board_picture(texels: int) -> np.ndarray:
    """Return the board with ``texels`` along a square, its white rim included."""
    i, j = np.indices((BOARD.rows + 1, BOARD.columns + 1))
    squares = np.pad((i + j) % 2, RIM_SQUARES // 2, constant_values=1)
    return np.kron(255 * squares, np.ones((texels, texels))).astype(np.uint8)


def chain() -> uq.Kinematics:
    """Return the arm from the world to the flange, read from the model."""
    return uq.Kinematics.from_mjcf(model(), tip="flange")


def true_X() -> Array:
    """Return flange_T_camera of the optical frame, x right and y down."""
    R = Rotation.from_euler("XYZ", CAMERA_EULER_DEG, degrees=True) * Rotation.from_euler("x", 180, degrees=True)
    return pose(R.as_matrix(), np.array(CAMERA_AT) - [0, 0.05, 0])


def intrinsics(offset: tuple[float, float] = (0.0, 0.0)) -> dict[str, float]:
    """Return what the model says of the camera, in OpenCV's pixels."""
    return {
        "fx": FOCAL, "fy": FOCAL, "cx": 0.5 * (SIZE[0] - 1) - offset[0], "cy": 0.5 * (SIZE[1] - 1) - offset[1],
    }  # fmt: skip


def postures() -> Array:
    """Return joint values (n, 6) in rad at which the whole board is in the picture."""
    arm, rng, X = chain(), np.random.default_rng(SEED), true_X()
    inner = np.array([[x, y, 0] for x in (-1, 1) for y in (-1, 1)]) * [*HALF_BOARD, 0] + BOARD_AT
    found: list[Array] = []
    while len(found) < PICTURES:
        q = np.radians(NOMINAL_DEG) + rng.uniform(-1, 1, (2000, 6)) * SPREAD_RAD
        camera_T_world = inverse(arm.poses(q) @ X)
        at = inner @ camera_T_world[:, :3, :3].mT + camera_T_world[:, None, :3, 3]
        pixels = FOCAL * at[..., :2] / at[..., 2:] + 0.5 * (np.array(SIZE) - 1)
        seen = (at[..., 2] > 0.3).all(axis=1) & (at[..., 2] < 0.9).all(axis=1)
        seen &= ((pixels > MARGIN_PX + 25) & (pixels < np.array(SIZE) - MARGIN_PX - 25)).all(axis=(1, 2))
        seen &= camera_T_world[:, 2, 2] < -np.cos(np.radians(45))
        found += list(np.round(q[seen], 4))
    return np.array(found[:PICTURES])


def _text(values: object) -> str:
    return " ".join(f"{value:.9g}" for value in np.asarray(values).tolist())
