"""The statements of a certificate: measurand, conditions, method, traceability, validity, and terms of ISO 9283.

Pose repeatability RP is the spread of attained poses about their mean, of one commanded pose approached from one
direction: ``RP_l = mean(l) + 3 S_l``, l the distances from the mean. Pose accuracy AP is the difference between a
commanded pose and the mean of those attained (ISO 9283, 7.2). A calibration measures neither: it measures the
difference of the reported poses from those of a rigid rig.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

import numpy as np

from ..calibration.checks import shared_groups, sizes_of
from ..calibration.parts import Provenance
from ..calibration.report.facts import noise_per_axis
from ..calibration.report.first_screen import file_words, fit_words, source_names
from ..calibration.result import Calibration
from ..calibration.tolerance import percent
from ..core.files.about import ABOUT
from ..core.files.json_values import JsonObject
from ..core.presentation.numbers import digits
from ..model.errors.key import ErrorKey, Kind, Owner
from ..model.errors.keys import ROBOT_ACCURACY, ROBOT_SCALE, TARGET_SCALE
from ..model.kinematics.kinematic_errors import DECLARED, DECLARED_AS, ESTIMATE, EXACT
from ..model.poses.pose_pairs import PosePairs
from .budget import LEVEL, budget_of

ERROR_MODEL = (
    "The error is xi = (theta, tau): R = exp([theta]x) R_hat, t = t_hat + tau, both in the parent frame of X (rotation "
    "vector in rad, translation in m)."
)
# Statements that every certificate makes, whatever its numbers.
STANDING = (
    "Computed by software from the recorded poses, with the inputs declared by the user. It is not a calibration "
    "certificate of an accredited laboratory (ISO/IEC 17025). The person who signs it is responsible for the declared "
    "inputs. It relates only to the rig named above; copy it in full only."
)
VALIDITY = (
    "The result applies to the rig as it was when the poses were recorded, and to robot poses like those recorded. It "
    "does not expire on a date: it holds until uq-handeye check says changed. Check it after any change or shock: "
    "camera or mount moved, lens, focus or zoom changed, robot mastered, base or tool redefined."
)


def measurand_of(result: Calibration) -> str:
    """Return the measurand: the pose X, its frames and the setup."""
    if result.setup is None:
        return f"Measurand: the rigid transform X of AX = XB, of {result.n_pairs} pairs of motions. {ERROR_MODEL}"
    where = "mounted on the robot" if result.setup == "eye-in-hand" else "fixed in the cell"
    return (
        f"Measurand: the pose X = {result.frame} of the {result.facts.subject}: translation and rotation "
        f"(six quantities) of a camera {where} ({result.setup}). {ERROR_MODEL}"
    )


def conditions_of(result: Calibration) -> list[tuple[str, str]]:
    """Return the recorded conditions of the measurement as names and texts."""
    files = file_words(source_names(result))
    rows = [("Data", f"{files}: {fit_words(result)}" if files else fit_words(result))]
    if result.table is not None:
        rejected = len(result.table.rejected)
        used = f"{len(result.table.counted) - rejected} of {len(result.table)} {result.table.item}s used"
        for what, which in (("rejected", result.table.rejected), ("excluded", result.table.excluded)):
            listed = ", ".join(map(str, which[:12])) + (", ..." if len(which) > 12 else "")
            used += f"; {what}: {listed} (numbered from 0)" if which else ""
        rows.append(("Used", used))
    if isinstance(data := result.counted, PosePairs):
        size = 1e3 * np.ptp(data.robot[:, :3, 3], axis=0)
        away = np.linalg.norm(data.camera[:, :3, 3], axis=1)
        rows.append(("Robot positions", f"{' x '.join(f'{x:.0f}' for x in size)} mm (extent in the base frame)"))
        rows.append(("Camera to target", f"{digits(away.min(), 3)} m to {digits(away.max(), 3)} m"))
        if (recorded := _recorded(data)) is not None:
            rows.append(("Recorded", recorded))
    if result.analysis is not None:
        shares = " / ".join(f"{100 * share:.0f}" for share in result.analysis.diagnostics.diversity.share)
        rows.append(("Rotation about axes", f"{shares} %"))
    rows.append(("Environment", result.about.get("environment", "not recorded")))
    return rows


def _recorded(data: PosePairs) -> str | None:
    """Return first and last time of the poses, where their timestamps are those of a clock."""
    if data.timestamps is None or not ((data.timestamps > 1e9) & (data.timestamps < 4e9)).all():
        return None  # seconds since 1970 from 2001 to 2096; others count from the start of a program
    first, last = (datetime.fromtimestamp(float(end), UTC) for end in (data.timestamps.min(), data.timestamps.max()))
    form = "%Y-%m-%d %H:%M"
    return f"{first:{form}} to {last:{form}} UTC, by the timestamps"


def method_of(result: Calibration) -> str:
    """Return a description of the evaluation of X and its uncertainty."""
    text = (
        f"X by method {result.method}; covariance from {result.facts.source} (first order, JCGM 100:2008, JCGM "
        "102:2011)."
    )
    if budget_of(result) is None:
        text += " This covariance is not divided by source."
    return text


def coverage_of(result: Calibration) -> str:
    """Return the meaning of the expanded uncertainty, for single numbers and for all six together."""
    text = (
        f"U = k u is the expanded uncertainty for a coverage probability of {percent(LEVEL)}; k is Student's t for the "
        "effective degrees of freedom nu (Welch-Satterthwaite), 1.96 where all inputs are declared. U of a length or "
        "an angle is what 95 % of the errors are within, in all directions together; k is then U / u."
    )
    limit = result.quantile(LEVEL)
    if not np.isfinite(limit):
        return f"{text} There is no joint coverage region from so few poses ({result.reference})."
    return (
        f"{text} All components together: the ellipsoid xi^T C^-1 xi = {digits(limit, 3)} holds {percent(LEVEL)} "
        f"({result.reference}, one number of degrees of freedom for all); C is in the JSON file."
    )


def noise_source(result: Calibration) -> str:
    """Return the source of the noise of the poses."""
    estimate = result.noise_estimate
    if result.noise is None:
        return "not known"
    if estimate is None:
        known = next((f"; that of the camera from the {what}" for attribute, what in _OF_CAMERA.items()
                      if getattr(result.data, attribute, None) is not None), "")  # fmt: skip
        return f"declared by the user{known}"
    if estimate.camera_known:
        known_by = "camera_calibration" if estimate.from_corners else "scene" if estimate.from_scene else None
        what = _OF_CAMERA[known_by or "camera_covariance"]
        return f"robot: estimated from the residuals; camera: from the {what}"
    if result.kinematics is not None:
        return f"estimated from the residuals; errors of the arm: {_OF_ARM.get(result.kinematics.how, 'assumed')}"
    if estimate.has_prior:
        return "estimated from the residuals with a data sheet"
    return "estimated from the residuals"


_OF_CAMERA = {
    "camera_calibration": "corners of the target",
    "scene": "features of the scene",
    "camera_covariance": "points of the target",
}
_OF_ARM = {DECLARED: "declared", ESTIMATE: "from arms of the kind and the residuals", EXACT: "none, taken as exact"}


def lengths_of(result: Calibration) -> str:
    """Return the source of lengths, and whether it is traceable."""
    sizes = {group.key.error: group for group in shared_groups(result)}
    parts = ["robot poses", "the size of the target"]
    known = []
    for name in (TARGET_SCALE, ROBOT_SCALE):
        if name in sizes:
            how = "assumed" if sizes[name].default else "declared"
            known.append(f"{name} {sizes[name].parts[0].stated or sizes_of(sizes[name])} ({how})")
    text = f"Lengths come from {' and '.join(parts)}"
    text += (
        f"; standard uncertainty in the budget: {', '.join(known)}."
        if known
        else ", which count as exact: no error of scale is in the budget."
    )
    if stated := result.about.get("reference"):
        return f"{text} Reference standard, as stated by the user: {stated}."
    return f"{text} No reference standard is stated: traceability of lengths to the SI is not shown."


def hashes_of(result: Calibration) -> list[tuple[str, str]]:
    """Return names and SHA-256 of the input of the result: poses, files, camera, arm."""
    rows = input_hashes(result.provenance)
    camera = getattr(result.data, "camera_calibration", None)
    if camera is not None:
        rows.append((f"camera calibration ({camera.model})", _sha256(camera.intrinsics)))
    if result.kinematics is not None:
        rows.append(("arm model (chain)", _sha256(result.kinematics.chain.to_dict())))
    return rows


def input_hashes(provenance: Provenance | None) -> list[tuple[str, str]]:
    """Return names and SHA-256 of the poses as they were used, and of their files."""
    if provenance is None:
        return []
    return [("poses as used", provenance.data_sha256), *((one.name, one.sha256) for one in provenance.sources)]


def traceability(hashes: Sequence[tuple[str, str]], provenance: Provenance | None) -> JsonObject:
    """Return hashes, versions and the command line as data."""
    return {
        "sha256": [{"name": name, "sha256": digest} for name, digest in hashes],
        "versions": {} if provenance is None else dict(provenance.versions),
        "command": None if provenance is None else provenance.command,
    }


def _sha256(data: object) -> str:
    """Return the SHA-256 of data as JSON with sorted keys."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def versions_of(provenance: Provenance | None) -> str:
    """Return the versions of the software that computed the result."""
    if provenance is None:
        return "not recorded"
    return ", ".join(f"{name} {version}" for name, version in provenance.versions.items())


