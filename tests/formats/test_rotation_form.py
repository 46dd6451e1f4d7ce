"""Forms of rotations against products of rotations about the axes, and back."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.formats.controllers.forms import CONTROLLERS
from uq_handeye.formats.rotations import SEQUENCES, rotation_form

UNIT = {"x": np.eye(3)[0], "y": np.eye(3)[1], "z": np.eye(3)[2]}


def about(axis, angle):
    """Rotation matrix by Rodrigues' formula."""
    x, y, z = UNIT[axis.lower()]
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_euler_angles_are_products_of_rotations(sequence):
    angles = np.array([0.4, -1.1, 2.3])
    factors = [about(axis, angle) for axis, angle in zip(sequence, angles, strict=True)]
    product = np.linalg.multi_dot(factors if sequence.isupper() else factors[::-1])
    assert np.allclose(rotation_form(f"{sequence}-rad").decode(angles[None]), product, atol=1e-14)
    assert np.allclose(rotation_form(f"{sequence}-deg").decode(np.degrees(angles)[None]), product, atol=1e-14)


@pytest.mark.parametrize(
    "text", ["xyzw", "wxyz", "rotvec-rad", "rotvec-deg", "matrix", "transposed", "ZYX-deg", "xyz-rad", "ZYZ-deg"]
)
def test_there_and_back(text):
    R = Rotation.random(200, rng=1).as_matrix()
    R[0] = np.eye(3)
    R[1] = about("y", np.pi / 2)  # gimbal lock
    form = rotation_form(text)
    assert np.allclose(form.decode(form.encode(R)), R, atol=1e-9)


@pytest.mark.parametrize("text", ["ZYX", "XYz-deg", "XXY-deg", "rotvec", "rpy-deg", "", None, 3, "ZYX-grad"])
def test_other_texts_are_refused(text):
    with pytest.raises(uq.InputError, match="rotation"):
        rotation_form(text)


def test_makers_agree_with_rotations_about_axes():
    """KUKA, FANUC and Yaskawa write the same rotation in opposite orders; Staubli in another."""
    a, b, c = 20.0, -35.0, 70.0
    A, B, C = np.radians([a, b, c])
    expected = about("z", A) @ about("y", B) @ about("x", C)
    decode = {name: rotation_form(form.rotation).decode for name, form in CONTROLLERS.items()}
    assert np.allclose(decode["kuka"](np.array([[a, b, c]])), expected)
    assert np.allclose(decode["fanuc"](np.array([[c, b, a]])), expected)
    assert np.allclose(decode["yaskawa"](np.array([[c, b, a]])), expected)
    assert np.allclose(decode["rpy"](np.array([[C, B, A]])), expected)
    assert np.allclose(decode["staubli"](np.array([[c, b, a]])), about("x", C) @ about("y", B) @ about("z", A))
    assert np.allclose(decode["kawasaki"](np.array([[a, b, c]])), about("z", A) @ about("y", B) @ about("z", C))
    assert np.allclose(decode["nachi"](np.array([[a, b, c]])), expected)
    assert np.allclose(decode["adept"](np.array([[a, b, c]])), about("z", A) @ about("y", B) @ about("z", C))
    assert np.allclose(decode["mecademic"](np.array([[a, b, c]])), about("x", A) @ about("y", B) @ about("z", C))
