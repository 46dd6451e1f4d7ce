"""Options of the errors that all poses share: intrinsics, target size, accuracy of the robot, clock."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..errors import InputError, require_one_of
from .names import ACCURACY_CLASSES
from .values import by_names, naming_option, one_of

if TYPE_CHECKING:
    from ..model.errors.models import Noise
    from ..model.poses.pose_pairs import PosePairs
    from ..model.rig.description import Rig
    from ..model.shared_errors.shared_error import SharedError
    from .views import Views

# Values of --shared without a standard deviation, and the errors that it takes one of.
DEFAULTS = ("defaults", "none")
ERRORS = ("focal length", "principal point", "target scale", "robot scale", "clock offset")


class SharedOptions(NamedTuple):
    """Options of the errors that all poses share.

    Options (Shared errors):
      --shared NAME=SD: Standard deviation of an error that all poses share, or exact, e.g. 'focal length=0.1%'. Names:
        {ERRORS}; the principal point per axis over the focal length, e.g. 0.001, or in pixels, 1px; the clock offset
        e.g. 1ms. none: no errors but those declared. Default, for camera poses without corners and estimated noise:
        focal length 0.1%, principal point 0.001, target scale 0.03% (within a factor of 4), lens, view and robot
        accuracy.
      --target-scale-sd SD: Relative standard deviation of the target size, e.g. 0.02%, or exact, as by --shared.
      * --robot-accuracy MM[,DEG]: Robot accuracy by its data sheet. Translation and rotation, e.g. 0.5mm,0.05deg, RMS
        over the workspace; or exact. Where it is not declared it is known within a factor of 3, or as --robot-class
        says. Default: 0.6 mm.
    """

    shared: list[str] | None = None
    target_scale_sd: str | None = None
    robot_accuracy: str | None = None
    robot_class: str | None = None

    @property
    def declared(self) -> dict[str, str]:
        """Return the standard deviations of --shared by name; raises `InputError` for another name."""
        found: dict[str, str] = {}
        for text in self.shared or ():
            name, given, sd = (part.strip() for part in text.partition("="))
            if not given:
                one_of(name, "--shared", (*DEFAULTS, *(f"'{error}=SD'" for error in ERRORS)))
                continue
            with naming_option("--shared"):
                require_one_of("a name", name, ERRORS)
            if name in found:
                raise InputError(f"--shared: expected {name} once, got {found[name]} and {sd}.")
            found[name] = sd
        return found

    def errors(
        self, poses: "PosePairs", noise: "Noise | None", file: Path | None = None, views: "Views | None" = None
    ) -> "list[SharedError] | None":
        """Return the declared errors of options and noise file with the remaining defaults, or None."""
        from ..model.shared_errors.assumed import assumed_accuracy, replace_defaults
        from ..model.shared_errors.shared_error import checked_errors
        from ..read import read_shared_errors

        focal_length_px = None if views is None else views.focal_length_px
        if poses.camera_calibration is not None:
            found = poses.camera_calibration.intrinsics
            focal_length_px = 0.5 * (found["fx"] + found["fy"])
        in_file = () if file is None else read_shared_errors(file, focal_length_px=focal_length_px)
        declared = {error.name: error for error in in_file}
        for name, text, make, _ in self._made(focal_length_px):
            if text is not None:
                with naming_option(name):
                    error = make(text)
                declared[error.name] = error
        if self.robot_class is not None:
            if self.robot_accuracy is not None:
                raise InputError("--robot-class and --robot-accuracy both give the accuracy. Remove one of them.")
            accuracy = assumed_accuracy(one_of(self.robot_class, "--robot-class", ACCURACY_CLASSES))
            declared[accuracy.name] = replace(accuracy, default=False)
        none = "none" in (self.shared or ())
        if not declared and not none:
            return None
        if noise is not None and noise.ITEM == "motion" and declared:
            raise InputError("Shared errors need noise of poses ([robot], [camera]), got noise of motions ([A], [B]).")
        errors = list(declared.values())
        if declared and noise is None:
            errors = replace_defaults(declared.values(), views is not None or poses.intrinsics_covered, not none)
        return list(checked_errors(errors, poses))

    def _made(self, focal_length_px: float | None) -> "list[tuple[str, str | None, Callable[..., SharedError], str]]":
        """Return option, text, how its error is made, and what has it."""
        from ..model.shared_errors.shared_error import SharedError

        def principal_point(sd: str) -> SharedError:
            return SharedError.principal_point(sd, focal_length_px=focal_length_px)

        declared = self.declared
        if self.target_scale_sd is not None and "target scale" in declared:
            raise InputError("--shared and --target-scale-sd both declare the target scale. Remove one of them.")
        makers: dict[str, tuple[Callable[..., SharedError], str]] = {
            "focal length": (SharedError.focal_length, "camera"),
            "principal point": (principal_point, "camera"),
            "target scale": (SharedError.target_scale, "target"),
            "robot scale": (SharedError.robot_scale, "arm"),
            "clock offset": (SharedError.clock_offset, "arm"),
        }
        return [
            *((f"--shared '{name}={sd}'", sd, *makers[name]) for name, sd in declared.items()),
            ("--target-scale-sd", self.target_scale_sd, *makers["target scale"]),
            ("--robot-accuracy", self.robot_accuracy, SharedError.robot_accuracy, "arm"),
        ]

    def errors_of_rig(self, rig: "Rig", file: Path | None) -> "list[SharedError] | None":
        """Return the declared errors of a rig, by names of cameras, targets and arms, with the remaining defaults."""
        from ..model.shared_errors.assumed import assumed_accuracy, replace_defaults
        from ..read import read_shared_errors

        names = {"camera": list(rig.cameras), "target": list(rig.targets), "arm": list(rig.arms)}
        declared = {error.key: error for error in (() if file is None else read_shared_errors(file))}
        for option, text, make, owner in self._made(None):
            for name, value in by_names(text, names[owner], option).items():
                with naming_option(option):
                    error = make(value).of(name)
                declared[error.key] = error
        for name, value in by_names(self.robot_class, names["arm"], "--robot-class").items():
            if self.robot_accuracy is not None:
                raise InputError("--robot-class and --robot-accuracy both give the accuracy. Remove one of them.")
            if all(rig.arms[arm].kinematics is not None for arm in ([name] if name else names["arm"])):
                continue  # of the errors of its chain
            accuracy = assumed_accuracy(one_of(value, "--robot-class", ACCURACY_CLASSES)).of(name)
            declared[accuracy.key] = replace(accuracy, default=False)
        none = "none" in (self.shared or ())
        if not declared:
            return [] if none else None
        return replace_defaults(declared.values(), False, not none)
