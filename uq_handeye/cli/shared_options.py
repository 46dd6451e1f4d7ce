"""Errors that all poses share, on the command line."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..errors import InputError
from .options import one_of, option

if TYPE_CHECKING:
    from ..noise.models import Noise
    from ..poses.pose_pairs import PosePairs
    from ..shared_errors.shared_error import SharedError
    from .views import Views

# Panel of the help.
SHARED = "Shared errors"
# Whether those of finished camera poses whose noise is estimated are taken.
DEFAULTS = ("defaults", "none")


@dataclass(frozen=True)
class SharedOptions:
    """Standard deviations of errors that all poses share, as the command line says."""

    shared: Annotated[
        str | None,
        option(
            "--shared",
            of=DEFAULTS,
            metavar="defaults|none",
            panel=SHARED,
            help="none: no shared errors but those declared here. Default, for camera poses without corners and noise "
            "that is estimated: focal length 0.1%, principal point 0.001, target scale 0.02% (5 % probability of 2 %).",
        ),
    ] = None
    focal_sd: Annotated[
        str | None,
        option(
            "--focal-sd",
            metavar="SD|exact",
            panel=SHARED,
            help="Relative standard deviation of the focal length, e.g. 0.1%.",
        ),
    ] = None
    principal_point_sd: Annotated[
        str | None,
        option(
            "--principal-point-sd",
            metavar="SD|exact",
            panel=SHARED,
            help="Standard deviation of each coordinate of the principal point over the focal length, e.g. 0.001; or "
            "e.g. 1px where the focal length is known.",
        ),
    ] = None
    target_scale_sd: Annotated[
        str | None,
        option(
            "--target-scale-sd",
            metavar="SD|exact",
            panel=SHARED,
            help="Relative standard deviation of the size of the target, e.g. 0.02%.",
        ),
    ] = None
    robot_scale_sd: Annotated[
        str | None,
        option(
            "--robot-scale-sd",
            metavar="SD|exact",
            panel=SHARED,
            help="Relative standard deviation of the lengths of the robot, e.g. 0.01%.",
        ),
    ] = None
    robot_accuracy: Annotated[
        str | None,
        option(
            "--robot-accuracy",
            metavar="MM,DEG|exact",
            panel=SHARED,
            help="Accuracy of the robot by its data sheet, e.g. 0.5mm,0.05deg: a smooth error over the pose.",
        ),
    ] = None
    offset_sd: Annotated[
        str | None,
        option(
            "--offset-sd",
            metavar="SD|exact",
            panel=SHARED,
            help="Standard deviation of the clock offset, e.g. 1ms; with --pair async in place of the one estimated.",
        ),
    ] = None

    def errors(
        self,
        poses: "PosePairs",
        noise: "Noise | None",
        file: Path | None = None,
        views: "Views | None" = None,
    ) -> "list[SharedError] | None":
        """Those declared, here or in a noise file, and the defaults that stay; None: nothing is declared."""
        from ..io import read_shared_errors
        from ..noise.models import PairNoise
        from ..shared_errors.shared_error import SharedError, checked_errors, replace_defaults

        focal_length_px = None if views is None else views.focal_length_px
        if poses.camera_calibration is not None:
            found = poses.camera_calibration.intrinsics
            focal_length_px = 0.5 * (found["fx"] + found["fy"])
        in_file = () if file is None else read_shared_errors(file, focal_length_px=focal_length_px)
        declared = {error.name: error for error in in_file}
        for name, text, make in (
            ("--focal-sd", self.focal_sd, SharedError.focal_length),
            (
                "--principal-point-sd",
                self.principal_point_sd,
                lambda sd: SharedError.principal_point(sd, focal_length_px=focal_length_px),
            ),
            ("--target-scale-sd", self.target_scale_sd, SharedError.target_scale),
            ("--robot-scale-sd", self.robot_scale_sd, SharedError.robot_scale),
            ("--robot-accuracy", self.robot_accuracy, SharedError.robot_accuracy),
            ("--offset-sd", self.offset_sd, SharedError.clock_offset),
        ):
            if text is not None:
                try:
                    error = make(text)
                except InputError as reason:
                    raise InputError(f"{name}: {reason}") from None
                declared[error.name] = error
        none = self.shared is not None and one_of(self.shared, "--shared", DEFAULTS) == "none"
        if not declared and not none:
            return None
        if isinstance(noise, PairNoise) and declared:
            raise InputError("Shared errors are of poses: expected noise on poses beside them, got noise on motions.")
        errors = list(declared.values())
        if not none and noise is None:
            known = views is not None or poses.camera_calibration is not None
            errors = replace_defaults(declared.values(), known)
        return list(checked_errors(errors, poses))
