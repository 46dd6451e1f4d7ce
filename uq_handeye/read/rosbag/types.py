"""Message types that are read, and their definitions where a bag has none.

Definitions in a bag come from outside: only names and types of fields are taken from them, if they are names.
"""

from __future__ import annotations

import re
from typing import Any

POSES = {
    *("geometry_msgs/msg/" + name for name in ("Pose", "PoseStamped", "PoseArray", "Transform", "TransformStamped")),
    *("geometry_msgs/msg/" + name for name in ("PoseWithCovariance", "PoseWithCovarianceStamped")),
    "nav_msgs/msg/Odometry",
}
TRANSFORMS = {"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"}
JOINTS, INFO = "sensor_msgs/msg/JointState", "sensor_msgs/msg/CameraInfo"
# Tags and markers, by the last part of the type: several packages have messages of these names.
TAGS = ("AprilTagDetectionArray", "ArucoMarkers", "ArucoDetection")
MARKERS = {"aruco_msgs/msg/MarkerArray", "aruco_msgs/msg/Marker"}

# Fields as in christianrauch/apriltag_msgs, pal-robotics/aruco_ros, fictionlab/ros_aruco_opencv and
# JMU-ROBOTICS-VIVA/ros2_aruco; for bags of ROS 2 that hold no definitions.
DEFINITIONS = {
    "apriltag_msgs/msg/Point": "float64 x\nfloat64 y\n",
    "apriltag_msgs/msg/AprilTagDetection": (
        "string family\nint32 id\nint32 hamming\nfloat32 goodness\nfloat32 decision_margin\n"
        "apriltag_msgs/Point centre\napriltag_msgs/Point[4] corners\nfloat64[9] homography\n"
    ),
    "apriltag_msgs/msg/AprilTagDetectionArray": (
        "std_msgs/Header header\napriltag_msgs/AprilTagDetection[] detections\n"
    ),
    "aruco_msgs/msg/Marker": (
        "std_msgs/Header header\nuint32 id\ngeometry_msgs/PoseWithCovariance pose\nfloat64 confidence\n"
    ),
    "aruco_msgs/msg/MarkerArray": "std_msgs/Header header\naruco_msgs/Marker[] markers\n",
    "aruco_opencv_msgs/msg/MarkerPose": "uint16 marker_id\ngeometry_msgs/Pose pose\n",
    "aruco_opencv_msgs/msg/BoardPose": "string board_name\ngeometry_msgs/Pose pose\n",
    "aruco_opencv_msgs/msg/ArucoDetection": (
        "std_msgs/Header header\naruco_opencv_msgs/MarkerPose[] markers\naruco_opencv_msgs/BoardPose[] boards\n"
    ),
    "ros2_aruco_interfaces/msg/ArucoMarkers": (
        "std_msgs/Header header\nint64[] marker_ids\ngeometry_msgs/Pose[] poses\n"
    ),
}

_NAME, _TYPE = re.compile(r"[A-Za-z]\w*"), re.compile(r"[A-Za-z]\w*(/msg/[A-Za-z]\w*)?")


def kind_of(msgtype: str) -> str | None:
    """Return what a topic of this type is read as: poses, transforms, joints, info or tags; None: it is not read."""
    if msgtype in POSES:
        return "poses"
    if msgtype in TRANSFORMS:
        return "transforms"
    if msgtype in MARKERS or msgtype.rpartition("/")[2] in TAGS:
        return "tags"
    return {JOINTS: "joints", INFO: "info"}.get(msgtype)


class Types:
    """Types of the messages of one bag, registered when they are asked for."""

    def __init__(self, ros2: bool) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.ros2 = ros2
        self.known = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
        for name, text in DEFINITIONS.items():
            if name not in self.known.fielddefs:
                self.known.register(get_types_from_msg(text, name))
        self.stores: dict[str, Any] = {}

    def decode(self, data: bytes, msgtype: str) -> Any:
        """Return the message as an object with its fields."""
        store = self.stores[msgtype]
        return store.deserialize_cdr(data, msgtype) if self.ros2 else store.deserialize_ros1(data, msgtype)

    def require(self, msgtype: str, definition: Any) -> bool:
        """Make a type known, by the definition in the bag if there is one; False: there is none anywhere."""
        if msgtype in self.stores:
            return True
        from rosbags.interfaces import MessageDefinitionFormat
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

        text = definition.data
        if definition.format == MessageDefinitionFormat.NONE or not text:
            if msgtype not in self.known.fielddefs:
                return False
            self.stores[msgtype] = self.known
            return True
        if definition.format == MessageDefinitionFormat.MSG:
            found = get_types_from_msg(text, msgtype)
        else:
            found = {}
            for part in re.split(r"^=+\nIDL: .*\n", text, flags=re.MULTILINE):
                found |= get_types_from_idl(part) if part.strip() else {}
        store = get_typestore(Stores.EMPTY)
        store.register({name: ([], _checked(name, fields)) for name, (_, fields) in found.items()})
        self.stores[msgtype] = store
        return True


def _checked(name: str, fields: Any) -> Any:
    """Return the fields of a definition if all names and types in it are names; raises `ValueError` otherwise."""

    def require(value: Any, depth: int = 0) -> None:
        if isinstance(value, str):
            if value and not _TYPE.fullmatch(value):
                raise ValueError(f"definition of {name[:60]}: {value[:60]!r} is no name")
        elif isinstance(value, tuple | list) and depth < 8:
            for part in value:
                require(part, depth + 1)
        elif not isinstance(value, int) or depth >= 8:
            raise ValueError(f"definition of {name[:60]}: {type(value).__name__} in place of a type")

    if not _TYPE.fullmatch(name):
        raise ValueError(f"definition of {name[:60]!r}: no name of a type")
    for field, kind in fields:
        if not _NAME.fullmatch(field):
            raise ValueError(f"definition of {name}: {field[:60]!r} is no name")
        require(kind)
    return fields
