"""Types of ROS messages: which of them are read, and how the messages of a bag are decoded.

A bag usually holds the definitions of its types. Where it does not, the definitions are those of rosbags and of
``messages.toml``. rosbags compiles a definition into Python code, and the definition comes with an untrusted file:
therefore only names of fields and names of types are accepted (`Types.require`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ...core.files.trees import parse_toml

if TYPE_CHECKING:
    from rosbags.interfaces import MessageDefinition
    from rosbags.interfaces.typing import Fielddefs, Typesdict
    from rosbags.typesys.store import Typestore

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

# What the messages of a type are read as.
_KINDS = {
    **dict.fromkeys(POSES, "poses"),
    **dict.fromkeys(TRANSFORMS, "transforms"),
    **dict.fromkeys((*MARKERS, *TAGS), "tags"),
    JOINTS: "joints",
    INFO: "info",
}
_NAME, _TYPE = re.compile(r"[A-Za-z]\w*"), re.compile(r"[A-Za-z]\w*(/msg/[A-Za-z]\w*)?")

# A decoded message: an instance of a class that rosbags makes of the definition. Its fields are read by `part`.
RosMessage: TypeAlias = Any


def kind_of(msgtype: str) -> str | None:
    """Return what messages of this type are read as: poses, transforms, joints, info or tags; None: they are not."""
    return _KINDS.get(msgtype) or _KINDS.get(msgtype.rpartition("/")[2])


@cache
def definitions() -> dict[str, str]:
    """Return the fields of messages by type, for bags of ROS 2 that hold no definitions."""
    return parse_toml(Path(__file__).with_name("messages.toml"))


class Types:
    """Types of the messages of one bag, registered when they are first needed."""

    def __init__(self, ros2: bool) -> None:
        from rosbags import typesys

        self.ros2, self.typesys = ros2, typesys
        self.known = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE if ros2 else typesys.Stores.ROS1_NOETIC)
        for name, text in definitions().items():
            if name not in self.known.fielddefs:
                self.known.register(typesys.get_types_from_msg(text, name))
        self.stores: dict[str, Typestore] = {}

    def decode(self, data: bytes, msgtype: str) -> RosMessage:
        """Return the message with its fields as attributes."""
        store = self.stores[msgtype]
        return store.deserialize_cdr(data, msgtype) if self.ros2 else store.deserialize_ros1(data, msgtype)

    def require(self, msgtype: str, definition: MessageDefinition) -> bool:
        """Register a type, by the definition in the bag if there is one; False: there is no definition anywhere."""
        form, text = definition.format.name, definition.data
        if msgtype in self.stores:
            return True
        if form == "NONE" or not text:
            if msgtype in self.known.fielddefs:
                self.stores[msgtype] = self.known
            return msgtype in self.stores
        found: Typesdict = {}
        if form == "MSG":
            found = dict(self.typesys.get_types_from_msg(text, msgtype))
        else:
            for part in re.split(r"^=+\nIDL: .*\n", text, flags=re.MULTILINE):
                found |= self.typesys.get_types_from_idl(part) if part.strip() else {}
        store = self.typesys.get_typestore(self.typesys.Stores.EMPTY)
        store.register({name: ([], _checked(name, fields)) for name, (_, fields) in found.items()})
        self.stores[msgtype] = store
        return True


def _checked(name: str, fields: Fielddefs) -> Fielddefs:
    """Return the fields of a definition if all names and types in it are names; raises `ValueError` otherwise."""
    if not _TYPE.fullmatch(name):
        raise ValueError(f"definition of {name[:60]!r}: no name of a type")
    for field, kind in fields:
        if not _NAME.fullmatch(field):
            raise ValueError(f"definition of {name}: {field[:60]!r} is no name")
        for value in _leaves(kind):
            if type(value) is str and value and not _TYPE.fullmatch(value):
                raise ValueError(f"definition of {name[:60]}: {value[:60]!r} is no name")
            if not isinstance(value, str | int):
                raise ValueError(f"definition of {name[:60]}: {type(value).__name__} in place of a type")
    return fields


def _leaves(value: Any) -> Iterator[Any]:
    """Yield the entries of nested tuples and lists."""
    if type(value) not in (tuple, list):
        yield value
        return
    for part in value:
        yield from _leaves(part)
