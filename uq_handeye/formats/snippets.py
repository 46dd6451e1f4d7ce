"""X and its inverse as texts that people copy into other programs, each with its convention and units beside it.

Numbers have twelve significant digits. Sources of the rules: NumPy; OpenCV, ``calibrateHandEye`` (docs.opencv.org,
calib3d); ROS, ``static_transform_publisher`` (ros2/geometry2, ``tf2_ros/src/static_transform_broadcaster_program.cpp``)
and ``geometry_msgs/msg/PoseWithCovariance.msg`` (ros2/common_interfaces); GTSAM, ``gtsam/geometry/Pose3.h``
(borglab/gtsam); URDF, ``<origin>`` of ``<joint>`` (wiki.ros.org/urdf/XML/joint).

Frames by name, quaternion and angles about fixed axes of a pose, for every export.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..core.formatting.numbers import Snippet, short
from ..core.geometry.conventions import TOOLKIT, to_convention
from ..core.geometry.se3 import Array, inverse_jacobian
from ..core.runtime.read_only import ReadOnlyArrays
from .opencv_storage import yaml_number

# The frames of X for motions that came without poses: those in which A and B are given.
OF_MOTIONS = ("frame_of_A", "frame_of_B")

# Standard deviation (m) along open directions in formats that have no infinity.
OPEN_DEVIATION = 1e3

NOT_DETERMINED = "The covariance is not determined, so it is left out."


@dataclass(frozen=True, eq=False)
class Transform(ReadOnlyArrays):
    """``T = parent_T_child`` (4, 4), metres, with the covariance (6, 6) of (theta, tau) in the parent frame."""

    T: Array
    covariance: Array | None
    parent: str
    child: str

    @property
    def name(self) -> str:
        """``parent_T_child``."""
        return f"{self.parent}_T_{self.child}"

    @property
    def R(self) -> Array:
        return np.asarray(self.T[:3, :3])

    @property
    def t(self) -> Array:
        return np.asarray(self.T[:3, 3] + 0.0)

    @property
    def quaternion(self) -> Array:
        """Unit quaternion (x, y, z, w), w >= 0."""
        return np.asarray(Rotation.from_matrix(self.R).as_quat(canonical=True) + 0.0)

    def covariance_in(self, convention: str) -> Array | None:
        """The covariance in the convention of another library (`conventions`)."""
        return None if self.covariance is None else to_convention(self.covariance, self.T, convention) + 0.0


def transforms_of(result: Any) -> tuple[Transform, Transform]:
    """X and its inverse."""
    parent, child = OF_MOTIONS if result.setup is None else result.frame.split("_T_")
    covariance, of_inverse = result.covariance, result.covariance_inverse
    if covariance is not None and result.opened is not None:
        covariance = with_open(covariance, result.opened.of_X)
        J = inverse_jacobian(result.X)
        of_inverse = J @ covariance @ J.T
    return (
        Transform(result.X + 0.0, covariance, parent, child),
        Transform(result.inverse + 0.0, of_inverse, child, parent),
    )


def with_open(covariance: Array, U: Array) -> Array:
    """Covariance (6, 6) with `OPEN_DEVIATION` along the open directions U (k, 6)."""
    return np.asarray(covariance + OPEN_DEVIATION**2 * (U.T @ U))


def open_comments(result: Any) -> list[str]:
    """Return the comments of an export about open directions; none where there are none."""
    if result.opened is None:
        return []
    return [
        f"Open, not determined by the motions: {'; '.join(result.open_words)}.",
        f"Along these the covariance has a standard deviation of {OPEN_DEVIATION:g} m (angles: times "
        f"{result.opened.lever:.3g} m), which stands for infinity.",
    ]


def fixed_axis_angles(R: Array) -> Array:
    """Roll, pitch, yaw (rad) about the fixed axes x, y, z: ``R = Rz(yaw) Ry(pitch) Rx(roll)``, the ``rpy`` of URDF.

    Roll is taken from ``Rz(yaw)^T R`` and so makes up for a yaw that is not determined: at a pitch of 90 degrees, and
    arbitrarily near to it, the three angles give R back to rounding.

    >>> fixed_axis_angles(np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])).round(3).tolist()
    [0.0, 1.571, 0.0]
    """
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    yaw = np.arctan2(R[1, 0], R[0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw]) + 0.0


def yaml_fields(axes: str, values: Array, digits: int = 17) -> str:
    """``{x: 1.0, y: 2.0, z: 3.0}``."""
    fields = (f"{axis}: {yaml_number(value, digits)}" for axis, value in zip(axes, values, strict=True))
    return f"{{{', '.join(fields)}}}"


def texts(result: Any) -> list[Snippet]:
    """NumPy, OpenCV, ROS, GTSAM and URDF forms of X, then of its inverse."""
    return [make(transform) for transform in transforms_of(result) for make in _FORMS]


def _vector(values: Array) -> str:
    return f"[{', '.join(map(short, values))}]"


def _matrix(name: str, values: Array) -> str:
    """``name = np.array([...])`` with a row per line."""
    start = f"{name} = np.array(["
    rows = (",\n" + " " * len(start)).join(map(_vector, values))
    return f"{start}{rows}])"


def _with(transform: Transform, sentence: str, of_covariance: str) -> str:
    return f"{sentence} {NOT_DETERMINED if transform.covariance is None else of_covariance}"


def _of_toolkit(X: Transform) -> str:
    return f"Covariance of {TOOLKIT} {X.parent}."


def _numpy(X: Transform) -> Snippet:
    lines = ["import numpy as np", "", _matrix(X.name, X.T)]
    if X.covariance is not None:
        lines.append(_matrix("covariance", X.covariance))
    sentence = f"4x4 matrix, metres; maps points of {X.child} into {X.parent}: p_{X.parent} = {X.name} p_{X.child}."
    return Snippet(f"NumPy: {X.name}", _with(X, sentence, _of_toolkit(X)), "\n".join(lines), "python")


def opencv_name(X: Transform) -> str:
    """Return the name of ``parent_T_child`` as OpenCV writes the frames: ``cam2gripper``."""
    short_names = {"camera": "cam"}
    return f"{short_names.get(X.child, X.child)}2{short_names.get(X.parent, X.parent)}"


def _opencv(X: Transform) -> Snippet:
    name = opencv_name(X)
    lines = ["import numpy as np", "", _matrix(f"R_{name}", X.R), _matrix(f"t_{name}", X.t[:, None])]
    if X.covariance is not None:
        lines.append(_matrix(f"covariance_{name}", X.covariance))
    sentence = f"R (3x3) and t (3x1, metres) as of cv::calibrateHandEye: p_{X.parent} = R p_{X.child} + t."
    of_covariance = f"OpenCV has no convention for the covariance; this is ours. {_of_toolkit(X)}"
    return Snippet(f"OpenCV: {X.name}", _with(X, sentence, of_covariance), "\n".join(lines), "python")


def _ros2(X: Transform) -> Snippet:
    x, y, z = map(short, X.t)
    qx, qy, qz, qw = map(short, X.quaternion)
    text = (
        f"ros2 run tf2_ros static_transform_publisher --x {x} --y {y} --z {z} "
        f"--qx {qx} --qy {qy} --qz {qz} --qw {qw} --frame-id {X.parent} --child-frame-id {X.child}"
    )
    return Snippet(
        f"ROS 2 static transform: {X.name}",
        "Metres and unit quaternion. Put your own frame names in: the camera is the frame "
        "with z forward, which ROS calls optical. It carries no covariance.",
        text,
        "bash",
    )


def _ros1(X: Transform) -> Snippet:
    numbers = " ".join(map(short, [*X.t, *X.quaternion]))
    return Snippet(
        f"ROS 1 static transform: {X.name}",
        "x y z qx qy qz qw: metres and unit quaternion, scalar last; put your own frame names in. It carries no "
        "covariance.",
        f"rosrun tf2_ros static_transform_publisher {numbers} {X.parent} {X.child}",
        "bash",
    )


def _ros_pose(X: Transform) -> Snippet:
    position, orientation = yaml_fields("xyz", X.t, 12), yaml_fields("xyzw", X.quaternion, 12)
    covariance = X.covariance_in("ros")
    if covariance is None:
        lines = [f"position: {position}", f"orientation: {orientation}"]
        title, message = f"ROS Pose: {X.name}", "geometry_msgs/Pose"
    else:
        rows = [", ".join(yaml_number(value, 12) for value in row) for row in covariance]
        lines = ["pose:", f"  position: {position}", f"  orientation: {orientation}", "covariance: ["]
        lines += [f"  {row}," for row in rows] + ["]"]
        title, message = f"ROS PoseWithCovariance: {X.name}", "geometry_msgs/PoseWithCovariance"
    sentence = f"{message} of {X.child} in {X.parent}, metres and unit quaternion."
    of_covariance = (
        "Covariance 6x6 row by row, of (x, y, z, rotation about x, y, z): translation first, about the fixed axes of "
        f"{X.parent}, m and rad."
    )
    return Snippet(title, _with(X, sentence, of_covariance), "\n".join(lines), "yaml")


def _gtsam(X: Transform) -> Snippet:
    lines = ["import gtsam", "import numpy as np", "", _matrix("T", X.T), f"{X.name} = gtsam.Pose3(T)"]
    if X.covariance is not None:
        lines += [
            _matrix("covariance", np.asarray(X.covariance_in("gtsam"))),
            "noise = gtsam.noiseModel.Gaussian.Covariance(covariance)",
        ]
    of_covariance = (
        f"Covariance of xi in T = T_hat Exp(xi): rotation first, right perturbation, in the frame {X.child}, rad and m."
    )
    return Snippet(f"GTSAM: {X.name}", _with(X, "Pose3, metres.", of_covariance), "\n".join(lines), "python")


def urdf_joint(X: Transform, digits: int = 12) -> str:
    """The fixed joint that puts the child's link where X says."""
    xyz, rpy = (" ".join(f"{v:.{digits}g}" for v in values) for values in (X.t, fixed_axis_angles(X.R)))
    return (
        f'<joint name="{X.parent}_to_{X.child}" type="fixed">\n'
        f'  <parent link="{X.parent}"/>\n'
        f'  <child link="{X.child}"/>\n'
        f'  <origin xyz="{xyz}" rpy="{rpy}"/>\n'
        "</joint>"
    )


def _urdf(X: Transform) -> Snippet:
    return Snippet(
        f"URDF fixed joint: {X.name}",
        "xyz in metres; rpy in rad about the fixed axes x, y, z: R = Rz(yaw) Ry(pitch) Rx(roll). Put your own link "
        "names in. URDF has no place for a covariance.",
        urdf_joint(X),
        "xml",
    )


_FORMS = (_numpy, _opencv, _ros2, _ros1, _ros_pose, _gtsam, _urdf)
