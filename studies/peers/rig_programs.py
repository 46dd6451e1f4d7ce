"""Calibrate drawn rigs by one program, in an interpreter that has it: ``python rig_programs.py NAME DRAWS FOUND``.

DRAWS (.npz) has the corners ``pixels`` (draws, cameras, poses, m, 2) of ``points`` (m, 3) on the board, ``grid``, its
inner corners, ``square``, its side (m), ``size`` of the pictures, and the true ``K`` (cameras, 3, 3) and ``dist``
(cameras, 5) for the settings that are told them. FOUND (.npz) receives for each setting of the program the poses
``camera_T_first`` (draws, cameras, 4, 4) in metres, NaN where the program raised. The version is printed.

Nothing but NumPy and the program itself is imported, each as its documentation calls it from corners, without pictures.
"""

from __future__ import annotations

import contextlib
import io
import logging
import sys
import warnings
from collections.abc import Callable, Mapping
from importlib import import_module, metadata
from typing import Any

import numpy as np

Draw = Mapping[str, Any]
Found = Mapping[str, Any]  # by setting: camera_T_first (cameras, 4, 4)


def pose(R: Any, t: Any) -> Any:
    """Return the pose (4, 4) of a rotation matrix and a translation."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.reshape(R, (3, 3)), np.ravel(t)
    return T


def from_first(poses: list[Any]) -> Any:
    """Return camera_T_first (cameras, 4, 4) of camera_T_common."""
    return np.stack([T @ np.linalg.inv(poses[0]) for T in poses])


def opencv(draw: Draw) -> Found:
    """Run ``calibrateMultiview`` of OpenCV 5."""
    cv2: Any = import_module("cv2")
    cameras, poses, _, _ = draw["pixels"].shape
    objects = [np.asarray(draw["points"], np.float32)] * poses
    seen = [[np.asarray(one, np.float32) for one in of] for of in draw["pixels"]]
    sizes = [tuple(int(x) for x in draw["size"])] * cameras
    mask = np.ones((cameras, poses), np.uint8)
    models = np.full(cameras, cv2.CALIB_MODEL_PINHOLE, np.uint8)
    own = np.zeros(cameras, np.int32)
    known = list(draw["K"]), [dist[None].copy() for dist in draw["dist"]]
    found = {}
    for setting, (K, dist), flags in (
        ("default", (None, None), 0), ("intrinsics known", known, cv2.CALIB_USE_INTRINSIC_GUESS),
    ):  # fmt: skip
        _, _, _, Rs, Ts = cv2.calibrateMultiview(
            objects, seen, sizes, mask, models, K, dist, None, None, flagsForIntrinsics=own, flags=flags
        )
        found[setting] = from_first([pose(cv2.Rodrigues(R)[0], t) for R, t in zip(Rs, Ts, strict=True)])
    return found


def vision_calibration(draw: Draw) -> Found:
    """Run ``run_rig_extrinsics`` of vision-calibration."""
    vc, models = import_module("vision_calibration"), import_module("vision_calibration.models")
    points = draw["points"].tolist()
    views = [
        models.RigExtrinsicsView([models.Observation(points, of[k].tolist()) for of in draw["pixels"]])
        for k in range(draw["pixels"].shape[1])
    ]
    dataset = models.RigExtrinsicsDataset(len(draw["pixels"]), views)
    refined = models.RigExtrinsicsCalibrationConfig(rig=models.RigConfig(refine_intrinsics_in_rig_ba=True))
    found = {}
    for setting, config in (("default", None), ("intrinsics refined in the rig", refined)):
        poses = vc.run_rig_extrinsics(dataset, config).cam_se3_rig
        found[setting] = from_first([pose(_matrix(one.rotation_xyzw), one.translation_xyz) for one in poses])
    return found


def _matrix(quaternion: Any) -> Any:
    x, y, z, w = np.asarray(quaternion) / np.linalg.norm(quaternion)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def multical(draw: Draw) -> Found:
    """Run what ``multical calibrate`` runs once the board was found: a ChArUco board with the same inner corners."""
    board_of = import_module("multical.board.charuco").CharucoBoard
    workspace, tables = import_module("multical.workspace"), import_module("multical.tables")
    struct = import_module("structs.struct").struct
    columns, rows = (int(x) for x in draw["grid"])
    square = float(draw["square"])
    board = board_of((columns + 1, rows + 1), square, 0.7 * square)
    # Both number the corners row by row; the board counts from its outer corner, which changes no camera.
    ids = [int(np.argmin(np.linalg.norm(np.asarray(board.points) - p - [square, square, 0], axis=1)))
           for p in draw["points"]]  # fmt: skip
    cameras, poses, _, _ = draw["pixels"].shape
    order = np.argsort(ids)
    size = tuple(int(x) for x in draw["size"])
    options = import_module("multical.config.arguments")
    camera, runtime, optimizer = options.CameraOpts(), options.RuntimeOpts(), options.OptimizerOpts()
    found = {}
    for setting in ("default", "intrinsics known"):
        ws = workspace.Workspace(".")
        ws.names = struct(
            camera=[f"cam{k + 1}" for k in range(cameras)], image=[f"{k}.png" for k in range(poses)], board=["board"]
        )
        ws.boards, ws.image_size = [board], [size] * cameras
        ws.filenames = [[f"{k}.png" for k in range(poses)] for _ in range(cameras)]
        ws.detected_points = [
            [[struct(corners=np.asarray(one[order], np.float32), ids=np.sort(ids))] for one in of]
            for of in draw["pixels"]
        ]
        ws.point_table = tables.make_point_table(ws.detected_points, ws.boards)
        np.random.seed(runtime.seed)  # noqa: NPY002  the generator that multical uses
        if setting == "default":
            # Without its limit of 50 pictures, which fails in 0.4.0 where every picture shows as many corners.
            ws.calibrate_single("standard", camera.intrinsic_error_limit)
        else:
            lens = import_module("multical.camera").Camera
            ws.cameras = [lens(size, K, dist) for K, dist in zip(draw["K"], draw["dist"], strict=True)]
        ws.initialise_poses(exclude_bad_poses=runtime.exclude_bad_poses, pose_error_limit=runtime.pose_error_limit)
        ws.calibrate(
            "calibration", cameras=setting == "default", loss="linear", num_adjustments=optimizer.iter,
            quantile=optimizer.outlier_quantile, outlier_threshold=optimizer.outlier_threshold,
        )  # fmt: skip
        exported = ws.export_json()["camera_poses"]
        first, *others = ws.names.camera
        named = [exported[first], *(exported[f"{name}_to_{first}"] for name in others)]
        found[setting] = from_first([pose(one["R"], one["T"]) for one in named])
    return found


def aniposelib(draw: Draw) -> Found:
    """Run ``CameraGroup.calibrate_rows``, which ``calibrate_videos`` runs once the board was found."""
    cameras, boards = import_module("aniposelib.cameras"), import_module("aniposelib.boards")
    columns, rows = (int(x) for x in draw["grid"])
    board = boards.Checkerboard(columns, rows, square_length=float(draw["square"]))
    ids, size = np.arange(columns * rows), tuple(int(x) for x in draw["size"])
    found = {}
    for setting, options in (
        ("default", {}), ("intrinsics known", {"init_intrinsics": False, "only_extrinsics": True}),
    ):  # fmt: skip
        lenses = zip(draw["K"], draw["dist"], strict=True)
        group = cameras.CameraGroup([
            cameras.Camera(K, dist, size, name=str(k)) for k, (K, dist) in enumerate(lenses, 1)
        ])  # fmt: skip
        seen = [
            [{"framenum": (0, k), "corners": one[:, None].copy(), "ids": ids} for k, one in enumerate(of)]
            for of in draw["pixels"]
        ]
        np.random.seed(0)  # noqa: NPY002  the generator that aniposelib uses
        for rows_of_camera in seen:
            board.fill_points_rows(rows_of_camera)
        group.calibrate_rows(seen, board, verbose=False, **options)
        found[setting] = from_first([camera.get_extrinsics_mat() for camera in group.cameras])
    return found


def caliscope(draw: Draw) -> Found:
    """Run ``calibrate_extrinsics`` of caliscope, with its own intrinsics and with known ones."""
    api, pandas = import_module("caliscope.api"), import_module("pandas")
    columns, rows = (int(x) for x in draw["grid"])
    board = api.Chessboard(rows, columns, 100 * float(draw["square"]))
    size = tuple(int(x) for x in draw["size"])
    count, poses, m, _ = draw["pixels"].shape
    camera, frame, corner = (x.ravel() for x in np.indices((count, poses, m)))
    u, v = draw["pixels"].reshape(-1, 2).T
    x, y, z = draw["points"][corner].T
    points = api.ImagePoints(pandas.DataFrame({
        "sync_index": frame, "cam_id": camera, "frame_index": frame, "frame_time": 0.1 * frame, "object_id": 0,
        "keypoint_id": corner, "img_loc_x": u, "img_loc_y": v, "obj_loc_x": x, "obj_loc_y": y, "obj_loc_z": z,
    }))  # fmt: skip
    known = {
        k: api.CameraData(cam_id=k, size=size, matrix=draw["K"][k], distortions=draw["dist"][k]) for k in range(count)
    }
    own = {
        k: api.calibrate_intrinsics(
            api.ImagePoints(points.df[points.df["cam_id"] == k].reset_index(drop=True)),
            api.CameraData(cam_id=k, size=size),
        ).camera
        for k in range(count)
    }
    rules = api.ConstraintSet.from_chessboard(board)
    found = {}
    for setting, cameras, refine in (("default", own, True), ("intrinsics known", known, False)):
        run = api.calibrate_extrinsics(points, api.CameraArray(cameras), rules, refine_intrinsics=refine)
        volume = run.capture_volume.camera_array.cameras
        found[setting] = from_first([volume[k].transformation for k in range(count)])
    return found


PROGRAMS: dict[str, tuple[Callable[[Draw], Found], str]] = {
    "opencv": (opencv, "opencv-python-headless"),
    "vision-calibration": (vision_calibration, "vision-calibration"),
    "multical": (multical, "multical"),
    "aniposelib": (aniposelib, "aniposelib"),
    "caliscope": (caliscope, "caliscope"),
}


def main(name: str, draws: str, found: str) -> None:
    """Run the program on each draw and write what it found."""
    run, package = PROGRAMS[name]
    with np.load(draws) as file:
        given = dict(file)
    every = given.pop("pixels")
    results: dict[str, list[Any]] = {}
    failures = []
    for k, pixels in enumerate(every):
        try:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                one = run({**given, "pixels": pixels})
        except Exception as error:  # whatever it is, it is this program's, and the draw counts as failed
            failures.append(f"draw {k}: {type(error).__name__}: {error}"[:300])
            continue
        for setting, poses in one.items():
            nothing = np.full((pixels.shape[0], 4, 4), np.nan)
            results.setdefault(setting, [nothing] * len(every))[k] = poses
    arrays: dict[str, Any] = {setting: np.array(poses) for setting, poses in results.items()}
    np.savez(found, **arrays)
    print(metadata.version(package))
    print("\n".join(failures), file=sys.stderr)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)  # here only: a process that imports this module keeps its messages
    main(*sys.argv[1:])
