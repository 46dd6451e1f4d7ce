"""Recordings of the rig in ``rig.npz`` as outside libraries write them, for `test_recorders`; run by hand.

Needs foxglove-sdk 0.30.3, mcap 1.6.0, mcap-protobuf-support 0.6.0 and rosbags 0.11.9:

    python write_recordings.py
"""

import json
from pathlib import Path

import foxglove
import numpy as np
from foxglove.channels import (
    CameraCalibrationChannel,
    FrameTransformChannel,
    FrameTransformsChannel,
    JointStatesChannel,
    PoseInFrameChannel,
)
from foxglove.messages import (
    CameraCalibration,
    FrameTransform,
    FrameTransforms,
    JointState,
    JointStates,
    Pose,
    PoseInFrame,
    Quaternion,
    Timestamp,
    Vector3,
)
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

HERE = Path(__file__).parent
RIG = np.load(HERE / "rig.npz")
TIMES = RIG["times"].tolist()
SIDES = (("base", "tool0", RIG["robot"]), ("camera", "board", RIG["camera"]))
INTRINSICS = [900.0, 0.0, 640.0, 0.0, 900.0, 360.0, 0.0, 0.0, 1.0]


def parts(T):
    return T[:3, 3].tolist(), Rotation.from_matrix(T[:3, :3]).as_quat().tolist()


def nanoseconds(t):
    return round(t * 1e9)


def foxglove_sdk():
    context = foxglove.Context()
    with foxglove.open_mcap(str(HERE / "foxglove.mcap"), context=context, allow_overwrite=True):
        tf = FrameTransformChannel("/robot", context=context)
        several = FrameTransformsChannel("/tf", context=context)
        board = PoseInFrameChannel("/board", context=context)
        joints = JointStatesChannel("/joints", context=context)
        camera = CameraCalibrationChannel("/calibration", context=context)
        for k, t in enumerate(TIMES):
            stamp, at = Timestamp(sec=int(t), nsec=nanoseconds(t - int(t))), {"log_time": nanoseconds(t + 0.02)}
            made = []
            for parent, child, poses in SIDES:
                x, q = parts(poses[k])
                x = Vector3(**dict(zip("xyz", x, strict=True)))
                q = Quaternion(**dict(zip("xyzw", q, strict=True)))
                frames = {"parent_frame_id": parent, "child_frame_id": child}
                made.append(FrameTransform(timestamp=stamp, **frames, translation=x, rotation=q))
            tf.log(made[0], **at)
            several.log(FrameTransforms(transforms=made[1:]), **at)
            board.log(PoseInFrame(timestamp=stamp, frame_id="camera", pose=Pose(position=x, orientation=q)), **at)
            values = [JointState(name=f"j{j}", position=v) for j, v in enumerate(RIG["joints"][k].tolist())]
            joints.log(JointStates(timestamp=stamp, joints=[*values, JointState(name="gripper")]), **at)
        lens = {"distortion_model": "plumb_bob", "D": [0.1, 0.0, 0.0, 0.0, 0.0], "K": INTRINSICS}
        camera.log(CameraCalibration(timestamp=stamp, frame_id="camera", width=1280, height=720, **lens), **at)


def in_json():
    with open(HERE / "json.mcap", "wb") as file:
        writer = McapWriter(file, compression=CompressionType.LZ4)
        writer.start()
        schema = json.dumps({"type": "object"}).encode()
        types = ("foxglove.FrameTransform", "foxglove.PoseInFrame")
        channels = [
            writer.register_channel(topic, "json", writer.register_schema(name, "jsonschema", schema))
            for topic, name in zip(("/robot", "/board"), types, strict=True)
        ]
        for k, t in enumerate(TIMES):
            stamp = {"sec": int(t), "nsec": nanoseconds(t - int(t))}
            (x, q), (y, p) = (parts(poses[k]) for *_, poses in SIDES)
            x, y = (dict(zip("xyz", one, strict=True)) for one in (x, y))
            q, p = (dict(zip("xyzw", one, strict=True)) for one in (q, p))
            frames = {"parent_frame_id": "base", "child_frame_id": "tool0"}
            robot = {"timestamp": stamp, **frames, "translation": x, "rotation": q}
            camera = {"timestamp": stamp, "frame_id": "camera", "pose": {"position": y, "orientation": p}}
            for channel, message in zip(channels, (robot, camera), strict=True):
                writer.add_message(channel, nanoseconds(t), json.dumps(message).encode(), nanoseconds(t))
        writer.finish()


def in_protobuf():
    """The types of Foxglove by the classes that Google's protobuf makes of them."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from google.protobuf.message_factory import GetMessages

    files = FileDescriptorSet()
    files.ParseFromString(FrameTransform.get_schema().data)
    Transform = GetMessages(files.file)["foxglove.FrameTransform"]
    with open(HERE / "protobuf.mcap", "wb") as file, ProtobufWriter(file) as writer:
        for k, t in enumerate(TIMES):
            for parent, child, poses in SIDES:
                message = Transform(parent_frame_id=parent, child_frame_id=child)
                message.timestamp.seconds, message.timestamp.nanos = int(t), nanoseconds(t - int(t))
                x, q = parts(poses[k])
                for field, names, values in (("translation", "xyz", x), ("rotation", "xyzw", q)):
                    for name, value in zip(names, values, strict=True):
                        setattr(getattr(message, field), name, value)
                writer.write_message(f"/{child}", message, nanoseconds(t), nanoseconds(t))


def of_ros(version):
    """PoseStamped of ROS 1 or 2 in a file without a profile."""
    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    kind, package = "geometry_msgs/msg/PoseStamped", "geometry_msgs/" + ("" if version == 1 else "msg/")
    text, _ = store.generate_msgdef(kind, ros_version=version)
    make = {name.rpartition("/")[2]: of for name, of in store.types.items() if "geometry" in name or "Header" in name}
    with open(HERE / f"ros{version}.mcap", "wb") as file:
        writer = McapWriter(file)
        writer.start()
        encoding = "ros1" if version == 1 else "cdr"
        schema = writer.register_schema(f"{package}PoseStamped", f"ros{version}msg", text.encode())
        channels = [writer.register_channel(topic, encoding, schema) for topic in ("/robot", "/board")]
        for k, t in enumerate(TIMES):
            for channel, (parent, _, poses) in zip(channels, SIDES, strict=True):
                stamp = store.types["builtin_interfaces/msg/Time"](sec=int(t), nanosec=nanoseconds(t - int(t)))
                more = {"seq": k} if version == 1 else {}
                x, q = parts(poses[k])
                message = make["PoseStamped"](
                    header=make["Header"](stamp=stamp, frame_id=parent, **more),
                    pose=make["Pose"](position=make["Point"](*x), orientation=make["Quaternion"](*q)),
                )
                data = store.serialize_ros1(message, kind) if version == 1 else store.serialize_cdr(message, kind)
                writer.add_message(channel, nanoseconds(t), bytes(data), nanoseconds(t))
        writer.finish()


if __name__ == "__main__":
    foxglove_sdk()
    in_json()
    in_protobuf()
    of_ros(1)
    of_ros(2)