def fields_of(about: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return the title block: all fields that have a text, and those a certificate needs."""
    needed = ("organisation", "cell", "robot", "robot_serial", "camera", "camera_serial", "target", "date")
    elsewhere = ("environment", "reference")
    return [
        (name, about.get(key, ""))
        for key, name in ABOUT.items()
        if (key in needed or key in about) and key not in elsewhere
    ]


def robot_words(result: Calibration) -> list[str]:
    """Return the relation of the numbers to the terms of ISO 9283 for the robot."""
    return [_repeatability(result), _accuracy(result), NOT_ISO_9283]


# RP_l = mean + 3 sd of the distance, for an isotropic Gaussian of standard deviation 1 per axis: the distance has the
# mean 2 sqrt(2 / pi) and the standard deviation sqrt(3 - 8 / pi).
RP_PER_SD = float(2 * np.sqrt(2 / np.pi) + 3 * np.sqrt(3 - 8 / np.pi))
NOT_ISO_9283 = (
    "No characteristic of ISO 9283 was measured: commanded poses, repeated cycles to the poses of the test cube, rated "
    "load and an external measuring system are not part of the data."
)


def _repeatability(result: Calibration) -> str:
    """Return how the noise of the robot poses relates to pose repeatability."""
    if result.kinematics is not None:
        sd = digits(float(np.degrees(result.kinematics.joint_noise)), 2)
        return (
            f"Pose repeatability (RP): the joint noise, {sd} deg per joint, is related to it; it also holds encoder "
            "errors and what no model of the arm explains."
        )
    sizes = _robot_noise(result)
    missing = [name for name, size in sizes.items() if size is None]
    known = [f"{digits(size, 2)} {'deg' if name == 'rotation' else 'mm'}" for name, size in sizes.items() if size]
    if result.setup is None:
        return "Pose repeatability (RP): no value here is related to it; the data are motions, not poses."
    if not known:
        return (
            "Pose repeatability (RP): no value here is related to it; the data do not separate the noise of the robot "
            "poses from that of the camera poses."
        )
    text = (
        f"Pose repeatability (RP): the noise of the robot poses, {' and '.join(known)} (1 sigma per axis), is related "
        "to it; it also holds errors of the reported pose and of its timing, over different poses and directions."
    )
    if missing:
        text += f" Its {missing[0]} is not identifiable."
    if move := sizes[Kind.TRANSLATION]:
        text += (
            f" Isotropic noise of this size would have RP_l = {RP_PER_SD:.1f} sigma = {digits(RP_PER_SD * move, 2)} mm."
        )
    return text


def _robot_noise(result: Calibration) -> dict[Kind, float | None]:
    """Return rotation (deg) and translation (mm) noise of the robot poses, where it is known by itself."""
    factors = {Kind.ROTATION: 180 / np.pi, Kind.TRANSLATION: 1e3}
    estimate = result.noise_estimate
    found: dict[Kind, float | None] = dict.fromkeys(factors)
    if estimate is not None:
        for part in estimate.components:
            kind = part.key.kind
            if (
                part.key == ErrorKey(Owner.ROBOT, kind)
                and kind in found
                and part.status not in ("not told apart", "exact", "zero")
            ):
                found[kind] = factors[kind] * part.size
        return found
    S = getattr(result.noise, "robot", None)
    if S is not None:
        for kind, size in zip(found, noise_per_axis(S), strict=True):
            found[kind] = factors[kind] * float(size) or None
    return found


def _accuracy(result: Calibration) -> str:
    """Return how what is declared or assumed of the robot relates to pose accuracy."""
    groups = [group for group in shared_groups(result) if group.key.error == ROBOT_ACCURACY]
    if groups:
        how = "assumed, not declared" if groups[0].default else "declared"
        return (
            f"Pose accuracy (AP): the robot accuracy of the budget, {sizes_of(groups[0])} ({how}), is related to it. "
            "It is read as the RMS over the workspace of the difference between reported and actual pose, base and "
            "tool frame aligned; AP of a data sheet is per commanded pose."
        )
    names = {error.key.kind for error in result.shared} & set(DECLARED_AS)
    if names:
        return (
            "Pose accuracy (AP): the errors of the arm in the budget, "
            f"{', '.join(name for name in DECLARED_AS if name in names)}, are related to it."
        )
    return "Pose accuracy (AP): no robot accuracy is declared or assumed; its effect on X is not in the budget."
