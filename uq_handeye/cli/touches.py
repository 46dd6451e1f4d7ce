"""Options of touches: points that the camera saw and the tool then touched."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import InputError
from .names import UNITS
from .values import coordinates, one_of

if TYPE_CHECKING:
    from ..calibration.analysis import FittedKinematics
    from ..calibration.evidence.touches import Touches
    from ..calibration.result import Calibration
    from ..model.kinematics.chain import Kinematics


class TouchOptions(NamedTuple):
    """Options of a file of touches.

    Options (Touches):
      * --tcp-sd LENGTH: Standard deviation of a touch per axis, e.g. 0.2mm. Default: the column touched_sd.
      * --point-sd LENGTH: Standard deviation of a seen point per axis, e.g. 0.3mm. Default: the columns seen_sd, else
        that of a camera pose in the calibration.
      * --tool X,Y,Z: Tool tip in the flange frame, e.g. 0mm,0mm,150mm. For touches by robot poses. Default: its origin.
      * --tool-sd LENGTH: Standard deviation of the tool's offset per axis, e.g. 0.3mm, exact or unknown.
      * --units UNIT <UNITS>: Length unit of columns that name none: {UNITS}.
      --board-poses FILE.csv: Poses camera_T_target of the views of a board, for points given on the board.
      --touch-robot-noise ROT,TRANS: Robot noise of one pose, by touch and view, e.g. 0.02deg,0.05mm. Default: that of
        the calibration.
      --other-sensor: Points from a depth sensor in the frame of the camera. The errors of its focal length and image
        centre are then not theirs.
    """

    tcp_sd: str | None = None
    point_sd: str | None = None
    tool: str | None = None
    tool_sd: str = "exact"
    units: str = "m"
    board_poses: Path | None = None
    touch_robot_noise: str | None = None
    other_sensor: bool = False

    def read(self, path: Path, kinematics: "FittedKinematics | None") -> "Touches":
        """Return the touches of a file."""
        import numpy as np

        from ..core.presentation.units import parse_length
        from ..formats.csv_poses import read_pose_file
        from ..use.verification.touches_file import read_touches
        from ..use.verification.verify import robot_covariance, tool_deviation

        unit = one_of(self.units, "--units", UNITS)
        arm: Kinematics | None = None if kinematics is None else kinematics.chain
        more: dict[str, Any] = {
            "tool": None if self.tool is None else np.array(coordinates(self.tool, "--tool")),
            "tool_sd": tool_deviation(self.tool_sd),
            "same_camera": not self.other_sensor,
            "board": None if self.board_poses is None else read_pose_file(self.board_poses, unit)[1],
        }
        if self.touch_robot_noise is not None:
            parts = self.touch_robot_noise.split(",")
            if len(parts) != 2:
                raise InputError(
                    f"Expected --touch-robot-noise to be ROT,TRANS such as 0.02deg,0.05mm, got "
                    f"{self.touch_robot_noise!r}."
                )
            more["robot_noise"] = robot_covariance((parts[0], parts[1]))
        lengths = {
            name: None if value is None else parse_length(value, f"--{name.replace('_', '-')}")
            for name, value in (("tcp_sd", self.tcp_sd), ("point_sd", self.point_sd))
        }
        return read_touches(path, arm, units=unit, touch_sd=lengths["tcp_sd"], point_sd=lengths["point_sd"], **more)


class TouchesToUse(NamedTuple):
    """Options of touches that a calibration takes in.

    Options (Touches):
      --touches FILE.csv: Points seen and touched, as further measurements. Columns as in verify, units by their names.
      --tcp-sd LENGTH: Standard deviation of a touch per axis, e.g. 0.2mm.
      --point-sd LENGTH: Standard deviation of a seen point per axis. Default: that of a camera pose.
      --tool X,Y,Z: Tool tip in the flange frame. Default: its origin.
      --tool-sd LENGTH: Standard deviation of the tool's offset per axis, exact or unknown.
    """

    touches: Path | None = None
    tcp_sd: str | None = None
    point_sd: str | None = None
    tool: str | None = None
    tool_sd: str = "exact"

    def read(self, kinematics: "FittedKinematics | None") -> "Touches | None":
        """Return the touches of the file; None if there is none."""
        if self.touches is None:
            given = [self.tcp_sd, self.point_sd, self.tool, None if self.tool_sd == "exact" else self.tool_sd]
            if any(value is not None for value in given):
                raise InputError("--tcp-sd, --point-sd, --tool and --tool-sd need --touches FILE.csv. Add it.")
            return None
        return TouchOptions(self.tcp_sd, self.point_sd, self.tool, self.tool_sd).read(self.touches, kinematics)

    def included_in(self, result: "Calibration") -> "tuple[Calibration, str]":
        """Return the calibration with the touches taken in, and what to say of them."""
        touches = self.read(result.kinematics)
        if touches is None:
            return result, ""
        from ..use.maintenance.update import include_touches
        from ..use.verification.touches_file import require_metres

        require_metres(result, touches)
        found = include_touches(result, touches)
        return found, str(found.findings[-1])
