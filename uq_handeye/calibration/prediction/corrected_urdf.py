r"""Export of the estimated errors of an arm to a URDF: corrected joint origins, and the errors that a URDF cannot hold.

A geometric error ``E_k`` of joint k, in the frame whose z is its axis (rotated from the joint's by A), makes of the
joint's ``<origin>`` O the ``O A E_k A^T``. Exported are the numbers whose standard deviation is below a share of the
one assumed; the others keep the manufacturer's values. Harmonics of transmissions and sag are functions of the joints,
for which a URDF has no element: the motion of the tip that they cause is reported in mm.

The estimates are those of the joint fit. X belongs to the arm with all errors e corrected: with a URDF that is
corrected in part, calibrate again, or allow for the errors that it does not hold.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ...core.files.atomic import write_files
from ...core.files.json_files import json_text
from ...core.files.open import StrPath, as_path, shown
from ...core.files.records import Record
from ...core.geometry.se3 import Array, inverse
from ...core.rounding import THIRD_DIGITS
from ...errors import InputError
from ...formats.snippets import fixed_axis_angles
from ...model.errors.error_estimate import ErrorEstimate
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.descriptions.urdf import origin_of, read_tree
from ...model.kinematics.errors import LENGTHS, OFFSETS, TILTS
from ...model.kinematics.forward import align
from ..analysis import FittedKinematics

if TYPE_CHECKING:
    from ...model.kinematics.descriptions.urdf import Placed

# A corrected number must have a standard deviation below this share of the one declared for it.
MIN_NARROWING = 0.5
# The file of the corrections is named like the URDF, with this suffix.
BESIDE = ".corrections.json"


@dataclass(frozen=True, eq=False)
class CorrectedUrdf(Record):
    """A URDF with some origins corrected; lengths in m, angles in rad."""

    _in_file: ClassVar[str] = (
        "units corrected=exported covariance left_nominal=left left_nominal_moves_tip=by_left not_in_urdf=functions "
        "not_in_urdf_moves_tip=by_functions summary"
    )
    units: ClassVar[dict[str, str]] = {"rotation": "rad", "translation": "m"}

    text: str
    exported: tuple[ErrorEstimate, ...]
    covariance: Array  # (r, r) of those
    left: tuple[ErrorEstimate, ...]  # geometric ones that the data do not know well enough
    functions: tuple[ErrorEstimate, ...]  # of transmissions and sag, which a URDF cannot hold
    e: Array  # (m,) what the URDF is corrected by, of all errors of the chain
    by_functions: float  # RMS move of the tip by these, over the joint limits
    by_left: float  # RMS move of the tip by the others that were left out

    @property
    def summary(self) -> str:
        """One sentence or two."""
        names, count = ", ".join(row.name for row in self.exported) or "none", len(self.exported) + len(self.left)
        return (
            f"Corrected: {len(self.exported)} of {count} numbers of the geometry ({names}). Left as they were: "
            f"{len(self.left)}, whose estimates move the tip by {1e3 * self.by_left:.2f} mm (RMS over the joint "
            "limits). Transmissions and sag have no place in a URDF; their estimates move it by "
            f"{1e3 * self.by_functions:.2f} mm."
        )


def corrected_urdf(fitted: FittedKinematics | None, urdf: StrPath, narrower: float = MIN_NARROWING) -> CorrectedUrdf:
    """Return the URDF that the arm was calibrated with, corrected by the errors that the data determine.

    Parameters
    ----------
    fitted : FittedKinematics
        ``result.kinematics``.
    urdf : path of the file, or its text
    narrower : float
        Numbers are exported whose standard deviation is below this share of the one assumed.

    Raises
    ------
    InputError
        A calibration without kinematics, a share outside 0 to 1, or the URDF of another arm.
    """
    from ...model.kinematics.descriptions.urdf import with_origins  # whose parser of XML is slow to import

    if fitted is None:
        raise InputError("Expected a calibration with joints and kinematics: it has found nothing to correct.")
    if not 0 < narrower <= 1:
        raise InputError(f"Expected the share `narrower` above 0 and at most 1, got {narrower!r}.")
    chain = fitted.chain
    q = chain.spread(200)
    _require_same(chain, Kinematics.from_urdf(urdf, chain.base, chain.tip), q)
    rows = {row.key: row for row in fitted.table()}
    index = {error.key: k for k, error in enumerate(chain.errors)}
    geometric = [row for row in rows.values() if row.key.kind in (OFFSETS, TILTS, LENGTHS)]
    exported = [row for row in geometric if row.sd < narrower * row.size]
    kept = np.array([index[row.key] for row in exported], dtype=np.intp)
    of_functions = np.array([error.group not in (OFFSETS, TILTS, LENGTHS) for error in chain.errors])
    e = np.zeros(len(chain.errors))
    e[kept] = fitted.e[kept]
    others = np.where(of_functions, 0.0, fitted.e - e)
    found = CorrectedUrdf(
        "",
        tuple(exported),
        fitted.covariance[np.ix_(kept, kept)],
        tuple(row for row in geometric if row not in exported),
        tuple(row for row in rows.values() if row not in geometric),
        e,
        _moved(chain, q, np.where(of_functions, fitted.e, 0.0)),
        _moved(chain, q, others),
    )
    text = with_origins(urdf, _origins(chain, urdf, e), f"Corrected by uq-handeye. {found.summary}")
    return replace(found, text=text)


def write_corrected_urdf(
    fitted: FittedKinematics | None, path: StrPath, urdf: StrPath, narrower: float = MIN_NARROWING
) -> CorrectedUrdf:
    """Write the corrected URDF, and to ``NAME.corrections.json`` the corrections with their covariance."""
    target = as_path(path)
    if target.suffix.lower() != ".urdf":
        raise InputError(f"Expected a corrected URDF to end in .urdf, got {shown(target)}.")
    found = corrected_urdf(fitted, urdf, narrower)
    files: dict[str, str] = {target.name: found.text, f"{target.stem}{BESIDE}": json_text(found.to_dict())}
    write_files(Path(target).parent, files)
    return found


def _require_same(chain: Kinematics, other: Kinematics, q: Array) -> None:
    if other.names != chain.names:
        raise InputError(
            f"Expected the URDF that the arm was calibrated with, of the joints {', '.join(chain.names)}, got one of "
            f"{', '.join(other.names)}."
        )
    if (off := float(np.abs(other.poses(q) - chain.poses(q)).max())) > THIRD_DIGITS:
        raise InputError(
            f"Expected the URDF that the arm was calibrated with; poses of this one differ by up to {1e3 * off:.3g} mm."
        )


def _origins(chain: Kinematics, urdf: StrPath, e: Array) -> dict[str, Placed]:
    """The new ``<origin>`` of each joint that has an error: its own one times ``A E A^T``."""
    from ...model.kinematics.descriptions.urdf import Placed

    tree = read_tree(urdf)
    own = {part.name: origin_of(part, tree.where) for part in tree.joints}
    zero = np.zeros(chain.n_joints)
    nominal, found = chain.frames(zero), {}
    for k, joint in enumerate(chain.joints):
        if not any(e[i] for i, error in enumerate(chain.errors) if error.joint == joint.name):
            continue
        alone = np.where([error.joint == joint.name for error in chain.errors], e, 0.0)
        E = inverse(nominal[k]) @ chain.frames(zero, alone)[k]
        A = align(joint.axis)
        T = own[joint.name] @ A @ E @ inverse(A)
        found[joint.name] = Placed(T[:3, 3], fixed_axis_angles(T[:3, :3]))
    return found


def _moved(chain: Kinematics, q: Array, e: Array) -> float:
    """RMS move of the tip (m) over postures by errors e."""
    move = chain.poses(q, e)[:, :3, 3] - chain.poses(q)[:, :3, 3]
    return float(np.sqrt(np.mean(np.sum(move**2, axis=-1))))
