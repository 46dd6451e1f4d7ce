"""Bags written for the tests, of ROS 1 and ROS 2, by the library that also reads them."""

import numpy as np
from scipy.spatial.transform import Rotation

from uq_handeye.model.camera.description import tag_points
from uq_handeye.read.rosbag.message_types import definitions as known

START = 1_700_000_000.0
KINDS = ("ros1", "sqlite3", "mcap")
SIZE, FOCAL, CENTRE = (1280, 720), 900.0, (640.0, 360.0)


class Writer:
    """One bag that is being written: ``add(topic, kind, time, ...)``."""

    def __init__(self, folder, kind, name="cell", definitions=None):
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.kind, self.connections = kind, {}
        self.store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
        more = {"tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n"} if kind == "ros1" else {}
        for name_of, text in (more | (definitions or known())).items():
            self.store.register(get_types_from_msg(text, name_of))
        if kind == "ros1":
            from rosbags.rosbag1 import Writer as Writer1

            self.path = folder / f"{name}.bag"
            self.writer = Writer1(self.path)
        else:
            from rosbags.rosbag2 import StoragePlugin
            from rosbags.rosbag2 import Writer as Writer2

            self.path = folder / name
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self.writer = Writer2(self.path, version=9, storage_plugin=plugin)

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *_):
        self.writer.close()

    def type(self, name):
        return self.store.types[name]

    def write(self, topic, message, time):
        name = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, name, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.kind == "ros1" else self.store.serialize_cdr
        self.writer.write(self.connections[topic], round(time * 1e9), serialize(message, name))

    def header(self, time, frame):
        whole = int(np.floor(time))
        stamp = self.type("builtin_interfaces/msg/Time")(sec=whole, nanosec=round((time - whole) * 1e9))
        more = {"seq": 0} if self.kind == "ros1" else {}
        return self.type("std_msgs/msg/Header")(**more, stamp=stamp, frame_id=frame)

    def parts(self, T):
        q = Rotation.from_matrix(T[:3, :3]).as_quat()
        return T[:3, 3].tolist(), self.type("geometry_msgs/msg/Quaternion")(*q.tolist())

    def pose(self, T):
        t, q = self.parts(T)
        return self.type("geometry_msgs/msg/Pose")(position=self.type("geometry_msgs/msg/Point")(*t), orientation=q)

    def transform(self, time, parent, child, T):
        t, q = self.parts(T)
        inner = self.type("geometry_msgs/msg/Transform")(self.type("geometry_msgs/msg/Vector3")(*t), q)
        return self.type("geometry_msgs/msg/TransformStamped")(self.header(time, parent), child, inner)

    def tf(self, time, *edges, static=False):
        """Write the edges (parent, child, T) as one message."""
        message = self.type("tf2_msgs/msg/TFMessage")([self.transform(time, *edge) for edge in edges])
        self.write("/tf_static" if static else "/tf", message, time)

    def pose_stamped(self, topic, time, frame, T):
        self.write(topic, self.type("geometry_msgs/msg/PoseStamped")(self.header(time, frame), self.pose(T)), time)

    def joints(self, topic, time, names, values):
        none = np.zeros(0)
        message = self.type("sensor_msgs/msg/JointState")(
            self.header(time, ""), names, np.array(values, dtype=float), none, none
        )
        self.write(topic, message, time)

    def camera_info(self, topic, time, frame, distortion=()):
        f, (cx, cy) = FOCAL, CENTRE
        K = np.array([f, 0, cx, 0, f, cy, 0, 0, 1.0])
        P = np.array([f, 0, cx, 0, 0, f, cy, 0, 0, 0, 1.0, 0])
        names = ("D", "K", "R", "P") if self.kind == "ros1" else ("d", "k", "r", "p")
        values = (np.array(distortion or [0.0] * 5), K, np.eye(3).ravel(), P)
        roi = self.type("sensor_msgs/msg/RegionOfInterest")(0, 0, 0, 0, False)
        more = {"binning_x": 0, "binning_y": 0, "roi": roi, "distortion_model": "plumb_bob"}
        message = self.type("sensor_msgs/msg/CameraInfo")(
            header=self.header(time, frame),
            width=SIZE[0],
            height=SIZE[1],
            **dict(zip(names, values, strict=True)),
            **more,
        )
        self.write(topic, message, time)

    def detections(self, topic, time, frame, tags):
        """Write tags by number and pixels (4, 2) in the order of the AprilTag library, whose first pixel is at 0.5."""
        point = self.type("apriltag_msgs/msg/Point")
        found = [
            self.type("apriltag_msgs/msg/AprilTagDetection")(
                "tag36h11", number, 0, 0.0, 50.0, point(*pixels.mean(axis=0).tolist()),
                [point(*pixel.tolist()) for pixel in pixels + 0.5], np.zeros(9),
            )
            for number, pixels in tags
        ]  # fmt: skip
        message = self.type("apriltag_msgs/msg/AprilTagDetectionArray")(self.header(time, frame), found)
        self.write(topic, message, time)


def stamped(times):
    """Return times as a stamp of nanoseconds holds and returns them."""
    whole = np.floor(times)
    return whole + 1e-9 * np.round((times - whole) * 1e9)


def pixels_of(poses, side, noise=0.0, rng=None):
    """Return pixels (n, 4, 2) of a tag in the order of the AprilTag library: counter-clockwise from the lower left."""
    points = tag_points(side)[::-1]
    at = points @ np.swapaxes(poses[:, :3, :3], 1, 2) + poses[:, None, :3, 3]
    pixels = FOCAL * at[..., :2] / at[..., 2:] + CENTRE
    return pixels if rng is None else pixels + noise * rng.normal(size=pixels.shape)
