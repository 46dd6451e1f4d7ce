"""Options of camera poses from other programs: target and camera matrix, by which the camera noise is modelled."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..core.files.lines import floats
from ..errors import InputError
from .boards import BoardOptions, read_length
from .options import Options
from .values import one_of

if TYPE_CHECKING:
    from ..core.geometry.se3 import Array
    from ..model.camera.known_intrinsics import KnownIntrinsics
    from ..model.camera.result import CameraCalibration
    from ..model.errors.camera_noise import CameraNoise
    from ..model.errors.key import ErrorKey
    from ..model.errors.models import Noise, PoseNoise
    from ..model.errors.sizes import Size
    from ..model.poses.pose_pairs import PosePairs


# Names of `shared_errors.camera_noise`, repeated here so that help and completion load quickly.
INTRINSICS = ("estimated", "pinhole", "exact")
# Names of `camera.pixel_origin`.
PIXEL_ORIGINS = ("centre", "corner")


@dataclass(frozen=True)
class ViewOptions(Options):
    """Options of the camera that finished poses come from.

    Options (Camera poses from other programs):
      * --camera-matrix MATRIX: Camera matrix fx,fy,cx,cy (px), for finished poses. Also for pictures of a single tag.
        With --board and --square, or --tag, the camera noise follows from the view of each pose. Or a file: camera_info
        of ROS, OpenCV, JSON with standard deviations, or the folder of camera -o. For tags of --bag also raw or
        rectified, the picture in which they were detected. Default there: as the corners fit.
      --tag LENGTH: Side of a single tag, e.g. 40mm, in place of --board; with --images that of the tag to look for.
      --pixel-origin NAME <PIXEL_ORIGINS>: What the detector of the poses has at pixel (0, 0): the centre of the first
        pixel or its corner, as AprilTag's libraries have. Default: centre.
      --pixel-noise PIXELS: Standard deviation of the corners, e.g. 0.2px. Default: estimated.
    """

    camera_matrix: str | None = None
    tag: str | None = None
    pixel_origin: str | None = None
    pixel_noise: str | None = None

    @property
    def from_corner(self) -> bool:
        """Return whether the pixels are counted from the corner of the first one."""
        return self.pixel_origin is not None and one_of(self.pixel_origin, "--pixel-origin", PIXEL_ORIGINS) == "corner"


class Views(NamedTuple):
    """Target and camera of finished camera poses."""

    board: BoardOptions
    options: ViewOptions
    intrinsics: str | None  # estimated, exact, or None: as stated by the camera

    def noise_with(
        self, poses: "PosePairs", noise: "Noise | None", prior: "Mapping[ErrorKey, Size] | None"
    ) -> "CameraNoise | PoseNoise":
        """Return the noise of the poses, with the robot noise if it is given."""
        from ..model.errors.models import PoseNoise

        if any(key.owner == "camera" for key in prior or ()):
            raise InputError(
                "The camera noise follows from the views (--camera-matrix, --pixel-noise). Remove --camera-noise and "
                "--camera-prior, or these."
            )
        if noise is not None and (noise.ITEM == "motion" or noise.sides["camera"] is not None):
            raise InputError(
                "With --camera-matrix, give the noise of the robot only (--robot-noise or [robot]): the camera noise "
                "follows from the camera matrix."
            )
        if poses.camera_calibration is not None:
            raise InputError("The folder of uq-handeye camera holds the camera noise. Remove --camera-matrix.")
        camera = self.noise(poses)
        return camera if noise is None else PoseNoise(noise.sides["robot"], camera)

    def noise(self, poses: "PosePairs") -> "CameraNoise":
        """Compute the camera noise from the views."""
        from ..model.shared_errors.camera_noise import camera_noise

        if self.options.camera_matrix is None:
            given = ", ".join([*self.board.given, *self.options.given]) or "--intrinsics"
            raise InputError(f"{given}: these options need --camera-matrix. Add it.")
        return camera_noise(
            poses,
            self._points(),
            camera_of(self.options.camera_matrix).given,
            self.intrinsics,
            pixel_sd=self.options.pixel_noise,
        )

    def poses_from_centre(self, poses: "PosePairs") -> "PosePairs":
        """Return the poses as they are of pixels that are counted from the centre of the first one."""
        if not self.options.from_corner or self.options.camera_matrix is None:
            return poses
        from ..model.shared_errors.camera_noise import lens_of
        from ..model.shared_errors.pixel_origin import pairs_from_centre

        lens = lens_of(camera_of(self.options.camera_matrix).given)
        return pairs_from_centre(poses, self._points(), lens.model.name, lens.parameters)

    @property
    def focal_length_px(self) -> float | None:
        """Mean focal length of the camera matrix, in pixels."""
        if self.options.camera_matrix is None:
            return None
        values = camera_of(self.options.camera_matrix).values
        return 0.5 * (values["fx"] + values["fy"])

    def _points(self) -> "Array":
        tag, board = self.options.tag, self.board
        if tag is not None:
            if board.given:
                raise InputError(f"Give either --tag or {', '.join(board.given)}: not both.")
            from ..model.camera.description import tag_points

            return tag_points(read_length(tag, "--tag"))
        if board.file is not None and not board.of_kalibr:
            from ..model.camera.board_file import read_board_points

            return read_board_points(board.file)
        if board.pattern is None and not board.of_kalibr and (board.board is None or board.square is None):
            raise InputError("--camera-matrix needs the target: add --board 9x6 --square 20mm, or --tag 40mm.")
        return board.read().points


class CameraMatrix(NamedTuple):
    """Camera of --camera-matrix: as `camera_noise` takes it, and its parameters with the standard deviations given."""

    given: "CameraCalibration | KnownIntrinsics | list[float]"
    values: dict[str, float]
    sd: dict[str, float]
    model: str | None


def camera_of(text: str) -> CameraMatrix:
    """Read a camera matrix: four numbers, a file or a folder."""
    from ..model.camera.intrinsics_file import read_intrinsics
    from ..model.camera.models import LINEAR

    if (path := Path(text)).is_dir():
        from ..model.camera.stored_calibration import read_camera

        found = read_camera(path)
        return CameraMatrix(found, found.intrinsics, found.std, found.model)
    numbers = floats(text.split(","))
    if numbers is not None and len(numbers) == 4:
        return CameraMatrix(numbers, dict(zip(LINEAR, numbers, strict=True)), {}, "pinhole")
    if not path.exists():
        raise InputError(
            f"Expected --camera-matrix to be FX,FY,CX,CY in pixels, a file or a folder (of a --bag also raw or "
            f"rectified), got {text!r}."
        )
    import numpy as np

    known = read_intrinsics(path)
    parts = {name: np.ravel(value).tolist() for name, value in known.values.items()}
    sd = {name: part[1] for name, part in parts.items() if len(part) == 2}
    return CameraMatrix(known, {name: part[0] for name, part in parts.items()}, sd, known.model)


def intrinsics_of(text: str | None) -> str | None:
    """Return one of `INTRINSICS`, or raise `InputError`."""
    if text is not None and text not in INTRINSICS:
        raise InputError(
            f"With --camera-matrix, expected --intrinsics to be one of {', '.join(INTRINSICS)}, got {text!r}. Give a "
            "file of intrinsics to --camera-matrix itself."
        )
    return text


def views_of(board: BoardOptions, options: ViewOptions, intrinsics: str | None = None) -> Views | None:
    """Return target and camera of the options, or None.

    Options (Camera model):
      --intrinsics NAME <INTRINSICS>: Origin of --camera-matrix: estimated (from the same pictures), pinhole (the same,
        without distortion) or exact. Default: the standard deviations of its file, else estimated.
    """
    if not board.given and not options.given and intrinsics is None:
        return None
    return Views(board, options, intrinsics_of(intrinsics))
