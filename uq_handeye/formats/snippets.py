"""X and its inverse as texts to copy into other programs, each with its convention and units.

Numbers have twelve significant digits. Sources of the rules: NumPy; OpenCV, ``calibrateHandEye`` (docs.opencv.org,
calib3d); ROS, ``static_transform_publisher`` (ros2/geometry2, ``tf2_ros/src/static_transform_broadcaster_program.cpp``)
and ``geometry_msgs/msg/PoseWithCovariance.msg`` (ros2/common_interfaces); GTSAM, ``gtsam/geometry/Pose3.h``
(borglab/gtsam); URDF, ``<origin>`` of ``<joint>`` (wiki.ros.org/urdf/XML/joint). All exports take from here the frames
by name, and the quaternion and the angles about fixed axes of a pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import numpy as np

from ..core.geometry.conventions import TOOLKIT, to_convention
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array, inverse_jacobian
from ..core.presentation.html import macros
from ..core.presentation.numbers import Snippet, short
from ..core.read_only import ReadOnlyArrays
from .opencv_storage import matrix_lines, yaml_number

# The frames of X for motions that came without poses: those in which A and B are given.
OF_MOTIONS = ("frame_of_A", "frame_of_B")

# Standard deviation (m) along open directions in formats that have no infinity.
OPEN_SD_M = 1e3

OWN_FRAMES = "Put the names of your own frames in; the camera is the frame with z forward, which ROS calls optical."
AXES = ("x", "y", "z", "qx", "qy", "qz", "qw")

NOT_DETERMINED = "The covariance is not determined, so it is left out."


class Open(Protocol):
    """Directions of X and W that the motions do not determine, and the length that compares angles with them."""

    @property
    def basis(self) -> Array: ...
    @property
    def of_X(self) -> Array: ...
    @property
    def lever(self) -> float: ...


class Exportable(Protocol):
    """The parts of a calibration that exports hold: X and W with their covariances, and what was not determined."""

    @property
    def X(self) -> Array: ...
    @property
    def inverse(self) -> Array: ...
    @property
    def covariance(self) -> Array | None: ...
    @property
    def covariance_inverse(self) -> Array | None: ...
    @property
    def W(self) -> Array | None: ...
    @property
    def covariance_W(self) -> Array | None: ...
    @property
    def setup(self) -> str | None: ...
    @property
    def frame(self) -> str: ...
    @property
    def frame_W(self) -> str: ...
    @property
    def opened(self) -> Open | None: ...
    @property
    def open_words(self) -> Sequence[str]: ...
    @property
    def intrinsics_words(self) -> str | None: ...
    def to_json(self) -> str: ...


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


def transforms_of(result: Exportable) -> tuple[Transform, Transform]:
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
    """Covariance (6, 6) with `OPEN_SD_M` along the open directions U (k, 6)."""
    return np.asarray(covariance + OPEN_SD_M**2 * (U.T @ U))


def comments_of(result: Exportable) -> list[str]:
    """Return the comments of an export about the intrinsics that X belongs to, and about open directions."""
    camera = [] if result.intrinsics_words is None else [result.intrinsics_words]
    if result.opened is None:
        return camera
    return [
        *camera,
        f"Open, not determined by the motions: {'; '.join(result.open_words)}.",
        f"Along these the covariance has a standard deviation of {OPEN_SD_M:g} m (angles: times "
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


def yaml_fields(axes: str, values: Array, digits: int | None = None) -> str:
    """``{x: 1.0, y: 2.0, z: 3.0}``."""
    fields = (f"{axis}: {yaml_number(value, digits)}" for axis, value in zip(axes, values, strict=True))
    return f"{{{', '.join(fields)}}}"


def opencv_name(X: Transform) -> str:
    """Return the name of ``parent_T_child`` as OpenCV writes the frames: ``cam2gripper``."""
    short_names = {"camera": "cam"}
    return f"{short_names.get(X.child, X.child)}2{short_names.get(X.parent, X.parent)}"


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


@cache
def template() -> Any:
    """Return the macros of ``exports.j2``."""
    return macros(
        __package__,
        "exports.j2",
        html=False,
        NOT_DETERMINED=NOT_DETERMINED,
        OWN_FRAMES=OWN_FRAMES,
        fields=yaml_fields,
        numbers=lambda row, digits=None: ", ".join(yaml_number(value, digits) for value in row),
        short=short,
        shorts=lambda row, mark: mark.join(map(short, row)),
        joint=urdf_joint,
        opencv_name=opencv_name,
        matrix=lambda name, values: "\n".join(matrix_lines(name, values.reshape(len(values), -1))),
        axes=lambda X: dict(zip(AXES, [*X.t.tolist(), *X.quaternion.tolist()], strict=True)).items(),
        links=lambda poses: dict.fromkeys(name for X in poses for name in (X.parent, X.child)),
    )


_OURS = f"Covariance of {TOOLKIT} {{parent}}."
# Macro and language of each form, its title, what it is, and what its covariance is where it has a place for one.
_FORMS = (
    ("numpy", "python", "NumPy: {name}",
        "4x4 matrix, metres; maps points of {child} into {parent}: p_{parent} = {name} p_{child}.", _OURS),
    ("cv2", "python", "OpenCV: {name}",
        "R (3x3) and t (3x1, metres) as of cv::calibrateHandEye: p_{parent} = R p_{child} + t.",
        "Covariance of (rvec, t), in the order of stdDeviationsExtrinsics: the numbers of the rotation vector of R, "
        "rad, and t, m."),
    ("ros2", "bash", "ROS 2 static transform: {name}",
        "Metres and unit quaternion. Put your own frame names in: the camera is the frame with z forward, which ROS "
        "calls optical. It carries no covariance.", ""),
    ("ros1", "bash", "ROS 1 static transform: {name}",
        "x y z qx qy qz qw: metres and unit quaternion, scalar last; put your own frame names in. It carries no "
        "covariance.", ""),
    ("ros_pose", "yaml", "ROS {message}: {name}",
        "geometry_msgs/{message} of {child} in {parent}, metres and unit quaternion.",
        "Covariance 6x6 row by row, of (x, y, z, rotation about x, y, z): translation first, about the fixed axes of "
        "{parent}, m and rad."),
    ("gtsam", "python", "GTSAM: {name}", "Pose3, metres.",
        "Covariance of xi in T = T_hat Exp(xi): rotation first, right perturbation, in the frame {child}, rad and m."),
    ("urdf_joint", "xml", "URDF fixed joint: {name}",
        "xyz in metres; rpy in rad about the fixed axes x, y, z: R = Rz(yaw) Ry(pitch) Rx(roll). Put your own link "
        "names in. URDF has no place for a covariance.", ""),
)  # fmt: skip


def texts(result: Exportable) -> list[Snippet]:
    """NumPy, OpenCV, ROS, GTSAM and URDF forms of X, then of its inverse."""
    found = []
    for X in transforms_of(result):
        words = {"name": X.name, "parent": X.parent, "child": X.child}
        words["message"] = "Pose" if X.covariance is None else "PoseWithCovariance"
        for macro, language, title, what, of_covariance in _FORMS:
            said = NOT_DETERMINED if of_covariance and X.covariance is None else of_covariance
            sentence = f"{what} {said}".strip().format(**words)
            text = str(getattr(template(), macro)(X)).rstrip("\n")
            found.append(Snippet(title.format(**words), sentence, text, language))
    return found
