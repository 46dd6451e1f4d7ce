"""Sessions without a board: a camera on a hand looks at a scene, or a fixed one at an object in the hand.

A session has the truth (X, lens, poses), robot poses with noise, and the bodies that its pictures show; `rendered`
writes the pictures and the robot's file into a folder, `simulated_tracks` makes the tracks of points without pictures.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common.pictures import Camera
from studies.scene.pictures import Body, Face, Renderer, as_taken, box, dull, rich, tiles, weak
from uq_handeye.core.geometry.se3 import Array, inverse, perturb, pose
from uq_handeye.model.camera.adjustment.opencv import opencv

SIZE = (1280, 960)
ROBOT_SD_RAD, ROBOT_SD_M = np.radians(0.02), 5e-5
# Metres per texel of the textures.
TEXEL = 5e-4
TABLE = (1.5, 1.2)
# Centre and size of the table's boxes, height last, and their turns in degrees.
BOXES = (
    (-0.24, -0.14, 0.16, 0.12, 0.10, 20),
    (0.22, -0.18, 0.10, 0.14, 0.16, -35),
    (0.02, 0.17, 0.22, 0.10, 0.07, 5),
    (-0.30, 0.16, 0.09, 0.09, 0.13, 50),
    (0.30, 0.14, 0.12, 0.10, 0.05, -15),
)
MOVED = 0  # the box that is moved
STEP = 0.05  # metres that it is moved by


@dataclass(frozen=True)
class Kind:
    """Kind of a session; the defaults are a table with boxes and 20 pictures."""

    n: int = 20
    lens: str = "base"
    texture: str = "rich"
    boxes: bool = True
    gripper: bool = False
    tilt: float = 30.0  # degrees, the largest
    roll: float = 60.0
    axis: str = "all"  # of the rotations: all, tilts (two), one, optical
    distance: tuple[float, float] = (0.5, 0.8)
    noise: float = 2.0  # grey levels
    blurred: float = 0.0  # share of pictures
    moved: bool = False
    wrong: int | None = None  # a robot pose 1.1 degrees and 15 mm off
    shuffled: bool = False
    halves: bool = False
    in_hand: bool = False


KINDS: Mapping[str, Kind] = {
    "table": Kind(),
    "flat": Kind(boxes=False),
    "wide": Kind(lens="wide", distance=(0.35, 0.55)),
    "narrow": Kind(lens="narrow", distance=(0.9, 1.3)),
    "noisy": Kind(noise=10.0),
    "eight": Kind(n=8),
    "twelve": Kind(n=12),
    "sixty": Kind(n=60),
    "weak": Kind(texture="weak"),
    "tiles": Kind(texture="tiles"),
    "blur": Kind(blurred=0.3),
    "moved": Kind(moved=True),
    "wrong": Kind(wrong=6),
    "shuffled": Kind(shuffled=True),
    "gripper": Kind(gripper=True),
    "dull": Kind(texture="dull", gripper=True),
    "halves": Kind(halves=True),
    "in_hand": Kind(in_hand=True),
    "small_motions": Kind(tilt=10.0, roll=20.0),
    "two_axes": Kind(axis="tilts"),
    "optical": Kind(axis="optical"),
    "one_axis": Kind(axis="one"),
}
# f at 1280 px, offset of the centre, k1 k2 p1 p2.
LENSES = {
    "base": (1100.0, (6.0, -4.0), (-0.06, 0.03, 3e-4, -2e-4)),
    "wide": (620.0, (-5.0, 7.0), (-0.18, 0.05, -2e-4, 3e-4)),
    "narrow": (2600.0, (8.0, 5.0), (-0.10, 0.10, 2e-4, 4e-4)),
}


@dataclass(frozen=True, eq=False)
class Session:
    """Truth and measurements. ``row_of`` is the robot row that belongs to each picture."""

    kind: Kind
    setup: str
    camera: Camera
    X: Array
    camera_T_scene: Array  # (n, 4, 4); eye-to-hand: of the object in the hand
    base_T_gripper: Array  # exact
    robot: Array  # with noise
    row_of: NDArray[np.intp]
    bodies: tuple[Body, ...] = field(repr=False)
    seed: int = 0

    def poses(self) -> uq.PosePairs:
        """Return the robot's rows with the exact camera poses, in metres."""
        return uq.PosePairs(self.robot, self.camera_T_scene, self.setup)


