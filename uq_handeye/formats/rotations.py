"""Rotations as numbers: quaternions, rotation vectors, Euler angles of any order, matrices.

A form is a text: ``xyzw`` and ``wxyz`` (quaternions), ``rotvec-rad`` and ``rotvec-deg`` (rotation vectors), an order of
axes with the unit of the angles, such as ``ZYX-deg`` or ``xyz-rad``, or, for matrices 3x3, ``matrix`` and
``transposed``. The axes are those of SciPy's ``Rotation.from_euler``: capital letters rotate about the rotated axes
(intrinsic), small letters about the fixed axes (extrinsic). ``ZYX`` with angles a, b, c is ``Rz(a) Ry(b) Rx(c)``, and
so is ``xyz`` with c, b, a.
"""

from __future__ import annotations

import warnings
from itertools import product
from typing import Any, NamedTuple, cast

import numpy as np

from ..core.geometry.rotations import Rotation, matrices_of_quaternions
from ..core.geometry.se3 import Array
from ..errors import InputError, among

QUATERNIONS = ("xyzw", "wxyz")
MATRICES = ("matrix", "transposed")
VECTORS = ("rotvec-rad", "rotvec-deg")
# All orders of axes: no axis twice in a row.
SEQUENCES = tuple(
    "".join(axes)
    for letters in ("XYZ", "xyz")
    for axes in product(letters, repeat=3)
    if axes[0] != axes[1] and axes[1] != axes[2]
)
# How many numbers each form has.
_NUMBERS = {
    **dict.fromkeys(QUATERNIONS, 4),
    **dict.fromkeys(MATRICES, 9),
    **dict.fromkeys((*VECTORS, *(f"{order}-{unit}" for order in SEQUENCES for unit in ("deg", "rad"))), 3),
}


class RotationForm(NamedTuple):
    """One of the forms: its ``text``, how many ``numbers`` it has, 3, 4 or 9."""

    text: str
    numbers: int

    def decode(self, values: Array) -> Array:
        """Rotation matrices (n, 3, 3) of numbers (n, k), or of matrices (n, 3, 3)."""
        if self.text in MATRICES:
            return values if self.text == "matrix" else np.swapaxes(values, -1, -2)
        if self.text in QUATERNIONS:
            return matrices_of_quaternions(np.roll(values, -1, axis=-1) if self.text == "wxyz" else values)
        if self.text in VECTORS:
            rotation = Rotation.from_rotvec(values, degrees=self.degrees)
        else:
            rotation = Rotation.from_euler(cast(Any, self.text[:3]), values, degrees=self.degrees)
        return np.asarray(rotation.as_matrix())

    def encode(self, R: Array) -> Array:
        """Numbers (n, k) of rotation matrices (n, 3, 3), or matrices; a quaternion has a scalar of at least 0."""
        rotation = Rotation.from_matrix(R)
        if self.text in QUATERNIONS:
            return np.asarray(rotation.as_quat(canonical=True, scalar_first=self.text == "wxyz"))
        if self.text in MATRICES:
            return R if self.text == "matrix" else np.swapaxes(R, -1, -2)
        if self.text in VECTORS:
            return np.asarray(rotation.as_rotvec(degrees=self.degrees))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # gimbal lock: SciPy sets the third angle to 0, which is right
            return np.asarray(rotation.as_euler(cast(Any, self.text[:3]), degrees=self.degrees))

    @property
    def degrees(self) -> bool:
        """True for angles and rotation vectors in degrees."""
        return self.text.endswith("-deg")


def rotation_form(text: Any) -> RotationForm:
    """Return the form of a text; raises `InputError` for any other text."""
    if among(text, _NUMBERS):
        return RotationForm(text, _NUMBERS[text])
    hint = ""
    if among(text, (*SEQUENCES, "rotvec")):
        hint = f"; add the unit of the angles: {text}-deg or {text}-rad"
    elif str(text).lower() in ("rpy-deg", "rpy-rad"):
        hint = f"; roll, pitch, yaw are xyz{text[3:].lower()}"
    raise InputError(
        "Expected `rotation` (--rotation) to be an order of Euler angles with its unit (ZYX-deg: rotated "
        f"axes; xyz-rad: fixed axes), rotvec-rad, rotvec-deg, xyzw, wxyz, matrix or transposed, got {text!r}{hint}."
    )
