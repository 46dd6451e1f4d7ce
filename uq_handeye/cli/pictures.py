"""Options of pictures of a board: board, camera model, and the camera poses computed from them.

Options of finished camera poses: target and camera matrix, from which the camera noise is computed.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..core.files.lines import floats
from ..core.runtime.progress import working
from ..errors import InputError
from .messages import LOG, progress_wanted, timed
from .options import Options, metres, one_of

if TYPE_CHECKING:
    from ..model.camera.board import Board
    from ..model.camera.board_shape import BoardShape
    from ..model.camera.corners import Corners
    from ..model.camera.result import CameraCalibration
    from ..model.noise.estimate import NoisePrior
    from ..model.noise.models import CameraNoise, Noise, PoseNoise
    from ..model.poses.pose_pairs import PosePairs


# Names of camera.models.MODELS, and "auto", repeated here so that help and completion load quickly.
MODEL_NAMES = ("auto", "pinhole", "brown", "fisheye")


# Names of camera.description.KINDS.
KINDS = ("chessboard", "charuco", "aprilgrid", "aruco", "apriltag")
TAGS = KINDS[2:]


COEFFICIENT_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


@dataclass(frozen=True)
class BoardOptions(Options):
    """Options of the board.

    Options (Pictures of a board):
      * --board COLSxROWS: Inner corners of a chessboard, e.g. 9x6. Of a ChArUco board the squares, of a grid the tags.
        Or the board.csv of an earlier camera -o, the board as measured; or target.yaml of Kalibr; with --camera-matrix
        also a table of points x,y,z.
      * --square LENGTH: Measured side of a square or tag, e.g. 20mm. Without a unit: metres.
      --pattern NAME <KINDS>: Kind of board: {KINDS}. aprilgrid is that of Kalibr, aruco OpenCV's GridBoard; apriltag,
        or aruco without --board, is a single tag. Default: chessboard, with --marker charuco.
      --spacing GAP: Gap between the tags of a grid, e.g. 6mm; of aprilgrid also as a share of the side, e.g. 0.3.
      --marker LENGTH: Side of a marker, for a ChArUco board.
      --dictionary NAME: Dictionary of the markers, e.g. 5X5_100 or tag25h9. Default: 4X4_50, of AprilTags 36h11.
      --first-id ID: Id of the first tag of a grid (default: 0), or of a single tag (default: any).
    """

    board: str | None = None
    square: str | None = None
    pattern: str | None = None
    spacing: str | None = None
    marker: str | None = None
    dictionary: str | None = None
    first_id: int | None = None

    @property
    def file(self) -> str | None:
        """Table of points that ``--board`` names; raises `InputError` if further options describe the board."""
        if self.board is None or not Path(self.board).suffix:
            return None
        if further := self.given[1:]:
            raise InputError(
                f"{', '.join(further)}: not used with --board {self.board}, which holds all points. Remove the option."
            )
        return self.board

    def shape(self) -> "BoardShape | None":
        """Return the measured board if ``--board`` names a file of points."""
        if self.file is None or self.of_kalibr:
            return None
        from ..model.camera.board_file import read_board

        return read_board(self.file)

    def read(self) -> "Board":
        """Return the board to look for."""
        from ..model.camera.board import Board, board_of

        if self.of_kalibr:
            from ..model.camera.board_file import read_target

            return read_target(str(self.file))
        if self.file is not None:
            from ..model.camera.board_file import read_board_table

            if not (text := read_board_table(self.file).board):
                raise InputError(
                    f"{self.file} does not name the kind of board to look for in pictures. Give a table of corners, or "
                    "add a line such as # board: kind=chessboard columns=9 rows=6 square=0.02 before its header."
                )
            return board_of(text)
        kind = None if self.pattern is None else one_of(self.pattern, "--pattern", KINDS)
        if kind in TAGS:
            return self._tags(str(kind))
        if self.board is None or self.square is None:
            raise InputError("Pictures need --board and --square, e.g. --board 9x6 --square 20mm.")
        for name, value in (("--spacing", self.spacing), ("--first-id", self.first_id)):
            if value is not None:
                raise InputError(f"{name} applies to tags. Add --pattern aprilgrid, aruco or apriltag.")
        columns, rows = read_two_numbers(self.board, "--board", "9x6")
        square = read_length(self.square, "--square")
        if self.marker is None and kind != "charuco":
            if self.dictionary is not None:
                raise InputError("--dictionary applies to a ChArUco board. Add --marker LENGTH. Or to tags: --pattern.")
            return Board(columns, rows, square)
        if kind == "chessboard":
            raise InputError("--marker applies to a ChArUco board. Remove it, or say --pattern charuco.")
        if self.marker is None:
            raise InputError("--pattern charuco needs the side of its markers. Add --marker LENGTH.")
        more: dict[str, Any] = {} if self.dictionary is None else {"dictionary": self.dictionary}
        return Board(columns, rows, square, "charuco", read_length(self.marker, "--marker"), **more)

    @property
    def of_kalibr(self) -> bool:
        """True if ``--board`` names a YAML file."""
        return self.file is not None and Path(self.file).suffix.lower() in (".yaml", ".yml")

    def _tags(self, kind: str) -> "Board":
        """Return a board of tags."""
        from ..model.camera.board import Board

        single = kind == "apriltag" or (kind == "aruco" and self.board is None)
        if self.marker is not None:
            raise InputError(f"--marker applies to a ChArUco board. Of {kind} give the side of a tag as --square.")
        if self.square is None:
            raise InputError(f"--pattern {kind} needs the side of a tag with its black border. Add --square LENGTH.")
        if self.board is None and not single:
            raise InputError(f"--pattern {kind} needs the number of tags. Add --board COLSxROWS, e.g. --board 6x6.")
        columns, rows = (1, 1) if self.board is None else read_two_numbers(self.board, "--board", "6x6")
        if self.spacing is None and columns * rows > 1 and kind != "apriltag":
            shown = "0.3 (a share of the side) or 6mm" if kind == "aprilgrid" else "6mm"
            raise InputError(f"--pattern {kind} needs the gap between tags. Add --spacing, e.g. {shown}.")
        spacing: Any = None
        if self.spacing is not None:
            share = floats([self.spacing])
            spacing = share[0] if share else self.spacing
            if kind == "aruco":
                spacing = read_length(self.spacing, "--spacing")
        square = read_length(self.square, "--square")
        return Board(columns, rows, square, kind, None, self.dictionary, spacing, self.first_id)


@dataclass(frozen=True)
class LensOptions(Options):
    """Options of the camera model.

    Options (Camera model):
      --model NAME <MODEL_NAMES>: Camera model: {MODEL_NAMES}. auto selects by BIC. Default: auto.
      --coefficients NAMES <COEFFICIENT_NAMES>: Distortion coefficients to estimate, e.g. k1,k2; the others are 0.
        Default: all of the model.
      --intrinsics FILE: Known intrinsics: JSON such as {"fx": [1080.0, 2.0], "k1": 0.0}, or YAML of OpenCV or ROS. One
        number is exact, two are a value and its standard deviation; YAML is exact. With --camera-matrix a name:
        estimated, pinhole or exact (see uq-handeye compare --help-all).
      --board-shape NAME: Shape model of the board: auto, flat, bow2, bow3, bow4 (height, a polynomial of that degree),
        plane1 (aspect and shear), plane2 (also degree 2), or a sum such as bow2+plane1. auto selects by BIC. Default:
        auto.
    """

    model: str | None = None
    coefficients: str | None = None
    intrinsics: str | None = None
    board_shape: str | None = None

    def calibrate(
        self,
        corners: "Corners",
        image_size: tuple[int, int] | None,
        measured: "BoardShape | None" = None,
        camera: "KnownCamera | None" = None,
    ) -> "CameraCalibration":
        """Calibrate the camera from corners, of a board that may have been ``measured`` before, or take the intrinsics
        of a known ``camera``."""
        from ..model.camera.calibrate import calibrate_camera

        if measured is not None and self.board_shape is not None:
            raise InputError("--board-shape: the file of --board holds the shape of the board. Remove one of them.")
        if camera is not None:
            with timed("the poses of the target"), working("the poses of the target", progress_wanted()):
                return calibrate_camera(
                    corners,
                    image_size,
                    camera.model,
                    coefficients=(),
                    intrinsics=camera.values,
                    shape=measured or "flat",
                )
        model = None if self.model is None else one_of(self.model, "--model", MODEL_NAMES)
        values: Any = None
        if self.intrinsics is not None:
            from ..model.camera.intrinsics_file import read_intrinsics

            known = read_intrinsics(self.intrinsics, model)
            values, model = known.values, known.model if model in (None, "auto") else model
            size = image_size or corners.image_size
            if size is None:
                image_size = known.image_size
            elif known.image_size not in (None, size):
                other = "{} x {}".format(*known.image_size)
                raise InputError(
                    f"{self.intrinsics} is for pictures of {other} pixels, got {size[0]} x {size[1]}. Scale fx, fy, "
                    "cx, cy and their standard deviations."
                )
        if image_size is None and corners.image_size is None:
            raise InputError("The table of corners has no image size. Add --image-size, e.g. 1920x1080.")
        names = None if self.coefficients is None else [part.strip() for part in self.coefficients.split(",") if part]
        with timed("calibrating the camera"), working("calibrating the camera", progress_wanted()):
            return calibrate_camera(
                corners, image_size, model or "auto", coefficients=names, intrinsics=values,
                shape=measured or self.board_shape or "auto",
            )  # fmt: skip


class KnownCamera(NamedTuple):
    """Intrinsics of a camera that is not calibrated from the pictures."""

    model: str
    values: dict[str, float | tuple[float, float]]  # exact, or with a standard deviation


@dataclass(frozen=True)
class Pictures:
    """Pictures, with the board and the camera model."""

    images: str
    board: BoardOptions
    lens: LensOptions
    known: KnownCamera | None = field(default=None, kw_only=True)  # for a single tag
    of_result: "CameraCalibration | None" = field(default=None, kw_only=True)  # that of a calibration, for new pictures

    def read_board(self) -> "Board":
        """Return the board to look for."""
        return self.board.read()

    def calibrate(self, corners: "Corners") -> "CameraCalibration":
        """Return the camera that saw these corners."""
        return self.lens.calibrate(corners, None, self.board.shape(), self.known)

    def poses(self, robot: Path | None, **how: Any) -> "PosePairs":
        """Return robot poses with the camera poses of the pictures; ``how`` are further arguments of `read_poses`."""
        from dataclasses import replace

        from ..fit.input_checks.pose_ambiguity import resolve_board_rotation
        from ..model.camera.board import find_corners, source_of
        from ..model.camera.report.text import model_name
        from ..read import read_poses

        board = self.board.read()
        with timed(f"looking for the board in {self.images}"):
            corners = find_corners(self.images, board, progress_wanted())
        if self.of_result is not None:
            from ..model.camera.calibrate import poses_by_known_camera

            poses = read_poses(robot, poses_by_known_camera(self.of_result, corners), **how)
            return replace(poses, sources=(*poses.sources, source_of(self.images, board)))
        seen = self.calibrate(corners)
        LOG.info("the camera: %s, pixel noise %.3g pixels", model_name(seen), seen.pixel_noise)
        poses = resolve_board_rotation(read_poses(robot, seen, **how), board)
        return replace(poses, sources=(*poses.sources, source_of(self.images, board)))


def read_two_numbers(text: str, name: str, example: str) -> tuple[int, int]:
    """Return the numbers of a text such as 9x6."""
    parts = text.lower().replace("\u00d7", "x").split("x")
    if len(parts) != 2 or not all(part.strip().isdecimal() and len(part) < 8 for part in parts):
        raise InputError(f"Expected {name} to be two numbers such as {example}, got {text!r}.")
    return int(parts[0]), int(parts[1])


def read_length(text: str, name: str) -> float:
    """Return the metres of a number, which may have a unit."""
    if (value := metres(text, name)) > 1.0:
        raise InputError(f"{name} {text} is {value:g} m, larger than any board. Write the unit, e.g. {name} {text}mm.")
    return value


# Names of `shared_errors.camera_noise`, repeated here so that help and completion load quickly.
INTRINSICS = ("estimated", "pinhole", "exact")


@dataclass(frozen=True)
class ViewOptions(Options):
    """Options of the camera that finished poses come from.

    Options (Camera poses from other programs):
      * --camera-matrix MATRIX: Camera matrix fx,fy,cx,cy (px), for finished poses. Also for pictures of a single tag.
        With --board and --square, or --tag, the camera noise follows from the view of each pose. Or a file: camera_info
        of ROS, OpenCV, JSON with standard deviations, or the folder of camera -o. For tags of --bag also raw or
        rectified, the picture in which they were detected. Default there: as the corners fit.
      --tag LENGTH: Side of a single tag, e.g. 40mm, in place of --board; with --images that of the tag to look for.
      --pixel-noise PIXELS: Standard deviation of the corners, e.g. 0.2px. Default: estimated.
    """

    camera_matrix: str | None = None
    tag: str | None = None
    pixel_noise: str | None = None


@dataclass(frozen=True)
class Views:
    """Target and camera of finished camera poses."""

    board: BoardOptions
    options: ViewOptions
    intrinsics: str | None  # estimated, exact, or None: as the camera says

    def beside(
        self, poses: "PosePairs", noise: "Noise | None", prior: "NoisePrior | None"
    ) -> "CameraNoise | PoseNoise":
        """Return the noise of the poses, with the robot noise if it is given."""
        from ..model.noise.models import PoseNoise

        if prior is not None and prior.camera is not None:
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

    @property
    def focal_length_px(self) -> float | None:
        """Mean focal length of the camera matrix, in pixels."""
        if self.options.camera_matrix is None:
            return None
        values = camera_of(self.options.camera_matrix).values
        return 0.5 * (values["fx"] + values["fy"])

    def _points(self) -> Any:
        tag, board = self.options.tag, self.board
        if tag is not None:
            if board.given:
                raise InputError(f"Give either --tag or {', '.join(board.given)}: not both.")
            from ..model.camera.board import tag_points

            return tag_points(read_length(tag, "--tag"))
        if board.file is not None and not board.of_kalibr:
            from ..model.camera.board_file import read_board_points

            return read_board_points(board.file)
        if board.pattern is None and not board.of_kalibr and (board.board is None or board.square is None):
            raise InputError("--camera-matrix needs the target: add --board 9x6 --square 20mm, or --tag 40mm.")
        return board.read().points


def either(seen: "Pictures | Views | None") -> tuple[Pictures | None, Views | None]:
    """Return what is seen as pictures, or as views of finished camera poses."""
    return (seen, None) if isinstance(seen, Pictures) else (None, seen)


class CameraMatrix(NamedTuple):
    """Camera of --camera-matrix: as `camera_noise` takes it, and its parameters with the standard deviations given."""

    given: Any
    values: dict[str, float]
    sd: dict[str, float]
    model: str | None


def camera_of(text: str) -> CameraMatrix:
    """Read a camera matrix: four numbers, a file or a folder."""
    from ..model.camera.intrinsics_file import read_intrinsics
    from ..model.camera.models import LINEAR

    if (path := Path(text)).is_dir():
        from ..model.camera.result import read_camera

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


def _pictures(images: str, board: BoardOptions, lens: LensOptions, options: ViewOptions) -> Pictures:
    """Return pictures; those of a single tag are of a known camera."""
    if options.pixel_noise is not None:
        raise InputError("--pixel-noise: for finished camera poses, not for --images. Remove the option.")
    if options.tag is not None:
        kinds = ("--pattern",) if board.pattern in ("apriltag", "aruco") and board.board is None else ()
        if given := [name for name in board.given if name not in ("--dictionary", "--first-id", *kinds)]:
            raise InputError(f"Give either --tag or {', '.join(given)}: not both.")
        from ..model.camera.description import APRILTAGS, dictionary_name

        april = board.pattern != "aruco" if board.dictionary is None else dictionary_name(board.dictionary) in APRILTAGS
        board = replace(board, square=options.tag, pattern="apriltag" if april else "aruco")
    single = board.file is None and board.pattern in ("apriltag", "aruco") and board.board in (None, "1x1")
    if options.camera_matrix is None:
        if single and lens.intrinsics is None:
            raise InputError(
                "The four corners of a single tag do not calibrate the camera. Add --camera-matrix, e.g. "
                "1080,1080,960,540 or a file of its intrinsics."
            )
        return Pictures(images, board, lens)
    if not single:
        raise InputError(
            "--camera-matrix: for finished camera poses and single tags, not for --images of a board, which calibrate "
            "the camera. Remove it. Known intrinsics: --intrinsics FILE."
        )
    if wrong := [name for name in lens.given if name != "--intrinsics"]:
        raise InputError(f"{', '.join(wrong)}: not used with --camera-matrix. Remove the option.")
    exact = intrinsics_of(lens.intrinsics) == "exact"
    return Pictures(images, board, lens, known=_known(camera_of(options.camera_matrix), exact))


def _known(camera: CameraMatrix, exact: bool) -> KnownCamera:
    """Return known intrinsics with standard deviations, by default those of finished poses of a tag."""
    from ..model.camera.models import LINEAR, MODELS
    from ..model.shared_errors.shared_error import DEFAULT_SD, FOCAL_LENGTH, PRINCIPAL_POINT

    if missing := [name for name in LINEAR if name not in camera.values]:
        raise InputError(f"--camera-matrix lacks {', '.join(missing)}. Give fx, fy, cx and cy.")
    model = camera.model or ("brown" if set(camera.values) - set(LINEAR) else "pinhole")
    values = {name: camera.values.get(name, 0.0) for name in MODELS[model].names}
    if exact:
        return KnownCamera(model, dict(values))
    sd = {name: camera.sd[name] for name in values if name in camera.sd}
    if not any(sd.values()):
        f = 0.5 * (values["fx"] + values["fy"])
        of = {"fx": FOCAL_LENGTH, "fy": FOCAL_LENGTH, "cx": PRINCIPAL_POINT, "cy": PRINCIPAL_POINT}
        sd = {name: f * DEFAULT_SD[sort] for name, sort in of.items()}
    return KnownCamera(model, {name: (value, sd[name]) if name in sd else value for name, value in values.items()})


def pictures_of(
    *, images: str | None = None, board: BoardOptions, lens: LensOptions, options: ViewOptions
) -> Pictures | Views | None:
    """Return the pictures of the options, or the views of finished camera poses, or None if neither is given.

    Options (Pictures of a board):
      * --images 'PATTERN': Pictures in place of CAMERA, e.g. 'img/*.png'. One per row of ROBOT, in the order of their
        names (img2 before img10).
    """
    if images is not None:
        return _pictures(images, board, lens, options)
    if options.given:
        if wrong := [name for name in lens.given if name != "--intrinsics"]:
            raise InputError(f"{', '.join(wrong)}: for pictures, not for --camera-matrix. Remove the option.")
        return Views(board, options, intrinsics_of(lens.intrinsics))
    if given := board.given + lens.given:
        these = ", ".join(given)
        raise InputError(f"{these}: needs pictures or a camera matrix. Add --images 'PATTERN' or --camera-matrix.")
    return None
