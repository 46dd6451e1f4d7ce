"""Scenes drawn at random: other rooms, textures, lenses, sizes, trajectories and robots than those of `sessions`.

    python -m studies.scene.varied [SEED ...]

renders the pictures of each seed into a temporary folder, estimates X in a process of its own, and writes a line of
``varied.json``: error, what is stated, squared distance, CPU seconds and memory. Seeds that are there are left out.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common.pictures import Camera
from studies.scene.measure import memory_mb, scored
from studies.scene.pictures import Body, Face, Picture, Renderer, as_taken, box
from studies.scene.sessions import robot_csv, with_noise
from uq_handeye.core.geometry.se3 import Array, inverse, perturb, pose
from uq_handeye.model.camera.adjustment.opencv import opencv

FILE = Path(__file__).with_name("varied.json")
SIZES = ((640, 480), (800, 600), (1024, 768), (1280, 720), (1280, 960), (1920, 1080))
ROOMS = ("bench", "shelf", "corner", "heap", "flat")
PATHS = ("hemisphere", "hand", "rows")
# Texels along the longest edge of a face at most.
MAX_TEXELS = 2400


@dataclass(frozen=True, eq=False)
class Drawn:
    """A scene that was drawn, with the truth."""

    seed: int
    facts: dict[str, Any]
    camera: Camera
    X: Array
    base_T_gripper: Array  # exact
    robot: Array  # with noise
    bodies: tuple[Body, ...] = field(repr=False)


def draw(seed: int, **fixed: Any) -> Drawn:
    """Draw a scene; ``fixed`` values take the place of drawn ones."""
    rng = np.random.default_rng([53, seed])
    facts = _facts(rng) | fixed
    camera, scale, n = _camera(rng, facts), facts["scale"], facts["n"]
    turn = Rotation.from_rotvec(np.radians(rng.uniform(-25, 25, 3))) * Rotation.from_euler(
        "z", rng.uniform(0, 360), True
    )
    X = pose(turn.as_matrix(), rng.uniform([-0.08, -0.08, 0.02], [0.08, 0.08, 0.14]))
    base_T_scene = pose(Rotation.from_euler("z", rng.uniform(0, 360), True).as_matrix(), rng.uniform(-0.5, 0.5, 3))
    C = _cameras(rng, facts, camera)
    G = base_T_scene @ C @ inverse(X)
    robot = with_noise(G, rng, np.radians(facts["robot_deg"]), 1e-3 * facts["robot_mm"])
    if facts["wrong"]:
        aside = rng.normal(size=(2, 3))
        aside *= np.array([[np.radians(facts["wrong"])], [0.01]]) / np.linalg.norm(aside, axis=1)[:, None]
        robot[n // 3] = perturb(robot[n // 3], aside.ravel())
    still, moving = _room(rng, facts["room"], scale, facts["texture"])
    bodies = [Body(still, inverse(C))]
    step = np.zeros((n, 3))
    if facts["moved"]:
        step[n // 2 :, :2] = facts["moved"] * scale * np.array([0.6, 0.8])
    bodies.append(Body(moving, inverse(C) @ np.array([pose(np.eye(3), v) for v in step])))
    if facts["gripper"]:
        parts: list[Face] = []
        for side in (-1, 1):
            size = (0.03, 0.03, 0.12)
            x = 0.4 * side * 0.16 * camera.size[0] / camera.parameters[0]
            parts += box(
                [x - 0.015, 0.025, 0.10], size, [_paint(rng, shape, "print") for shape in _shapes(size)], bottom=True
            )
        bodies.append(Body(parts, np.broadcast_to(np.eye(4), C.shape)))
    return Drawn(seed, facts, camera, X, G, robot, tuple(bodies))


def _facts(rng: np.random.Generator) -> dict[str, Any]:
    robot = float(np.exp(rng.uniform(np.log(0.005), np.log(0.1))))
    return {
        "n": int(rng.choice([12, 12, 15, 15, 18, 20, 20, 24])),
        "size": SIZES[rng.integers(len(SIZES))],
        "room": ROOMS[rng.integers(len(ROOMS))],
        "path": PATHS[rng.integers(len(PATHS))],
        "texture": str(rng.choice(["mixed", "mixed", "print", "wood", "stone", "faint"])),
        "scale": float(np.exp(rng.uniform(np.log(0.2), np.log(3.0)))),
        "focal": float(rng.uniform(0.6, 1.6)),
        "robot_deg": robot,
        "robot_mm": float(robot * rng.uniform(1, 5)),
        "noise": float(rng.uniform(1, 5)),
        "blur": float(rng.uniform(0.4, 1.1)),
        "smeared": float(rng.choice([0.0, 0.0, 0.15, 0.3])),
        "vignette": float(rng.uniform(0, 0.5)),
        "jpeg": int(rng.choice([0, 75, 90, 95])),
        "exposure": float(rng.uniform(0, 0.15)),
        "gripper": bool(rng.uniform() < 0.25),
        "moved": float(rng.choice([0, 0, 0, 0.15])),  # in scales
        "wrong": float(rng.choice([0, 0, 0, 1.0])),  # deg
    }  # fmt: skip


def _camera(rng: np.random.Generator, facts: dict[str, Any]) -> Camera:
    width, height = facts["size"]
    f = facts["focal"] * width
    wide = min(1.0, 1.0 / facts["focal"]) ** 2
    lens = np.array([rng.uniform(-0.25, 0.08) * wide, rng.uniform(-0.02, 0.06) * wide, *rng.uniform(-1e-3, 1e-3, 2)])
    centre = 0.5 * np.array([width - 1, height - 1]) + 0.02 * width * rng.uniform(-1, 1, 2)
    return Camera("brown", np.array([f, f * rng.uniform(0.999, 1.001), *centre, *lens, 0, 0, 0, 0]), (width, height))


def _cameras(rng: np.random.Generator, facts: dict[str, Any], camera: Camera) -> Array:
    """scene_T_camera (n, 4, 4): it looks at the scene's middle, from above or, of shelf and corner, from the side."""
    n, scale = facts["n"], facts["scale"]
    # half of the picture's height sees 0.45 of the scene
    far = 0.45 * scale * camera.parameters[0] / (0.5 * camera.size[1])
    if facts["path"] == "hemisphere":
        lift, around = np.radians(rng.uniform(0, 45, n)), rng.uniform(0, 2 * np.pi, n)
        roll = np.radians(rng.uniform(-90, 90, n))
    elif facts["path"] == "hand":  # a smooth random walk, as one moves a hand
        steps = np.cumsum(rng.normal(size=(n, 3)), axis=0)
        steps = (steps - steps.mean(axis=0)) / steps.std(axis=0)
        lift, around = np.radians(18) * np.hypot(*steps[:, :2].T), np.arctan2(steps[:, 1], steps[:, 0])
        roll = np.radians(25) * steps[:, 2]
    else:  # rows from side to side
        x = np.linspace(-1, 1, -(-n // 3))
        grid = np.array([(b, a) for k, b in enumerate((-1, 0, 1)) for a in (x if k % 2 else x[::-1])])[:n]
        lift, around = np.radians(28) * np.hypot(*grid.T), np.arctan2(*grid.T)
        roll = np.radians(rng.uniform(-45, 45, n))
    lift = np.minimum(lift, np.radians(50))
    away = np.stack([np.sin(lift) * np.cos(around), np.sin(lift) * np.sin(around), np.cos(lift)], axis=1)
    target = scale * rng.uniform(-0.12, 0.12, (n, 3)) * [1, 1, 0.3]
    distance = far * rng.uniform(0.75, 1.25, n)
    down = Rotation.from_euler("x", 180, degrees=True)
    axis = np.stack([-np.sin(around), np.cos(around), np.zeros(n)], axis=1)
    R = Rotation.from_rotvec(lift[:, None] * axis) * Rotation.from_rotvec(roll[:, None] * [0, 0, 1.0]) * down
    found = np.array([pose(r, t) for r, t in zip(R.as_matrix(), target + distance[:, None] * away, strict=True)])
    if facts["room"] in ("shelf", "corner"):  # the wall's z points to the camera: its y up
        found = pose(Rotation.from_euler("x", 90, degrees=True).as_matrix(), np.zeros(3)) @ found
    return found


# ------------------------------------------------------------------------------------------- rooms


def _room(rng: np.random.Generator, room: str, scale: float, texture: str) -> tuple[list[Face], list[Face]]:
    """Faces that stand still, and those of one box that may move."""
    still: list[Face] = []

    def wall(corner: Any, along: Any, across: Any) -> None:
        a, b = scale * np.asarray(along, float), scale * np.asarray(across, float)
        shape = _shape(float(np.linalg.norm(a)), float(np.linalg.norm(b)), scale)
        still.extend(_patches(Face(scale * np.asarray(corner, float), a, b, _paint(rng, shape, texture))))

    def thing(centre: Any, size: Any, turn: float) -> list[Face]:
        x, y, z = np.asarray(size, float) * scale
        c, s = np.cos(turn), np.sin(turn)
        at = (scale * np.asarray(centre, float) - 0.5 * np.array([c * x - s * y, s * x + c * y, 0])).tolist()
        shapes = [_shape(a, b, scale) for a, b in ((x, y), (x, z), (y, z), (x, z), (y, z), (x, y))]
        return box(at, (x, y, z), [_paint(rng, shape, texture) for shape in shapes], turn=turn, bottom=True)

    if room in ("bench", "heap", "flat"):
        wall([-1, -1, 0], [2, 0, 0], [0, 2, 0])
        count = {"bench": 14, "heap": 9, "flat": 0}[room]
        for _ in range(count):
            size = rng.uniform(0.05, 0.25, 3) * ([1, 1, 0.6] if room == "bench" else [1.2, 1.2, 1.2])
            still += thing([*rng.uniform(-0.5, 0.5, 2), 0], size, rng.uniform(0, np.pi))
        moving = thing([0.1, -0.1, 0], (0.2, 0.15, 0.12), 0.4) if count else []
        return still, moving
    # y of the room is depth, z up; the middle is the origin
    wall([-1, 0.25, -0.8], [2, 0, 0], [0, 0, 1.6])
    if room == "corner":
        wall([-1.0, -1.2, -0.5], [2, 0, 0], [0, 1.45, 0])
        wall([-0.6, -1.2, -0.8], [0, 1.45, 0], [0, 0, 1.6])
        for _ in range(5):
            size = rng.uniform(0.1, 0.3, 3)
            still += thing([rng.uniform(-0.4, 0.5), rng.uniform(-0.4, 0.1), -0.5], size, rng.uniform(0, np.pi))
        return still, thing([0.1, -0.2, -0.5], (0.2, 0.15, 0.2), 0.4)
    for level in (-0.42, -0.08, 0.26):  # boards of a shelf with things on them
        still += thing([0, 0.12, level - 0.03], (1.2, 0.26, 0.03), 0.0)
        for x in np.arange(-0.5, 0.51, 0.14):
            book = (rng.uniform(0.04, 0.13), rng.uniform(0.08, 0.2), rng.uniform(0.1, 0.28))
            still += thing([x, 0.12, level], book, rng.uniform(-0.2, 0.2))
    return still, thing([0.05, -0.1, -0.08], (0.1, 0.1, 0.2), 0.3)


def _patches(face: Face, parts: int = 2) -> list[Face]:
    """Split a rectangle: each part is drawn at its own level of the texture."""
    height, width = (length // parts * parts for length in face.texture.shape)
    h, w, found = height // parts, width // parts, []
    a, b = face.along / parts, face.across / parts
    for i in range(parts):
        for j in range(parts):
            part = np.ascontiguousarray(face.texture[i * h : (i + 1) * h, j * w : (j + 1) * w])
            found.append(Face(face.corner + j * a + i * b, a, b, part))
    return found


def _shape(along: float, across: float, scale: float) -> tuple[int, int]:
    """Rows and columns of the texture of a face (m)."""
    texel = 2.0 * scale / MAX_TEXELS
    return max(int(across / texel), 48), max(int(along / texel), 48)


def _shapes(size: tuple[float, float, float], texel: float = 2e-4) -> list[tuple[int, int]]:
    x, y, z = (max(int(length / texel), 40) for length in size)
    return [(y, x), (z, x), (z, y), (z, x), (z, y), (y, x)]


# ------------------------------------------------------------------------------------------- textures


def _octaves(
    rng: np.random.Generator, shape: tuple[int, int], low: int, high: int, slope: float, stretch: int = 1
) -> Array:
    cv2 = opencv()
    height, width = shape
    found = np.zeros(shape, np.float32)
    for octave in range(low, high):
        rows, columns = max(height >> octave, 2), max((width >> octave) // stretch, 2)
        coarse = rng.standard_normal((rows, columns), dtype=np.float32)
        found += np.float32(slope**octave) * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(found / max(float(found.std()), 1e-6), dtype=float)


def _paint(rng: np.random.Generator, shape: tuple[int, int], texture: str) -> Picture:
    """Return a texture of a kind: print, wood, stone, faint, or one of them at random."""
    kind = str(rng.choice(["print", "wood", "stone", "poster", "plain"])) if texture == "mixed" else texture
    base = float(rng.uniform(90, 190))
    if kind == "wood":
        grain = _octaves(rng, shape, 0, 6, 1.5, stretch=12)
        rings = np.sin(6.0 * _octaves(rng, shape, 5, 9, 1.6, stretch=4))
        grey = base + 11 * grain + 14 * rings + 6 * _octaves(rng, shape, 0, 3, 1.2)
    elif kind == "stone":
        grey = base + 20 * _octaves(rng, shape, 1, 6, 1.3) + 25 * (_octaves(rng, shape, 2, 4, 1.0) > 1.2)
    elif kind == "faint":
        grey = base + 5 * _octaves(rng, shape, 1, 7, 1.3) + 8 * (_octaves(rng, shape, 2, 5, 1.0) > 1.6)
    elif kind == "plain":
        grey = base + 3 * _octaves(rng, shape, 2, 7, 1.3)
    elif kind == "poster":
        grey = base + 40 * np.tanh(4 * _octaves(rng, shape, 4, 8, 1.7)) + 6 * _octaves(rng, shape, 0, 3, 1.2)
    else:
        grey = _page(rng, shape)
    return np.asarray(np.clip(np.rint(grey), 6, 249), np.uint8)


def _page(rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    """Return lines of words in several sizes on paper, as of newspapers and parcels."""
    cv2 = opencv()
    height, width = shape
    page = np.full(shape, int(rng.uniform(190, 235)), np.uint8)
    row = 6
    while row < height:
        size = float(rng.choice([0.35, 0.5, 0.9, 1.8], p=[0.4, 0.3, 0.2, 0.1]))
        row += int(26 * size) + 4
        at = int(rng.integers(0, 40))
        while at < width:
            word = "".join(chr(int(c)) for c in rng.integers(97, 123, rng.integers(2, 10)))
            cv2.putText(page, word, (at, row), cv2.FONT_HERSHEY_DUPLEX, size, int(rng.uniform(20, 90)), 1, cv2.LINE_AA)
            at += int(20 * size * len(word)) + int(14 * size) + int(rng.integers(0, 12))
    return page.astype(np.float32) + 4 * _octaves(rng, shape, 2, 8, 1.4)


# ------------------------------------------------------------------------------------------- pictures


def rendered(made: Drawn, folder: Path) -> list[Path]:
    """Write the pictures and ``robot.csv`` into a folder."""
    cv2 = opencv()
    (folder / "img").mkdir(parents=True, exist_ok=True)
    facts, rng, n = made.facts, np.random.default_rng([54, made.seed]), made.facts["n"]
    renderer = Renderer(made.camera)
    width, height = made.camera.size
    v, u = np.mgrid[:height, :width]
    shade = 1 - facts["vignette"] * ((u / width - 0.5) ** 2 + (v / width - 0.5 * height / width) ** 2) / 0.4
    smeared, paths = set(rng.permutation(n)[: int(facts["smeared"] * n)].tolist()), []
    for i in range(n):
        grey = renderer.picture(made.bodies, i) * shade * rng.uniform(1 - facts["exposure"], 1 + facts["exposure"])
        smear = width / 1280 * float(rng.uniform(5, 14)) if i in smeared else 0.0
        taken = as_taken(np.asarray(grey, np.float32), rng, noise=facts["noise"], blur=facts["blur"], smear=smear)
        path = folder / "img" / (f"{i:03d}.jpg" if facts["jpeg"] else f"{i:03d}.png")
        cv2.imwrite(str(path), taken, [cv2.IMWRITE_JPEG_QUALITY, facts["jpeg"]] if facts["jpeg"] else [])
        paths.append(path)
    (folder / "robot.csv").write_text(robot_csv(made.robot), encoding="utf-8")
    np.save(folder / "X.npy", made.X)
    np.save(folder / "exact.npy", made.base_T_gripper)
    return paths


def of_folder(folder: Path) -> dict[str, Any]:
    """Return the errors of X from pictures in a folder; to be called in a process of its own."""
    X = np.load(folder / "X.npy")
    started = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        try:
            found = uq.scene_poses(sorted((folder / "img").iterdir()), folder / "robot.csv")
            result = uq.calibrate(found.pairs)
        except (uq.InputError, uq.DegenerateMotionError, uq.NotConvergedError) as error:
            return {"refused": str(error), "cpu": time.process_time() - started, "mb": memory_mb()}
        line = {"cpu": time.process_time() - started, "mb": memory_mb()} | scored(result, X)
    line |= {"pictures": found.n, "points": len(found.points)}
    line["noise_px"] = found.facts.pixel_noise
    line["findings"] = [one.code for one in found.findings]
    estimate = result.noise_estimate
    line["sizes"] = {} if estimate is None else {one.name: float(one.size) for one in estimate.components}
    line["lens"] = found.intrinsics
    line["rejected"] = [int(found.rows[k]) for k in np.flatnonzero(result.table.weight < 0.5)] if result.table else []
    return line


def measured(seed: int, folder: Path, **fixed: Any) -> dict[str, Any]:
    """Render a scene into a folder, unless it is there, and return its line."""
    made = draw(seed, **fixed) if not (folder / "X.npy").exists() else None
    if made is not None:
        rendered(made, folder)
        (folder / "facts.json").write_text(
            json.dumps({"seed": seed} | made.facts | {"truth": made.camera.parameters[:8].tolist()})
        )
    command = [sys.executable, "-m", "studies.scene.varied", "--folder", str(folder)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    facts: dict[str, Any] = json.loads((folder / "facts.json").read_text())
    facts.update(json.loads(done.stdout.strip().splitlines()[-1]))
    return facts


def main() -> None:
    """Measure the seeds that are named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--keep", type=Path, help="folder for the pictures")
    parser.add_argument("seeds", nargs="*", type=int)
    options = parser.parse_args()
    if options.folder:
        print(json.dumps(of_folder(options.folder), default=float))
        return
    stored = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else []
    for seed in options.seeds:
        if any(line["seed"] == seed for line in stored):
            continue
        with TemporaryDirectory() as temporary:
            line = measured(seed, Path(temporary) if options.keep is None else options.keep / str(seed))
        stored.append(line)
        FILE.write_text(json.dumps(stored, indent=0, default=float) + "\n", encoding="utf-8")
        print(json.dumps(line, default=float), flush=True)


if __name__ == "__main__":
    main()
