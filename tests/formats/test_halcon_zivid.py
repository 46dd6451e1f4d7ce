"""Poses of HALCON and Zivid, one file per pose: by their own definitions, written out here."""

import json

import numpy as np
import pytest
from fixtures.matrix_texts import rig_of, rotation

from uq_handeye.errors import InputError
from uq_handeye.formats.detect import read_contents
from uq_handeye.formats.matrices.halcon import ALL_CODES
from uq_handeye.read import read_poses

ROBOT, CAMERA = rig_of(8)
RX, RY, RZ = ((lambda angle, axis=axis: rotation(axis, np.radians(angle))) for axis in np.eye(3))


def halcon_matrix(code, r, t):
    """HALCON: gba Rx Ry Rz, abg Rz Ry Rx, rodriguez tan(angle / 2); 8: R (p - T); 1: angles the other way."""
    r = -np.array(r) if code & 1 else np.array(r)
    if code & 6 == 4:
        length = np.linalg.norm(r)
        R = rotation(r / length, 2 * np.arctan(length))
    else:
        factors = [about(angle) for about, angle in zip((RX, RY, RZ), r, strict=True)]
        R = np.linalg.multi_dot(factors if code & 6 == 0 else factors[::-1])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, -R @ t if code & 8 else t
    return T


def text_of(code, r, t):
    return (
        "# 3D POSE PARAMETERS: rotation and translation\r\n\r\n# Used representation type:\r\n"
        f"f {code}\r\n\r\n# Rotation angles [deg] or Rodriguez vector:\r\nr {r[0]!r} {r[1]!r} {r[2]!r}\r\n\r\n"
        f"# Translation vector (x y z [m]):\r\nt {t[0]!r} {t[1]!r} {t[2]!r}\r\n"
    )


@pytest.mark.slow
@pytest.mark.parametrize("code", ALL_CODES)
def test_halcon_of_every_representation(tmp_path, code):
    rng = np.random.default_rng(code)
    expected, several = [], []
    for k in range(5):
        r = (rng.uniform(-1.5, 1.5, 3) if code & 6 == 4 else rng.uniform(-180, 360, 3)).tolist()
        if k == 1 and code & 6 != 4:
            r = [30.0, 90.0, 200.0]  # gimbal lock
        t = rng.uniform(-2, 2, 3).tolist()
        expected.append(halcon_matrix(code, r, t))
        (tmp_path / f"pose_{k + 8}.dat").write_text(text_of(code, r, t), newline="")
        several.append(text_of(code, r, t))
    contents, source = read_contents(tmp_path, None)
    assert source.format == "halcon"
    np.testing.assert_allclose(contents.only.rotation, np.array(expected)[:, :3, :3], atol=1e-9)
    np.testing.assert_allclose(contents.only.translation, np.array(expected)[:, :3, 3], atol=1e-9)
    (tmp_path / "all.txt").write_text("".join(several))
    one = read_contents(tmp_path / "all.txt", None)[0].only
    np.testing.assert_allclose(one.rotation, np.array(expected)[:, :3, :3], atol=1e-9)


def test_tuples_of_halcon(tmp_path):
    r, t = [10.0, -20.0, 130.0], [0.1, 0.2, 0.3]
    for text in ("[0.1, 0.2, 0.3, 10.0, -20.0, 130.0, 0]", "0.1 0.2 0.3 10 -20 130 0", "0.1;0.2;0.3;10;-20;130;0"):
        (tmp_path / "pose.txt").write_text(text)
        side = read_contents(tmp_path / "pose.txt", "halcon")[0].only
        np.testing.assert_allclose(side.rotation[0], halcon_matrix(0, r, t)[:3, :3], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("f 6\nr 1 2 3\nt 1 2 3\n", r"line 1: expected a representation type of HALCON among 0, 1, 2, 3.*got 6"),
        ("f 0\nr 1 2 3\n", r"line 1: expected the lines f, r and t of a pose, got none with t"),
        ("f 0\nr 1 2 3\nt 1 2\n", r"line 3: expected 3 numbers.*docs/formats.md, HALCON"),
        ("f 0\nr 1 nan 3\nt 1 2 3\n", r"line 2: expected 3 numbers"),
        ("f 0\nr 1 2 3\nt 1 2 3\nhello\n", r"line 4: expected 7 numbers"),
    ],
)
def test_halcon_that_is_wrong(tmp_path, text, message):
    (tmp_path / "pose.dat").write_text(text)
    with pytest.raises(InputError, match=message):
        read_contents(tmp_path / "pose.dat", "halcon")


def zivid_today(M):
    rows = "".join(f"    - {json.dumps(row)}\n" for row in M.tolist())
    return f"__version__:\n  serializer: 1\n  data: 1\nFloatMatrix:\n  Data:\n{rows}"


def zivid_flow(M):
    return f"__version__:\n  serializer: 1\n  data: 1\nFloatMatrix:\n  Data: {json.dumps(M.tolist())}\n"


def zivid_older(M):
    data = ",\n       ".join(f"{v:.16e}" for v in M.reshape(16))
    return f"%YAML:1.0\n---\nPoseState: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: [ {data} ]\n"


@pytest.mark.slow
@pytest.mark.parametrize("form", [zivid_today, zivid_flow, zivid_older])
def test_zivid(tmp_path, form):
    for side, poses in (("robot", ROBOT), ("camera", CAMERA)):
        (tmp_path / side).mkdir()
        for k, T in enumerate(poses):
            M = T.copy()
            M[:3, 3] *= 1000
            (tmp_path / side / f"pos{k + 5:d}.yaml").write_text(form(M))
    poses = read_poses(tmp_path / "robot", tmp_path / "camera")
    np.testing.assert_allclose(poses.robot, ROBOT, atol=1e-9)
    np.testing.assert_allclose(poses.camera, CAMERA, atol=1e-9)
    assert poses.sources[0].format == "zivid"
    in_metres = read_poses(tmp_path / "robot", tmp_path / "camera", units="m")
    np.testing.assert_allclose(in_metres.robot[:, :3, 3], 1000 * ROBOT[:, :3, 3], atol=1e-9)


def test_zivid_that_is_wrong(tmp_path):
    for text, message in (
        ("FloatMatrix:\n  Data: [[1, 0], [0, 1]]\n", "expected a matrix 4x4, got 4 numbers"),
        ("FloatMatrix: [1, 2]\n", "expected Data with a matrix 4x4, got a list of 2"),
        ("FloatMatrix:\n  Data: [[1, 0, 0, a]]\n", "expected a number, got 'a'"),
    ):
        (tmp_path / "pose.yaml").write_text(text)
        with pytest.raises(InputError, match=message):
            read_contents(tmp_path / "pose.yaml", None)