def lens(name: str, size: tuple[int, int] = SIZE) -> Camera:
    f, offset, coefficients = LENSES[name]
    scale = size[0] / SIZE[0]
    middle = 0.5 * (np.array(size) - 1) + scale * np.array(offset)
    return Camera("brown", np.array([scale * f, scale * f * 1.0005, *middle, *coefficients, 0, 0, 0, 0]), size)


def session(kind: str | Kind, seed: int = 0, *, size: tuple[int, int] = SIZE, bodies: bool = True) -> Session:
    """Draw X, the places of the camera, the robot's noise and, with ``bodies``, the textures of what is seen."""
    made = KINDS[kind] if isinstance(kind, str) else kind
    rng = np.random.default_rng([50, seed])
    if made.in_hand:
        X, W, G = _watched(rng, made)
        C = inverse(X) @ G @ W
    else:
        X, W, G = _on_hand(rng, made)
        C = inverse(G @ X) @ W
    robot = with_noise(G, rng)
    if made.wrong is not None:
        aside = rng.normal(size=(2, 3))
        aside /= np.linalg.norm(aside, axis=1)[:, None]
        robot[made.wrong] = perturb(robot[made.wrong], np.concatenate([np.radians(1.1) * aside[0], 0.015 * aside[1]]))
    row_of = np.arange(made.n)
    if made.shuffled:
        rng.shuffle(row_of)
    seen = _bodies(np.random.default_rng([51, seed]), made, C[row_of], G[row_of], X) if bodies else ()
    setup = "eye-to-hand" if made.in_hand else "eye-in-hand"
    return Session(made, setup, lens(made.lens, size), X, C[row_of], G, robot, row_of, seen, seed)


def with_noise(G: Array, rng: np.random.Generator, sd_rad: float = ROBOT_SD_RAD, sd_m: float = ROBOT_SD_M) -> Array:
    """Return robot poses with Gaussian noise, independent along all axes."""
    return perturb(G, rng.normal(size=(len(G), 6)) * np.repeat([sd_rad, sd_m], 3))


def about_z(angle: Any) -> Rotation:
    """Return rotations about z by angles in rad."""
    return Rotation.from_rotvec(np.multiply.outer(angle, [0.0, 0.0, 1.0]))


