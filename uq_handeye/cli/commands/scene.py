"""Command ``scene``: camera poses and intrinsics from pictures of a scene without a board."""

from pathlib import Path

from ...core.progress import working
from ..delivery import deliver_camera_poses
from ..messages import progress_wanted, timed
from ..pictures import known_of_scene


def scene_command(
    files: list[str],
    intrinsics: str | None = None,
    mask: Path | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> int:
    """Estimate camera poses from pictures of a scene without a board.

    Examples:
      uq-handeye scene 'img/*.png' -o scene/
      # Then estimate X from the robot poses, which tell the scale
      uq-handeye calibrate robot.csv scene/ -o result/
      # Both in one command; the robot helps to place pictures
      uq-handeye calibrate robot.csv --images 'img/*.png' --scene -o result/

    Estimates the intrinsics and the pose of the camera at each picture, up to
    the scale of the scene, with their joint covariance.

    The scene stands still and has texture. 15 to 20 pictures from different
    sides, tilted about two axes, taken at standstill.

    Arguments:
      files = PICTURES: Pictures, e.g. 'img/*.png'. Picture k, from 0 in the order of the names, belongs to row k of the
        robot poses.

    Options:
      * --intrinsics FILE[,exact]: Known intrinsics of the model brown, as for uq-handeye camera. Default: estimated.
      --mask FILE: Picture that is black where the pictures show the gripper. Default: what stands still in the picture
        is found.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for camera poses, intrinsics and points. It holds camera.csv,
        scene_covariance.npz, scene.json, points.ply and intrinsics.yaml (OpenCV), and takes the place of CAMERA in the
        other commands.
    """
    from ...calibration.by_scene import scene_poses
    from ...read import json_text
    from ...scene.result import to_dict

    with timed("the scene"), working("the scene", progress_wanted()) as say:
        found = scene_poses(files, intrinsics=known_of_scene(intrinsics, None), mask=mask, say=say)
    return deliver_camera_poses(found, lambda: json_text(to_dict(found)), output, as_json, "scene/")
