"""What finished camera poses saw, on the command line: target and camera matrix, from which their noise follows."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ..errors import InputError
from .options import made_of, option
from .pictures import BOARD, LENS, BoardOptions, LensOptions, Pictures, read_length

if TYPE_CHECKING:
    from ..noise.camera_noise import CameraNoise
    from ..noise.estimate import NoisePrior
    from ..noise.models import Noise, PoseNoise
    from ..poses.pose_pairs import PosePairs

# Panel of the help.
VIEWS = "Noise of finished camera poses by what they saw"
# Of `shared_errors.camera_noise`, written down once more to be quick.
INTRINSICS = ("estimated", "pinhole", "exact")


@dataclass(frozen=True)
class ViewOptions:
    """The camera, as the command line says."""

    camera_matrix: Annotated[
        str | None,
        option(
            "--camera-matrix",
            metavar="FX,FY,CX,CY|FILE|DIR",
            panel=VIEWS,
            help="In pixels; camera_info of ROS, a file of OpenCV, JSON with deviations, or the folder of uq-handeye "
            "camera. Beside --board and --square, or --tag: the camera's noise follows from what each pose saw.",
        ),
    ] = None
    tag: Annotated[
        str | None,
        option("--tag", metavar="LENGTH", panel=VIEWS, help="A single tag instead of --board: its side, e.g. 40mm."),
    ] = None
    pixel_noise: Annotated[
        str | None,
        option("--pixel-noise", metavar="PIXELS", panel=VIEWS, help="Of the corners, e.g. 0.2px. Left out: estimated."),
    ] = None

    @property
    def given(self) -> list[str]:
        """Names of the options that were given."""
        return [f"--{name.replace('_', '-')}" for name, value in vars(self).items() if value is not None]


@dataclass(frozen=True)
class Views:
    """Target and camera of finished poses."""

    board: BoardOptions
    options: ViewOptions
    intrinsics: str | None  # estimated, exact, or None: as the camera says

    def beside(
        self, poses: "PosePairs", noise: "Noise | None", prior: "NoisePrior | None"
    ) -> "CameraNoise | PoseNoise":
        """The noise of the poses, beside what is known of the robot's."""
        from ..noise.models import PoseNoise

        if prior is not None and prior.camera is not None:
            raise InputError("Give either the noise of the camera or --camera-matrix, from which it follows.")
        if noise is not None and (not isinstance(noise, PoseNoise) or noise.camera is not None):
            raise InputError(
                "Beside --camera-matrix the noise given is that of the robot alone, --robot-noise or [robot]: the "
                "camera's follows from what it saw."
            )
        if poses.camera_calibration is not None:
            raise InputError("The folder of uq-handeye camera has the camera's noise: leave out --camera-matrix.")
        camera = self.noise(poses)
        return camera if noise is None else PoseNoise(noise.robot, camera)

    def noise(self, poses: "PosePairs") -> "CameraNoise":
        """That of the camera, from what it saw."""
        from ..shared_errors.camera_noise import camera_noise

        if self.options.camera_matrix is None:
            given = ", ".join([*self.board.given, *self.options.given]) or "--intrinsics"
            raise InputError(f"{given}: give --camera-matrix, too.")
        return camera_noise(
            poses,
            self._points(),
            _camera(self.options.camera_matrix),
            self.intrinsics,
            pixel_sd=self.options.pixel_noise,
        )

    @property
    def focal_length_px(self) -> float | None:
        """Of the camera matrix, the mean of both."""
        if self.options.camera_matrix is None:
            return None
        camera = _camera(self.options.camera_matrix)
        if isinstance(camera, list):
            return float(0.5 * (camera[0] + camera[1]))
        values = getattr(camera, "values", None) or camera.intrinsics
        fx, fy = (value[0] if isinstance(value, tuple) else value for value in (values["fx"], values["fy"]))
        return float(0.5 * (fx + fy))

    def _points(self) -> Any:
        tag, board = self.options.tag, self.board
        if tag is not None:
            if board.given:
                raise InputError(f"Give either --tag or {', '.join(board.given)}: a tag has four corners.")
            from ..camera.board import tag_points

            return tag_points(read_length(tag, "--tag"))
        if board.file is not None:
            from ..camera.files.board_file import read_board_points

            return read_board_points(board.file)
        if board.board is None or board.square is None:
            raise InputError("--camera-matrix needs what was seen: --board 9x6 --square 20mm, or --tag 40mm.")
        return board.read().points


def _camera(text: str) -> Any:
    """Numbers, or what a file or folder says."""
    if (path := Path(text)).is_dir():
        from ..camera.files.folder import read_camera

        return read_camera(path)
    parts = text.split(",")
    if len(parts) == 4:
        try:
            return [float(part) for part in parts]
        except ValueError:
            pass
    from ..camera.files.intrinsics_file import read_intrinsics

    if not path.exists():
        raise InputError(f"Expected --camera-matrix to be FX,FY,CX,CY in pixels, a file or a folder, got {text!r}.")
    return read_intrinsics(path)


def intrinsics_of(text: str | None) -> str | None:
    """One of `INTRINSICS`."""
    if text is not None and text not in INTRINSICS:
        raise InputError(
            f"Beside --camera-matrix expected --intrinsics to be one of {', '.join(INTRINSICS)}, got {text!r}; a file "
            "with deviations goes to --camera-matrix itself."
        )
    return text


@made_of(board=BoardOptions, options=ViewOptions)
def views_of(
    board: "BoardOptions",
    options: "ViewOptions",
    intrinsics: Annotated[
        str | None,
        option(
            "--intrinsics",
            of=INTRINSICS,
            metavar="NAME",
            panel=LENS,
            help="Of --camera-matrix: estimated from the same pictures, so but without distortion (pinhole), or exact. "
            "Left out: with the deviations that the camera brings, else estimated.",
        ),
    ] = None,
) -> Views | None:
    """What the options say was seen, or None."""
    if not board.given and not options.given and intrinsics is None:
        return None
    return Views(board, options, intrinsics_of(intrinsics))


@made_of(board=BoardOptions, lens=LensOptions, options=ViewOptions)
def pictures_of(
    board: "BoardOptions",
    lens: "LensOptions",
    options: "ViewOptions",
    images: Annotated[
        str | None,
        option(
            "--images",
            metavar="'PATTERN'",
            panel=BOARD,
            help="Pictures instead of CAMERA, e.g. 'img/*.png': one per row of ROBOT, in the order of their names.",
        ),
    ] = None,
) -> Pictures | Views | None:
    """The pictures of the options, or what finished poses saw, or None if neither is given."""
    if images is not None:
        if options.given:
            raise InputError(f"{', '.join(options.given)}: for finished camera poses, not for --images; leave it out.")
        return Pictures(images, board, lens)
    if options.given:
        if wrong := [name for name in lens.given if name != "--intrinsics"]:
            raise InputError(f"{', '.join(wrong)}: about pictures, not for --camera-matrix; leave it out.")
        return Views(board, options, intrinsics_of(lens.intrinsics))
    if given := board.given + lens.given:
        raise InputError(f"{', '.join(given)} are about pictures: give --images 'PATTERN', or --camera-matrix, too.")
    return None
