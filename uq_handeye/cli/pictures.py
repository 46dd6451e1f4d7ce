"""Options of pictures of a board: the camera model, and the camera poses computed from the pictures."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.files.lines import floats
from ..core.progress import working
from ..errors import InputError
from .boards import BoardOptions
from .messages import LOG, progress_wanted, timed
from .names import SETUP_NAMES
from .options import Options
from .values import one_of
from .views import CameraMatrix, ViewOptions, Views, camera_of, intrinsics_of

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..core.geometry.se3 import Array
    from ..model.camera.adjustment.setting import Known
    from ..model.camera.board_shape import BoardShape
    from ..model.camera.corners import Corners
    from ..model.camera.description import Board
    from ..model.camera.known_intrinsics import KnownIntrinsics
    from ..model.camera.result import CameraCalibration
    from ..model.poses.pose_pairs import PosePairs


# Names of camera.models.MODELS, and "auto", repeated here so that help and completion load quickly.
MODEL_NAMES = ("auto", "pinhole", "brown", "fisheye", "brown_full", "inverse_brown", "fisheye624")
COEFFICIENT_NAMES = (
    "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y", "k0", "p0", "s0",
)  # fmt: skip


@dataclass(frozen=True)
class LensOptions(Options):
    """Options of the camera model.

    Options (Camera model):
      --model NAME <MODEL_NAMES>: Camera model: {MODEL_NAMES}. auto selects by BIC among the first three. Default: auto.
      --coefficients NAMES <COEFFICIENT_NAMES>: Distortion coefficients to estimate, e.g. k1,k2; the others are 0.
        Default: all of the model.
      --intrinsics FILE[,exact]: Known intrinsics: JSON such as {"fx": [1080.0, 2.0], "k1": 0.0}, or a file of OpenCV,
        ROS or another program. Two numbers are a value and its standard deviation; one has 0.1 % (focal length) or
        0.001 focal lengths (centre), unless the word exact follows. The pictures test every number. With
        --camera-matrix a name: estimated, pinhole or exact (see uq-handeye compare --help-all).
      --roi X,Y,WIDTH,HEIGHT: Part of the picture of --intrinsics that the pictures show (px). Default: all of it.
        Another resolution is scaled.
      --board-shape NAME: Shape model of the board: auto, flat, bow2, bow3, bow4 (height, a polynomial of that degree),
        plane1 (aspect and shear), plane2 (also degree 2), or a sum such as bow2+plane1. auto selects by BIC. Default:
        auto.
    """

    model: str | None = None
    coefficients: str | None = None
    intrinsics: str | None = None
    roi: str | None = None
    board_shape: str | None = None

    def calibrate(
        self,
        corners: "Corners",
        image_size: tuple[int, int] | None,
        measured: "BoardShape | None" = None,
        camera: "KnownIntrinsics | None" = None,
    ) -> "CameraCalibration":
        """Calibrate the camera from corners, of a board that may have been ``measured`` before, or take the intrinsics
        of a known ``camera``."""
        import numpy as np

        from ..model.camera.calibrate import calibrate_camera

        if measured is not None and self.board_shape is not None:
            raise InputError("--board-shape: the file of --board holds the shape of the board. Remove one of them.")
        if camera is not None:
            with timed("the poses of the target"), working("the poses of the target", progress_wanted()):
                return calibrate_camera(
                    corners,
                    image_size,
                    camera.model or "auto",
                    coefficients=(),
                    intrinsics=camera.values,
                    exact=not any(map(np.ndim, camera.values.values())),
                    shape=measured or "flat",
                )
        model = None if self.model is None else one_of(self.model, "--model", MODEL_NAMES)
        values: Known | None = None
        exact, how = False, ""
        if self.intrinsics is not None:
            from ..model.camera.intrinsics_file import read_intrinsics

            file, exact = split_exact(self.intrinsics)
            known = read_intrinsics(file, model)
            model = known.model if model in (None, "auto") else model
            from ..model.camera.picture_region import for_pictures

            size = image_size or corners.image_size
            known = for_pictures(known, size, self.read_roi(), file)
            values, how = known.values, known.how
            image_size = known.image_size if size is None else image_size
        if image_size is None and corners.image_size is None:
            raise InputError("The table of corners has no image size. Add --image-size, e.g. 1920x1080.")
        names = None if self.coefficients is None else [part.strip() for part in self.coefficients.split(",") if part]
        with timed("calibrating the camera"), working("calibrating the camera", progress_wanted()):
            found = calibrate_camera(
                corners, image_size, model or "auto", coefficients=names, intrinsics=values, exact=exact,
                shape=measured or self.board_shape or "auto",
            )  # fmt: skip
        if not how:
            return found
        from ..findings import Finding

        return replace(found, findings=(*found.findings, Finding("camera.given_moved", "note", {"how": how})))

    def read_roi(self) -> tuple[int, int, int, int] | None:
        """Return the part of the picture of --intrinsics that the pictures show."""
        if self.roi is None:
            return None
        numbers = floats(self.roi.split(","))
        if numbers is None or len(numbers) != 4 or any(value != int(value) for value in numbers):
            raise InputError(f"Expected --roi to be X,Y,WIDTH,HEIGHT in pixels, got {self.roi!r}.")
        x, y, width, height = map(int, numbers)
        return x, y, width, height


def split_exact(text: str) -> tuple[str, bool]:
    """Return the file of ``FILE[,exact]`` and whether its numbers are exact."""
    file, comma, word = text.rpartition(",")
    return (file, True) if comma and word.strip() == "exact" else (text, False)


@dataclass(frozen=True)
class Pictures:
    """Pictures, with the board and the camera model."""

    images: str
    board: BoardOptions
    lens: LensOptions
    known: "KnownIntrinsics | None" = field(default=None, kw_only=True)  # for a single tag
    of_result: "CameraCalibration | None" = field(default=None, kw_only=True)  # that of a calibration, for new pictures

    def read_board(self) -> "Board":
        """Return the board that is searched in the pictures."""
        return self.board.read()

    def calibrate(self, corners: "Corners") -> "CameraCalibration":
        """Return the camera that saw these corners."""
        return self.lens.calibrate(corners, None, self.board.shape(), self.known)

    def poses(self, robot: Path | None, **how: Any) -> "PosePairs":
        """Return robot poses with the camera poses of the pictures; ``how`` are further arguments of `read_poses`."""
        from dataclasses import replace

        from ..fit.diagnostics.board_rotation import resolve_board_rotation
        from ..model.camera.board import find_corners, source_of
        from ..model.camera.picture_files import picture_paths
        from ..model.camera.report.text import model_name
        from ..read import read_poses
        from ..read.poses import require_robot

        board = self.board.read()
        require_robot(robot, len(picture_paths(self.images)), how)
        with timed(f"looking for the board in {self.images}"):
            corners = find_corners(self.images, board, progress_wanted())
        if self.of_result is not None:
            from ..model.camera.known_camera import poses_by_known_camera

            poses = read_poses(robot, poses_by_known_camera(self.of_result, corners), **how)
            return replace(poses, sources=(*poses.sources, source_of(self.images, board)))
        seen = self.calibrate(corners)
        LOG.info("the camera: %s, pixel noise %.3g pixels", model_name(seen), seen.pixel_noise)
        poses = resolve_board_rotation(read_poses(robot, seen, **how), board)
        return replace(poses, sources=(*poses.sources, source_of(self.images, board)))


@dataclass(frozen=True)
class Scene(Pictures):
    """Pictures of a scene without a board."""

    mask: Path | None = field(default=None, kw_only=True)
    later_than: "Calibration | None" = field(default=None, kw_only=True)  # the result in whose scene they are placed

    def poses(self, robot: Path | None, **how: Any) -> "PosePairs":
        """Return robot poses with the camera poses of the pictures; ``how`` are further arguments of `read_poses`."""
        from ..calibration.by_scene import scene_poses
        from ..read import read_poses
        from ..read.poses import read_robot

        if not self.images:
            raise InputError("--scene needs pictures. Add --images 'PATTERN'.")

        of_robot = {name: how[name][0] for name in ("units", "format", "rotation") if how.get(name) is not None}
        of_arm = {name: how[name] for name in ("joints", "kinematics", "joint_units") if how.get(name) is not None}
        setup = how.get("setup") or SETUP_NAMES[0]
        poses = read_robot(robot, frame=how["robot_frame"], setup=setup, **of_robot, **of_arm)
        known = known_of_scene(self.lens.intrinsics, self.lens.read_roi())
        with timed(f"the scene of {self.images}"), working("the scene", progress_wanted()) as say:
            found = scene_poses(
                self.images, poses, setup=setup, intrinsics=known, mask=self.mask, result=self.later_than, say=say
            )
        for finding in found.findings:
            LOG.info("%s", finding)
        pairs = read_poses(robot, found, **how)
        if pairs.setup != setup:
            raise InputError(f"The pose file says {pairs.setup}. Add --setup {pairs.setup}.")
        return pairs

    def paired(self, paths: list[Path], robot: "Array", setup: str) -> "PosePairs":
        """Return the poses of pictures that have arrived with those of the robot (n, 4, 4)."""
        from ..calibration.by_scene import scene_poses

        known = known_of_scene(self.lens.intrinsics, self.lens.read_roi())
        return scene_poses(paths, robot, setup=setup, intrinsics=known, mask=self.mask).pairs


def known_of_scene(
    text: str | None, roi: tuple[int, int, int, int] | None
) -> "dict[str, float | tuple[float, float]] | None":
    """Return the known intrinsics of ``FILE[,exact]`` for pictures of a scene."""
    if text is None:
        return None
    from ..model.camera.intrinsics_file import read_intrinsics
    from ..model.camera.picture_region import for_pictures
    from ..model.errors.keys import FOCAL_LENGTH, PRINCIPAL_POINT
    from ..model.shared_errors.shared_error import DEFAULT_SD

    file, exact = split_exact(text)
    known = for_pictures(read_intrinsics(file, "brown"), None, roi, file)
    values: dict[str, Any] = dict(known.values)
    if exact:
        return values
    of = {"fx": FOCAL_LENGTH, "fy": FOCAL_LENGTH, "cx": PRINCIPAL_POINT, "cy": PRINCIPAL_POINT}
    f = float(values["fx"][0] if isinstance(values["fx"], tuple | list) else values["fx"])
    for name, sort in of.items():
        if not isinstance(values[name], tuple | list):
            values[name] = (values[name], f * DEFAULT_SD[sort])
    return values


def either(seen: "Pictures | Views | None") -> tuple[Pictures | None, Views | None]:
    """Return the pictures, or the views of camera poses without corners."""
    return (seen, None) if isinstance(seen, Pictures) else (None, seen)


def _pictures(images: str, board: BoardOptions, lens: LensOptions, options: ViewOptions) -> Pictures:
    """Return pictures; those of a single tag are of a known camera."""
    if options.pixel_noise is not None:
        raise InputError("--pixel-noise: for finished camera poses, not for --images. Remove the option.")
    if options.pixel_origin is not None:
        raise InputError("--pixel-origin: for finished camera poses, not for --images. Remove the option.")
    if options.tag is not None:
        kinds = ("--pattern",) if board.pattern in ("apriltag", "aruco") and board.board is None else ()
        if given := [name for name in board.given if name not in ("--dictionary", "--first-id", *kinds)]:
            raise InputError(f"Give either --tag or {', '.join(given)}: not both.")
        from ..model.camera.dictionaries import APRILTAGS, dictionary_name

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


def _known(camera: CameraMatrix, exact: bool) -> "KnownIntrinsics":
    """Return known intrinsics with standard deviations, by default those of finished poses of a tag."""
    from ..model.camera.known_intrinsics import KnownIntrinsics
    from ..model.camera.models import LINEAR, MODELS
    from ..model.errors.keys import FOCAL_LENGTH, PRINCIPAL_POINT
    from ..model.shared_errors.shared_error import DEFAULT_SD

    if missing := [name for name in LINEAR if name not in camera.values]:
        raise InputError(f"--camera-matrix lacks {', '.join(missing)}. Give fx, fy, cx and cy.")
    model = camera.model or ("brown" if set(camera.values) - set(LINEAR) else "pinhole")
    values = {name: camera.values.get(name, 0.0) for name in MODELS[model].names}
    if exact:
        return KnownIntrinsics(dict(values), model, None)
    sd = {name: camera.sd[name] for name in values if name in camera.sd}
    if not any(sd.values()):
        f = 0.5 * (values["fx"] + values["fy"])
        of = {"fx": FOCAL_LENGTH, "fy": FOCAL_LENGTH, "cx": PRINCIPAL_POINT, "cy": PRINCIPAL_POINT}
        sd = {name: f * DEFAULT_SD[sort] for name, sort in of.items()}
    given = {name: (value, sd[name]) if name in sd else value for name, value in values.items()}
    return KnownIntrinsics(given, model, None)


def _scene(
    images: str | None, board: BoardOptions, lens: LensOptions, options: ViewOptions, mask: Path | None
) -> Scene:
    """Return pictures of a scene, without ``images`` those of --camera; raises `InputError` for options of a board."""
    used = ("--intrinsics", "--roi")
    if wrong := [*board.given, *(name for name in lens.given if name not in used), *options.given]:
        raise InputError(f"{', '.join(wrong)}: not used with --scene, which looks for no board. Remove the option.")
    return Scene(images or "", board, lens, mask=mask)


def pictures_of(
    *,
    images: str | None = None,
    scene: bool = False,
    mask: Path | None = None,
    board: BoardOptions,
    lens: LensOptions,
    options: ViewOptions,
) -> Pictures | Views | None:
    """Return the pictures of the options, or the views of finished camera poses, or None if neither is given.

    Options (Pictures of a board):
      * --images 'PATTERN': Pictures in place of CAMERA, e.g. 'img/*.png'. One per row of ROBOT, in the order of their
        names (img2 before img10).
      * --scene: The pictures are of a textured scene, no board. It stands still; for eye-to-hand it is an object in the
        gripper. Of several cameras: --camera left='left/*.png' for each, in place of --images.
      --mask FILE: With --scene: picture that is black where the pictures show the gripper. Default: what stands still
        in the picture is found.
    """
    if scene:
        return _scene(images, board, lens, options, mask)
    if mask is not None:
        raise InputError("--mask: for --scene. Remove it, or add --scene.")
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
