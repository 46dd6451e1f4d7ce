#!/usr/bin/env bash
# rosbags 0.11.9: an MCAP file with messages and definitions of ROS 2 is refused because of its profile.
#
# The profile in the header of an MCAP file is optional; it says which metadata channels have, while the encoding of a
# channel and of its definition say how to read its messages (mcap.dev/spec). Expected: a file with the encodings "cdr" and
# "ros2msg" is read. Seen: mcap 1.6.0 and foxglove-sdk 0.30.3 write the profile "" by default, and rosbags refuses the
# file ("Profile is not ros2."). With profile "ros2" the same messages are read.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "rosbags==0.11.9" "mcap==1.6.0" "foxglove-sdk==0.30.3" || exit 2
cd "$folder"
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version
from pathlib import Path

import foxglove
from foxglove.channels import PoseInFrameChannel
from foxglove.messages import PoseInFrame
from mcap.writer import Writer
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

print(", ".join(f"{name} {version(name)}" for name in ("rosbags", "mcap", "foxglove-sdk")))
store, kind = get_typestore(Stores.ROS2_HUMBLE), "geometry_msgs/msg/Point"
text, _ = store.generate_msgdef(kind, ros_version=2)
data = bytes(store.serialize_cdr(store.types[kind](1.0, 2.0, 3.0), kind))


def profile_of(path):
    """Return the profile in the header: behind the magic (8 bytes), opcode (1), length (8) and its own length (4)."""
    head = Path(path).read_bytes()[:100]
    return head[21 : 21 + int.from_bytes(head[17:21], "little")].decode()


def read(path):
    try:
        with Reader(Path(path)) as reader:
            return f"{len(list(reader.messages()))} message"
    except Exception as error:
        return str(error)


seen = []
for profile in (None, "ros2"):
    with open("points.mcap", "wb") as file:
        writer = Writer(file)
        writer.start(*([] if profile is None else [profile]))
        channel = writer.register_channel("/point", "cdr", writer.register_schema(kind, "ros2msg", text.encode()))
        writer.add_message(channel, 1, data, 1)
        writer.finish()
    seen.append((profile_of("points.mcap"), read("points.mcap")))
    print(f"profile {seen[-1][0]!r}: {seen[-1][1]}")
context = foxglove.Context()
with foxglove.open_mcap("foxglove.mcap", context=context):
    PoseInFrameChannel("/pose", context=context).log(PoseInFrame(frame_id="camera"))
print(f"foxglove-sdk writes the profile {profile_of('foxglove.mcap')!r}")
right = seen == [("", "Profile is not ros2."), ("ros2", "1 message")] and profile_of("foxglove.mcap") == ""
print("as described" if right else "the behaviour has changed")
sys.exit(0 if right else 1)
PY
