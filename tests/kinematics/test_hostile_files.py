"""Files of arms and joints with pieces exchanged: they are read, or refused in one line of words."""

import os
import tempfile
import warnings

import numpy as np
import pytest
from fixtures.arms import SIX_AXES
from hypothesis import given, settings
from hypothesis import strategies as st
from kinematics.poses_of_mujoco import MODELS

from uq_handeye.errors import InputError, InputWarning
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.model.kinematics.joints_file import read_joints

DH = b"""# convention: standard
joint,theta,d [mm],a [mm],alpha [deg],type,lower,upper,offset
a,q1,89,0,90,,-3,3,
b,*,0,9,0,r,,,0
"""
TOML = b'convention = "modified"\nup = [0, 0, 1]\nangle = "deg"\n[[joints]]\nname = "a"\nd = "89mm"\nupper = 90\n'
YAML = b"kinematics:\n" + b"".join(
    b"  %s: {x: 0, y: 0, z: 0.1, roll: 1.5, pitch: 0, yaw: 0}\n" % link
    for link in (b"shoulder", b"upper_arm", b"forearm", b"wrist_1", b"wrist_2", b"wrist_3")
)
CSV = b"%time,elbow_1_deg,frame,/js/shoulder/position [deg]\n"
CSV += b"1000,30.5,base_link,0.5\n2000,20.5,base_link,0.1\n"
ROS = b"%time,field.name0,field.name1,field.position0,field.position1\n1,shoulder,elbow_1,0.1,-1\n"
ODD = (
    *(b"nan", b"-inf", b"1e308", b"", b"[", b"}", b",", b";", b"\n", b'"', b"<", b">", b"0" * 400, b"\xff", b"\0"),
    *(
        b"1_0",
        b" [deg]",
        b"_mm",
        b"#",
        b"&x;",
        b"\xce\xb8",
        b"position99999999999",
        b"true",
        b"q1",
        b"<mimic/>",
        b"name",
    ),
)
PIECES = st.sampled_from(ODD)


def joints(path):
    return read_joints(path, ["shoulder", "elbow_1"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("read", "seed", "suffix"),
    [
        (Kinematics.from_urdf, SIX_AXES.encode(), "urdf"),
        (Kinematics.from_mjcf, MODELS["radians"][0].encode(), "xml"),
        (Kinematics.from_dh, DH, "csv"),
        (Kinematics.from_dh, TOML, "toml"),
        (Kinematics.from_ur_calibration, YAML, "yaml"),
        (joints, CSV, "csv"),
        (joints, ROS, "csv"),
    ],
    ids=["urdf", "mjcf", "dh", "toml", "ur", "joints", "ros"],
)
def test_exchanged_pieces(read, seed, suffix):
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, f"file.{suffix}")

        def reads(data):
            with open(path, "wb") as file:
                file.write(data)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", InputWarning)
                return read(path)

        assert reads(seed) is not None

        @settings(max_examples=40, deadline=None, database=None)
        @given(st.lists(st.tuples(st.integers(0, len(seed)), st.integers(0, 20), PIECES), min_size=1, max_size=3))
        def exchange(changes):
            data = seed
            for start, length, piece in changes:
                data = data[:start] + piece + data[start + length :]
            message, found = "", None
            try:
                found = reads(data)
            except InputError as error:
                message = str(error)
            assert "\n" not in message and len(message) < 1000
            if found is not None:
                assert np.isfinite(found.q if hasattr(found, "q") else found.poses(np.zeros(found.n_joints))).all()

        exchange()