def _on_hand(rng: np.random.Generator, kind: Kind) -> tuple[Array, Array, Array]:
    """X, base_T_scene and base_T_gripper of a camera that looks down at the table's middle."""
    tilted = Rotation.from_rotvec(np.radians(rng.uniform(-12, 12, 3))) * Rotation.from_euler(
        "z", rng.uniform(-180, 180), degrees=True
    )
    X = pose(tilted.as_matrix(), rng.uniform([-0.07, -0.07, 0.03], [0.07, 0.07, 0.10]))
    W = pose(
        Rotation.from_euler("z", rng.uniform(-180, 180), degrees=True).as_matrix(), [0.5, rng.uniform(-0.1, 0.1), 0.03]
    )
    n = kind.n
    tilt, towards = np.radians(kind.tilt) * np.sqrt(rng.uniform(0.05, 1, n)), rng.uniform(0, 2 * np.pi, n)
    roll = np.radians(kind.roll) * rng.uniform(-1, 1, n)
    if kind.axis == "one":
        tilt, towards, roll = np.radians(kind.tilt) * rng.uniform(-1, 1, n), np.zeros(n), np.zeros(n)
    elif kind.axis == "optical":
        tilt = np.zeros(n)
    elif kind.axis == "tilts":
        roll = np.zeros(n)
    rotvec = np.stack([tilt * np.cos(towards), tilt * np.sin(towards), np.zeros(n)], axis=1)
    down = Rotation.from_euler("x", 180, degrees=True)
    R = Rotation.from_rotvec(rotvec) * about_z(roll) * down  # scene_T_camera
    at = np.concatenate([rng.uniform(-0.12, 0.12, (n, 2)), rng.uniform(0, 0.06, (n, 1))], axis=1)
    if kind.halves:
        at[:, 0] += np.where(np.arange(n) < n // 2, -1.0, 1.0)
    away = rng.uniform(*kind.distance, n)
    t = at - away[:, None] * R.as_matrix()[:, :, 2]
    scene_T_camera = np.array([pose(r, v) for r, v in zip(R.as_matrix(), t, strict=True)])
    return X, W, W @ scene_T_camera @ inverse(X)


def _watched(rng: np.random.Generator, kind: Kind) -> tuple[Array, Array, Array]:
    """X = base_T_camera, gripper_T_object and base_T_gripper of a fixed camera that looks at an object in the hand."""
    ahead = np.array([[0, 0, -1.0], [1, 0, 0], [0, -1, 0]])  # camera axes in the base: it looks along -x
    X = pose(
        Rotation.from_rotvec(np.radians(rng.uniform(-15, 15, 3))).as_matrix() @ ahead,
        [1.25, rng.uniform(-0.1, 0.1), 0.45],
    )
    held = pose(Rotation.from_rotvec(rng.uniform(-0.3, 0.3, 3)).as_matrix(), [0.01, -0.02, 0.16])
    n = kind.n
    turn = Rotation.from_euler("ZYX", np.radians(rng.uniform([-35, -35, -60], [35, 35, 60], (n, 3))))
    base = Rotation.from_matrix(X[:3, :3])
    # The hand points down, a corner of the box towards the camera.
    along = base * turn * Rotation.from_euler("x", -65, degrees=True) * about_z(np.radians(35))
    at = np.stack([rng.uniform(-0.14, 0.14, n), rng.uniform(-0.10, 0.10, n), rng.uniform(0.55, 0.75, n)], axis=1)
    centre = at @ X[:3, :3].T + X[:3, 3]
    object_pose = np.array([pose(r, c) for r, c in zip(along.as_matrix(), centre, strict=True)])
    return X, held, object_pose @ inverse(held)


def _bodies(rng: np.random.Generator, kind: Kind, C: Array, G: Array, X: Array) -> tuple[Body, ...]:
    if kind.in_hand:
        return _in_hand(rng, C, G, X)
    makers = {"rich": rich, "weak": weak, "tiles": tiles, "dull": dull}
    texture: Any = makers[kind.texture]
    long, wide = (3.4, 1.2) if kind.halves else TABLE
    table = Face(
        np.array([-long / 2, -wide / 2, 0]), np.array([long, 0, 0]), np.array([0, wide, 0]),
        texture(rng, (int(wide / TEXEL), int(long / TEXEL))),
    )  # fmt: skip
    still: list[Face] = [table]
    bodies = []
    if kind.boxes:
        for k, (x, y, a, b, height, turn) in enumerate(BOXES):
            c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
            places = [-1.0, 1.0] if kind.halves else [0.0]
            for place in places:
                corner = [x + place - 0.5 * (c * a - s * b), y - 0.5 * (s * a + c * b), 0]
                faces = box(corner, [a, b, height], _sides(rng, texture, (a, b, height)), turn=np.radians(turn))
                if kind.moved and k == MOVED:
                    step = np.zeros((len(C), 3))
                    step[len(C) // 2 :, 0] = STEP
                    T = np.array([M @ pose(np.eye(3), v) for M, v in zip(C, step, strict=True)])
                    bodies.append(Body(faces, T))
                else:
                    still += faces
    bodies.append(Body(still, C))
    if kind.gripper:
        fingers = []
        for side in (-1, 1):
            corner = [0.055 * side - 0.02, 0.035, 0.10]
            fingers += box(corner, [0.04, 0.03, 0.12], _sides(rng, rich, (0.04, 0.03, 0.12), texel=1e-4), bottom=True)
        bodies.append(Body(fingers, np.broadcast_to(np.eye(4), C.shape)))
    return tuple(bodies)


def _in_hand(rng: np.random.Generator, C: Array, G: Array, X: Array) -> tuple[Body, ...]:
    """A textured box in the hand, a forearm whose motion is another, and a wall and a table that stand still."""
    size = (0.18, 0.14, 0.26)
    held = Body(box([-s / 2 for s in size], size, _sides(rng, rich, size), bottom=True), C)
    # The forearm ends at the wrist and turns half as far as the hand.
    R = Rotation.from_matrix(G[:, :3, :3])
    middle = R[0]
    half = np.array([(middle * Rotation.from_rotvec(0.5 * (middle.inv() * r).as_rotvec())).as_matrix() for r in R])
    arm = np.array([pose(r, t) for r, t in zip(half, G[:, :3, 3], strict=True)])
    limb = (0.10, 0.10, 0.40)
    forearm = Body(box([-0.05, -0.05, -0.45], limb, _sides(rng, weak, limb), bottom=True), inverse(X) @ arm)
    camera_T_base = np.broadcast_to(inverse(X), C.shape)
    wall = Face(np.array([-1.0, -2.0, -0.5]), np.array([0, 4.0, 0]), np.array([0, 0, 2.5]), rich(rng, (1250, 2000)))
    floor = Face(np.array([-1.0, -2.0, -0.5]), np.array([3.0, 0, 0]), np.array([0, 4.0, 0]), rich(rng, (2000, 1500)))
    return held, forearm, Body([wall, floor], camera_T_base)


def _sides(rng: np.random.Generator, texture: Any, size: Any, texel: float = TEXEL) -> list[NDArray[np.uint8]]:
    """Return six textures: rows follow the second edge of a face, columns the first."""
    x, y, z = (max(int(length / texel), 40) for length in size)
    return [texture(rng, shape) for shape in ((y, x), (z, x), (z, y), (z, x), (z, y), (y, x))]


def rendered(made: Session, folder: Path, *, suffix: str = ".png") -> list[Path]:
    """Write ``img/*.png`` and ``robot.csv`` into ``folder``; return the pictures."""
    cv2 = opencv()
    (folder / "img").mkdir(parents=True, exist_ok=True)
    kind, renderer = made.kind, Renderer(made.camera)
    rng = np.random.default_rng([52, made.seed])
    n = kind.n
    smeared = set(rng.permutation(n)[: int(np.rint(kind.blurred * n))].tolist())
    scale = made.camera.size[0] / SIZE[0]
    paths = []
    for i in range(n):
        smear = scale * float(rng.uniform(8, 14)) if i in smeared else 0.0
        grey = renderer.picture(made.bodies, i)
        paths.append(folder / "img" / f"img{i:02d}{suffix}")
        cv2.imwrite(str(paths[-1]), as_taken(grey, rng, noise=kind.noise, smear=smear))
    (folder / "robot.csv").write_text(robot_csv(made.robot), encoding="utf-8")
    return paths


def rendered_right(made: Session, folder: Path) -> Array:
    """Write pictures of a second camera on the hand into ``folder``; return left_T_right of the two."""
    cv2 = opencv()
    folder.mkdir(parents=True, exist_ok=True)
    between = perturb(np.eye(4), np.array([0.02, 0.12, -0.03, 0.06, 0.005, 0.01]))
    camera = lens(made.kind.lens, made.camera.size)
    parameters = camera.parameters * np.array([0.93, 0.93, 1.005, 0.995, *[1.0] * 8])
    renderer, rng = Renderer(replace(camera, parameters=parameters)), np.random.default_rng([53, made.seed])
    bodies = [replace(body, camera_T_body=inverse(between) @ body.camera_T_body) for body in made.bodies]
    for i in range(made.kind.n):
        taken = as_taken(renderer.picture(bodies, i), rng, noise=made.kind.noise)
        cv2.imwrite(str(folder / f"img{i:02d}.png"), taken)
    return between


def robot_csv(robot: Array) -> str:
    quaternions = Rotation.from_matrix(robot[:, :3, :3]).as_quat()
    rows = np.concatenate([robot[:, :3, 3], quaternions], axis=1)
    return "x,y,z,qx,qy,qz,qw\n" + "".join(",".join(f"{value:.9g}" for value in row) + "\n" for row in rows)


@dataclass(frozen=True, eq=False)
class SimulatedTracks:
    """Observations sorted by point: each point is seen in three pictures or more."""

    picture: NDArray[np.intp]  # (N,)
    point: NDArray[np.intp]  # (N,), 0 to m - 1
    pixels: Array  # (N, 2), with noise
    points: Array  # (m, 3), exact, in the scene frame
    exact: Array  # (N, 2)


def simulated_tracks(
    made: Session,
    rng: np.random.Generator,
    *,
    per_picture: int = 130,
    core: float = 0.25,
    tails: float = 0.15,
    tail: float = 0.75,
    wrong: float = 0.0,
    shift: float = 0.0,
) -> SimulatedTracks:
    """Draw points on the scene's surfaces and their pixels, ``per_picture`` of them in a picture on average.

    A feature is recognised over viewing directions of 25 degrees about one of its own and scales of a factor of 1.4,
    in 85 % of the pictures. Errors are Gaussian of ``core`` px with a share of ``tails`` of ``tail`` px; ``wrong`` is
    the share of observations somewhere else, ``shift`` a deviation of whole pictures (px).
    """
    C, size = made.camera_T_scene, np.array(made.camera.size)
    m = 40 * per_picture
    flat = rng.uniform([-0.45, -0.4, 0], [0.45, 0.4, 0], (m, 3))
    if made.kind.boxes and not made.kind.in_hand:
        high = rng.uniform(size=m) < 0.5
        which = rng.integers(len(BOXES), size=m)
        centre, extent = np.array(BOXES)[:, :2][which], np.array(BOXES)[:, 2:5][which]
        on_box = np.concatenate([centre + (rng.uniform(size=(m, 2)) - 0.5) * extent[:, :2], extent[:, 2:]], axis=1)
        flat = np.where(high[:, None], on_box, flat)
    if made.kind.in_hand:
        flat = rng.uniform(-0.5, 0.5, (m, 3)) * [0.18, 0.14, 0.26]
    here = np.einsum("nij,mj->mni", C[:, :3, :3], flat) + C[:, :3, 3]
    pixels = np.stack([made.camera.seen(flat, T) for T in C], axis=1)
    inside = (here[..., 2] > 0.05) & (pixels > 0).all(axis=-1) & (pixels < size - 1).all(axis=-1)
    plain = np.abs(here[..., :2] / here[..., 2:])
    inside &= (plain[..., 0] < 0.75 * size[0] / made.camera.parameters[0]) & (
        plain[..., 1] < 0.75 * size[1] / made.camera.parameters[1]
    )
    # Direction from the point to the camera, in the scene frame.
    eyes = -np.einsum("nji,nj->ni", C[:, :3, :3], C[:, :3, 3])
    ray = eyes[None] - flat[:, None]
    distance = np.linalg.norm(ray, axis=-1)
    ray /= distance[..., None]
    own = rng.integers(len(C), size=m)
    near = np.einsum("mni,mi->mn", ray, ray[np.arange(m), own]) > np.cos(np.radians(25))
    near &= np.abs(np.log(distance / distance[np.arange(m), own][:, None])) < np.log(1.4)
    seen = inside & near & (rng.uniform(size=inside.shape) < 0.85)
    kept = np.flatnonzero(seen.sum(axis=1) >= 3)
    total = np.cumsum(seen[kept].sum(axis=1))
    kept = kept[: int(np.searchsorted(total, per_picture * len(C))) + 1]
    point, picture = np.nonzero(seen[kept])
    exact = pixels[kept][point, picture]
    sd = np.where(rng.uniform(size=len(point)) < tails, tail, core)
    measured = exact + sd[:, None] * rng.normal(size=exact.shape) + shift * rng.normal(size=(len(C), 2))[picture]
    astray = rng.uniform(size=len(point)) < wrong
    measured[astray] += rng.uniform(-40, 40, (int(astray.sum()), 2))
    return SimulatedTracks(picture, point, measured, flat[kept], exact)


def with_kind(kind: str, **changes: Any) -> Kind:
    """Return a kind of `KINDS` with other values."""
    return replace(KINDS[kind], **changes)
