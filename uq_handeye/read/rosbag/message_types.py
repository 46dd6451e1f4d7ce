"""Types of messages: which of them are read, and how the messages of a recording are decoded.

Those of ROS in CDR or the encoding of ROS 1; in MCAP files also those of Foxglove, and any of them in JSON. Foxglove's
messages are in Protocol Buffers (`protobuf`) or JSON; their fields are those of foxglove/foxglove-sdk, ``schemas``.

A bag usually holds the definitions of its types. Where it does not, the definitions are those of rosbags and of
``messages.toml``. rosbags compiles a definition into Python code, and the definition comes with an untrusted file:
therefore only names of fields and names of types are accepted (`Types.require`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ...core.files.trees import parse_toml, parse_tree
from ...core.limits import MAX_MESSAGE_BYTES
from ...formats.ros_messages import printed_name
from .decompression import DamagedError
from .mcap import McapChannel
from .protobuf import MessageTypes

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.interfaces.typing import Fielddefs, Typesdict
    from rosbags.typesys.store import Typestore

POSES = {
    *("geometry_msgs/msg/" + name for name in ("Pose", "PoseStamped", "PoseArray", "Transform", "TransformStamped")),
    *("geometry_msgs/msg/" + name for name in ("PoseWithCovariance", "PoseWithCovarianceStamped")),
    "nav_msgs/msg/Odometry",
}
TRANSFORMS = {"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"}
JOINTS, INFO = "sensor_msgs/msg/JointState", "sensor_msgs/msg/CameraInfo"
FOXGLOVE = {
    **dict.fromkeys(("FrameTransform", "FrameTransforms"), "transforms"),
    **dict.fromkeys(("PoseInFrame", "PosesInFrame", "Odometry"), "poses"),
    "JointStates": "joints",
    "CameraCalibration": "info",
}
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
    **{f"{package}{name}": kind for name, kind in FOXGLOVE.items() for package in ("foxglove.", "foxglove_msgs/msg/")},
}
_NAME, _TYPE = re.compile(r"[A-Za-z]\w*"), re.compile(r"[A-Za-z]\w*(/msg/[A-Za-z]\w*)?")

# A decoded message: a dict, or an instance of a class that rosbags makes of the definition. `part` reads its fields.
RosMessage: TypeAlias = Any
Decoder: TypeAlias = Callable[[bytes], RosMessage]
# Definitions of the messages of ROS, by the names that MCAP gives them.
ROS_FORMS = {"ros1msg": "MSG", "ros2msg": "MSG", "ros2idl": "IDL", "omgidl": "IDL", "": "NONE"}


class NotRead(Exception):
    """Error of a topic whose messages cannot be read: why, in a few words."""


def kind_of(msgtype: str) -> str | None:
    """Return what messages of this type are read as: poses, transforms, joints, info or tags; None: they are not."""
    return _KINDS.get(msgtype) or _KINDS.get(msgtype.rpartition("/")[2])


def type_name(name: str) -> str:
    """Return the name of a type of ROS 1 as that of ROS 2, ``geometry_msgs/msg/Pose``; others as they are."""
    package, mark, of = name.partition("/")
    return f"{package}/msg/{of}" if mark and "/" not in of else name


@cache
def definitions() -> dict[str, str]:
    """Return the fields of messages by type, for bags of ROS 2 that hold no definitions."""
    return parse_toml(Path(__file__).with_name("messages.toml"))


class Types:
    """Types of the messages of one bag, registered when they are first needed."""

    def __init__(self, ros2: bool) -> None:
        from rosbags import typesys

        self.ros2, self.typesys = ros2, typesys
        self.known: dict[bool, Typestore] = {}  # by whether they are of ROS 2
        self.stores: dict[tuple[str, bool, str], Typestore] = {}

    def decoder(self, one: Connection | McapChannel) -> Decoder:
        """Return the function that decodes the messages of a topic.

        Raises `NotRead` where there is none, and whatever a library raises of a damaged definition.
        """
        name = type_name(one.msgtype)
        if not isinstance(one, McapChannel):
            return self._of_ros(name, one.msgdef.format.name, one.msgdef.data, self.ros2)
        if not one.msgtype:
            raise NotRead(f"messages in {one.encoding or 'no encoding'} without their schema")
        if one.encoding == "json":
            return parse_message
        if one.encoding == "protobuf":
            if one.schema_encoding != "protobuf" or not one.schema:
                raise NotRead("messages in protobuf without their schema")
            return MessageTypes(one.schema).decoder(one.msgtype)
        if one.encoding not in ("cdr", "ros1") or one.schema_encoding not in ROS_FORMS:
            form = f"{one.encoding} with definitions in {one.schema_encoding}" if one.schema_encoding else one.encoding
            raise NotRead(f"messages in {printed_name(form) or 'no encoding'}, which is not read")
        text = one.schema.decode(errors="replace")
        return self._of_ros(name, ROS_FORMS[one.schema_encoding], text, one.encoding == "cdr")

    def _of_ros(self, msgtype: str, form: str, text: str, ros2: bool) -> Decoder:
        """Return the decoder of a type of ROS, by the definition in the bag if there is one."""
        key = msgtype, ros2, text
        if key not in self.stores:
            known = self._known(ros2) if form == "NONE" or not text else None
            if known is not None and msgtype not in known.fielddefs:
                raise NotRead("no definition of its type in the bag")
            self.stores[key] = known or self._defined(msgtype, form, text)
        store = self.stores[key]
        decode = store.deserialize_cdr if ros2 else store.deserialize_ros1
        return lambda data: decode(data, msgtype)

    def _known(self, ros2: bool) -> Typestore:
        """Return the types that need no definition in the bag."""
        if ros2 not in self.known:
            stores = self.typesys.Stores
            store = self.typesys.get_typestore(stores.ROS2_HUMBLE if ros2 else stores.ROS1_NOETIC)
            for name, text in definitions().items():
                if name not in store.fielddefs:
                    store.register(self.typesys.get_types_from_msg(text, name))
            self.known[ros2] = store
        return self.known[ros2]

    def _defined(self, msgtype: str, form: str, text: str) -> Typestore:
        """Return the types of a definition."""
        found: Typesdict = {}
        if form == "MSG":
            found = dict(self.typesys.get_types_from_msg(text, msgtype))
        else:
            for part in re.split(r"^=+\nIDL: .*\n", text, flags=re.MULTILINE):
                found |= self.typesys.get_types_from_idl(part) if part.strip() else {}
        store = self.typesys.get_typestore(self.typesys.Stores.EMPTY)
        store.register({name: ([], _checked(name, fields)) for name, (_, fields) in found.items()})
        return store


def parse_message(data: bytes) -> RosMessage:
    """Return a message in JSON as nested dicts."""
    if len(data) > MAX_MESSAGE_BYTES:
        raise DamagedError(f"a message of more than {MAX_MESSAGE_BYTES / 1e6:g} MB")
    return parse_tree(bytes(data), "a message in JSON")


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
