"""Pictures to tracks and a start of the scene, by pycolmap; the only module that imports it.

One thread and fixed seeds: results repeat. COLMAP counts pixels from the corner of the first one, `Tracks` from its
centre, which is half a pixel less.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.files.open import shown
from ..core.geometry.se3 import Array
from ..errors import InputError
from ..model.camera.models import CORNER_PX
from .adjust import Scene
from .lens import Lens
from .tracks import Tracks

# Features of a picture at most, and with weak ones; of more pictures than so many fewer, by the root of their number.
MOST_FEATURES, MOST_WEAK, PICTURES_OF_MOST = 3000, 8192, 40
# Fewer features of a picture are few: weak ones are taken as well.
FEW_FEATURES = 500
# Pictures up to this number are matched each with each; more only with their neighbours.
MAX_EXHAUSTIVE = 80
# Pictures of up to so many pixels are looked at twice as fine: they have few features, and time is no matter.
SMALL_PICTURE = 500_000
# Matches that move by less, in pixels, belong to what stands still in the picture.
STATIONARY_PX = 4.0
# The region that stands still in the pictures: width of its cells, and share of the pictures in which its features do.
CELL_PX, STILL_SHARE = 16, 0.3
# Models of fewer pictures are left.
MIN_MODEL_SIZE = 3
SEED = 0
Say = Callable[[str], None]


def pycolmap() -> ModuleType:
    """Import pycolmap, quiet; raises `InputError` with the line to install it."""
    try:
        import pycolmap as module
    except ImportError:
        raise InputError(
            '--scene needs pycolmap: pip install "uq-handeye[scene]". It has no wheel for Linux on ARM and macOS on '
            "Intel: use a board there."
        ) from None
    module.logging.minloglevel = int(module.logging.FATAL)
    module.set_random_seed(SEED)
    return module


@dataclass(frozen=True, eq=False)
class Model:
    """A scene of some of the pictures, in a frame and unit of its own."""

    rows: NDArray[np.intp]  # numbers of its pictures, ascending
    scene: Scene
    colours: NDArray[np.uint8]  # (m, 3) of the points


@dataclass(frozen=True, eq=False)
class Matched:
    """Features and verified matches of pictures, in a database of COLMAP."""

    folder: Path  # of the database
    root: Path  # of the pictures
    names: tuple[str, ...]  # of the pictures below the root, in their order
    image_size: tuple[int, int]
    features: NDArray[np.intp]  # (n,)
    ids: NDArray[np.intp]  # (n,) of the pictures in the database
    weak: bool  # whether features of low contrast were looked for
    cameras: tuple[int, ...]  # of the database

    @property
    def database(self) -> Path:
        """Path of the database."""
        return self.folder / "scene.db"

    @cached_property
    def verified(self) -> dict[tuple[int, int], int]:
        """Number of verified matches of pairs of pictures."""
        module = pycolmap()
        with _opened(module, self.database) as database:
            pairs, counts = database.read_two_view_geometry_num_inliers()
        return {self._pair(module, pair): int(count) for pair, count in zip(pairs, counts, strict=True)}

    def _pair(self, module: ModuleType, pair: int) -> tuple[int, int]:
        number = {int(id): k for k, id in enumerate(self.ids)}
        first, second = (number[int(id)] for id in module.pair_id_to_image_pair(pair))
        return first, second

    @cached_property
    def keypoints(self) -> list[Array]:
        """Pixels (k, 2) of the features of each picture, as COLMAP counts them."""
        with _opened(pycolmap(), self.database) as database:
            return [np.array(database.read_keypoints(int(id))[:, :2], dtype=float) for id in self.ids]

    def descriptors(self, row: int) -> NDArray[np.uint8]:
        """Descriptors (k, 128) of the features of a picture."""
        with _opened(pycolmap(), self.database) as database:
            return np.array(database.read_descriptors(int(self.ids[row])).data, dtype=np.uint8)

    @cached_property
    def raw(self) -> dict[tuple[int, int], NDArray[np.uint32]]:
        """Matches (k, 2) of the features of pairs of pictures before they are verified."""
        module = pycolmap()
        with _opened(module, self.database) as database:
            pairs, matches = database.read_all_matches()
        found = {self._pair(module, pair): one for pair, one in zip(pairs, matches, strict=True)}
        return {pair: np.asarray(one, dtype=np.uint32) for pair, one in found.items() if len(one)}

    @cached_property
    def stationary(self) -> list[NDArray[np.intp]]:
        """Number of other pictures in which each feature of each picture stands still: the gripper, or drawn text."""
        found = [np.zeros(len(at), dtype=np.intp) for at in self.keypoints]
        for (i, j), matches in self.raw.items():
            move = np.linalg.norm(self.keypoints[i][matches[:, 0]] - self.keypoints[j][matches[:, 1]], axis=-1)
            still = matches[move < STATIONARY_PX]
            found[i][still[:, 0]] += 1  # a match has each feature once
            found[j][still[:, 1]] += 1
        return found

    def stationary_share(self) -> float:
        """Share of what matches that stands still in the picture."""
        still = sum(int(count.sum()) for count in self.stationary) // 2
        return still / max(still + sum(self.verified.values()), 1)

    def still_region(self) -> NDArray[np.bool_] | None:
        """Return where the pictures show what stands still, (height, width); None where nothing does, or most."""
        width, height = self.image_size
        cells = (-(-height // CELL_PX), -(-width // CELL_PX))
        still, every = np.zeros(cells), np.zeros(cells)
        often = max(2.0, STILL_SHARE * (len(self.names) - 1))
        for at, count in zip(self.keypoints, self.stationary, strict=True):
            column, row = np.clip((at / CELL_PX).astype(int), 0, (cells[1] - 1, cells[0] - 1)).T
            np.add.at(every, (row, column), 1.0)
            np.add.at(still, (row, column), count >= often)
        region = (still > 0.5 * every) & (still >= STILL_SHARE * len(self.names))
        if not 0.0 < region.mean() < 0.6:  # no gripper leaves so little: the camera did not move
            return None
        region = np.pad(region, 3, mode="edge")
        # no holes, and a rim for features that reach beyond their centre
        region = ndimage.binary_dilation(ndimage.binary_closing(region, iterations=3))[3:-3, 3:-3]
        return np.asarray(np.kron(region, np.ones((CELL_PX, CELL_PX), bool)))[:height, :width]


@contextmanager
def _opened(module: ModuleType, path: Path) -> Iterator[Any]:
    database = module.Database.open(path)
    try:
        yield database
    finally:
        database.close()


def size_of(path: Path) -> tuple[int, int]:
    """Return width and height of a picture."""
    bitmap = pycolmap().Bitmap.read(str(path), False)
    if bitmap is None:
        raise InputError(f"Cannot use {shown(path)} as a picture of the scene: it cannot be read.")
    return int(bitmap.width), int(bitmap.height)


def match(
    paths: Sequence[Path],
    folder: Path,
    lens: Lens | None,
    mask: Path | None,
    say: Say,
    weak: bool = False,
    counts: Sequence[int] = (),
) -> Matched:
    """Find the features of pictures and match them, in a database in ``folder``.

    ``lens``: known intrinsics; ``mask``: a picture that is black where pictures show what is not the scene; ``weak``:
    take weak features, too, as is done where pictures have few others; ``counts``: numbers of pictures of several
    cameras of unknown lenses, one after the other.

    Raises
    ------
    InputError
        A file that is no picture, or pictures of different sizes.
    """
    module = pycolmap()
    found = features(paths, folder, lens, mask, say, weak, counts)
    if not weak and np.median(found.features) < FEW_FEATURES:
        found = features(paths, folder, lens, mask, say, True, counts)
    names = found.names
    matching, pairing = module.FeatureMatchingOptions(), {}
    matching.num_threads, matching.use_gpu = 1, False
    verification = module.TwoViewGeometryOptions()
    verification.filter_stationary_matches, verification.stationary_matches_max_error = True, STATIONARY_PX
    verification.ransac.random_seed = SEED
    say(f"matching {len(names)} pictures")
    how = module.match_exhaustive
    if len(names) > MAX_EXHAUSTIVE:
        how, options = module.match_sequential, module.SequentialPairingOptions()
        options.overlap, options.quadratic_overlap = 15, False  # neighbours to both sides
        pairing = {"pairing_options": options}
    how(
        found.database,
        matching_options=matching,
        verification_options=verification,
        device=module.Device.cpu,
        **pairing,
    )
    return found


def features(
    paths: Sequence[Path],
    folder: Path,
    lens: Lens | None,
    mask: Path | None,
    say: Say,
    weak: bool,
    counts: Sequence[int] = (),
    image_size: tuple[int, int] | None = None,
) -> Matched:
    """Find the features of pictures, in a database in ``folder``; see `match`.

    ``image_size`` (width, height): that which the pictures must have; None: one of their own.
    """
    module = pycolmap()
    root = Path(os.path.commonpath([path.resolve().parent for path in paths]))
    names = [path.resolve().relative_to(root).as_posix() for path in paths]
    say(f"features of {len(names)} pictures" + (" of weak texture" if weak else ""))
    path = folder / "scene.db"
    for old in folder.glob("scene.db*"):
        old.unlink()
    options = module.FeatureExtractionOptions()
    options.num_threads, options.use_gpu = 1, False
    most = int((MOST_WEAK if weak else MOST_FEATURES) * min(1.0, np.sqrt(PICTURES_OF_MOST / len(names))))
    options.sift.max_num_features = most
    width, height = image_size or size_of(paths[0])
    options.sift.first_octave = -1 if weak or width * height <= SMALL_PICTURE else 0
    if weak:
        options.sift.peak_threshold = 0.0015  # the least contrast
    reading = module.ImageReaderOptions()
    if mask is not None:
        reading.camera_mask_path = mask
    if lens is None:
        reading.camera_model = "SIMPLE_RADIAL"
    else:
        reading.camera_model, reading.camera_params = "OPENCV", ",".join(map(repr, _of_lens(lens).tolist()))
    ends = np.cumsum(counts or [len(names)]).tolist()
    for start, stop in zip([0, *ends], ends, strict=False):
        module.extract_features(
            path,
            root,
            image_names=names[start:stop],
            camera_mode=module.CameraMode.SINGLE,
            reader_options=reading,
            extraction_options=options,
            device=module.Device.cpu,
        )
    with _opened(module, path) as database:
        every = database.read_all_images()
        images = {image.name: int(image.image_id) for image in every}
        if missing := [shown(one) for name, one in zip(names, paths, strict=True) if name not in images]:
            raise InputError(
                f"Cannot use {', '.join(missing[:3])} as a picture of the scene: it cannot be read, or its size is "
                "not that of the first picture. Remove it, with its robot pose."
            )
        ids = np.array([images[name] for name in names], dtype=np.intp)
        _keep_largest(database, ids.tolist(), most)
        number = np.array([database.num_keypoints_for_image(int(id)) for id in ids], dtype=np.intp)
        of = {image.name: int(image.camera_id) for image in every}
        cameras = tuple(dict.fromkeys(of[name] for name in names))
        camera = database.read_camera(cameras[0])
    size = int(camera.width), int(camera.height)
    if image_size not in (None, size):
        got, expected = ("{} x {}".format(*one) for one in (size, image_size or size))
        raise InputError(f"Expected pictures of {expected} pixels, as those of the calibration, got {got}.")
    return Matched(folder, root, tuple(names), size, number, ids, weak, cameras)


def _keep_largest(database: Any, ids: Sequence[int], most: int) -> None:
    """Keep the largest features of each picture: COLMAP fills up an octave beyond the number asked for."""
    if all(database.num_keypoints_for_image(id) <= most for id in ids):
        return
    descriptors = [database.read_descriptors(id) for id in ids]
    database.clear_descriptors()  # they cannot be replaced one by one
    for id, one in zip(ids, descriptors, strict=True):
        features = database.read_keypoints(id)
        if len(features) > most:
            size = np.abs(features[:, 2] * features[:, 5] - features[:, 3] * features[:, 4])  # of the affine shape
            kept = np.sort(np.argsort(-size, kind="stable")[:most])
            one.data = one.data[kept]
            database.update_keypoints(id, features[kept])
        database.write_descriptors(id, one)


def write_mask(region: NDArray[np.bool_], mask: Path | None, path: Path) -> Path:
    """Write a picture that is black in a region (height, width), and where the picture ``mask`` is."""
    from PIL import Image

    kept = ~region
    if mask is not None:
        with Image.open(mask) as picture:
            kept &= np.asarray(picture.convert("L").resize(kept.shape[::-1], Image.Resampling.NEAREST)) > 0
    Image.fromarray(255 * kept.astype(np.uint8)).save(path)
    return path


def models(seen: Matched, lens: Lens | None, say: Say) -> list[Model]:
    """Build scenes from matches, the one of most pictures first; pictures without a common match make several."""
    module = pycolmap()
    options = module.IncrementalPipelineOptions()
    options.num_threads, options.random_seed = 1, SEED
    options.mapper.num_threads, options.mapper.random_seed = 1, SEED
    options.triangulation.random_seed = SEED
    options.min_model_size = MIN_MODEL_SIZE
    # The scene is adjusted again, with its robot: COLMAP's own adjustments may stop early.
    options.ba_global_frames_ratio = options.ba_global_points_ratio = 1.3
    options.ba_global_max_refinements, options.ba_local_max_refinements = 2, 1
    if lens is not None:
        options.ba_refine_focal_length = any(one.free[:2].any() for one in lens.each)
        options.ba_refine_extra_params = any(one.free[4:].any() for one in lens.each)
    done = 0

    def next_picture() -> None:
        nonlocal done
        done += 1
        say(f"placing picture {done + 2}")

    say("placing pictures")
    found = module.incremental_mapping(seen.database, seen.root, seen.folder, options, next_image_callback=next_picture)
    start = Lens.of(seen.image_size) if lens is None else lens
    made = [_model(seen, one, start) for one in found.values() if one.num_reg_images() >= MIN_MODEL_SIZE]
    return sorted((one for one in made if one.scene.tracks.m), key=lambda one: -len(one.rows))


def triangulate(seen: Matched, rows: NDArray[np.intp], poses: Array, lens: Lens, max_error: float) -> Model:
    """Triangulate the points of pictures whose camera poses are known, (r, 4, 4) of the pictures ``rows``.

    ``max_error``: largest residual of an observation, px.
    """
    module = pycolmap()
    options = module.IncrementalPipelineOptions()
    options.num_threads, options.random_seed, options.triangulation.random_seed = 1, SEED, SEED
    options.triangulation.ignore_two_view_tracks = False
    options.triangulation.merge_max_reproj_error = options.triangulation.complete_max_reproj_error = max_error
    options.mapper.filter_max_reproj_error = max_error
    known = module.Reconstruction()
    width, height = seen.image_size
    camera = module.Camera(model="OPENCV", width=width, height=height, params=_of_lens(lens), camera_id=1)
    known.add_camera_with_trivial_rig(camera)
    with _opened(module, seen.database) as database:
        database.update_camera(camera)  # of the same model
    for row, pose in zip(rows, poses, strict=True):
        image = module.Image(name=seen.names[row], camera_id=1, image_id=int(seen.ids[row]))
        known.add_image_with_trivial_frame(image, module.Rigid3d(pose[:3]))
    known = module.triangulate_points(known, seen.database, seen.root, seen.folder, True, options)
    return _model(seen, known, lens)


def _model(seen: Matched, known: Any, lens: Lens) -> Model:
    """Read a reconstruction: pictures in their order, observations of points that two of them see."""
    number = {int(id): k for k, id in enumerate(seen.ids)}
    rows = np.array(sorted(number[int(id)] for id in known.reg_image_ids()), dtype=np.intp)
    picture, point, pixels, poses = [], [], [], []
    for place, row in enumerate(rows):
        image = known.image(int(seen.ids[row]))
        T = np.eye(4)
        T[:3] = image.cam_from_world().matrix()
        poses.append(T)
        for one in image.get_observation_points2D():
            picture.append(place)
            point.append(int(one.point3D_id))
            pixels.append(one.xy)
    numbers = np.unique(np.array(point, dtype=np.int64))
    at = np.array(pixels, dtype=float).reshape(-1, 2) - CORNER_PX
    names = tuple(seen.names[row] for row in rows)
    tracks = Tracks.of(np.array(picture, dtype=np.intp), np.array(point, dtype=np.int64), at, names, seen.image_size)
    points = np.array([known.point3D(int(id)).xyz for id in numbers]).reshape(-1, 3)
    colours = np.array([known.point3D(int(id)).color for id in numbers], dtype=np.uint8).reshape(-1, 3)
    lens = lens.with_each([
        _lens(known.cameras[id], one) if id in known.cameras else one
        for id, one in zip(seen.cameras, lens.each, strict=True)
    ]).of_pictures(rows)  # fmt: skip
    # a track may meet a picture twice: such a point is left out
    twice = np.zeros(tracks.m, dtype=bool)
    same = (np.diff(tracks.point) == 0) & (np.diff(tracks.picture) == 0)
    twice[tracks.point[1:][same]] = True
    scene = Scene(tracks, np.array(poses).reshape(-1, 4, 4), points, lens)
    return Model(rows, scene.where(~twice[tracks.point]), colours[~twice])


def _lens(camera: Any, lens: Lens) -> Lens:
    """Return the lens as a camera of a reconstruction has it."""
    values, of = np.array(lens.values), camera.params
    if camera.model_name == "OPENCV":
        values[:8] = of
        values[2:4] -= CORNER_PX
    else:  # f, cx, cy, k
        values[:5] = of[0], of[0], of[1] - CORNER_PX, of[2] - CORNER_PX, of[3]
    return lens.at(np.where(lens.free, values, lens.values))


def pose_by_points(
    points: Array, pixels: Array, lens: Lens, image_size: tuple[int, int], max_error: float
) -> tuple[Array, NDArray[np.bool_]] | None:
    """Return the camera pose (4, 4) by points (k, 3) of which most are seen at pixels (k, 2), and which are.

    ``max_error``: largest residual, px. None: no pose fits.
    """
    module = pycolmap()
    width, height = image_size
    camera = module.Camera(model="OPENCV", width=width, height=height, params=_of_lens(lens))
    options = module.AbsolutePoseEstimationOptions()
    options.ransac.max_error, options.ransac.random_seed = max_error, SEED
    found = module.estimate_and_refine_absolute_pose(pixels + CORNER_PX, points, camera, options)
    if found is None:
        return None
    T = np.eye(4)
    T[:3] = found["cam_from_world"].matrix()
    return T, np.asarray(found["inlier_mask"], dtype=bool)


def _of_lens(lens: Lens) -> Array:
    """Return fx, fy, cx, cy, k1, k2, p1, p2 with the centre as COLMAP counts it."""
    values = np.array(lens.values[:8])
    values[2:4] += CORNER_PX
    return values
