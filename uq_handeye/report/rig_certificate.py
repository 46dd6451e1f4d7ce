"""The certified part of a rig: all poses with their uncertainties, relative poses, decision on each camera, conditions.

Uncertainties are those of the joint covariance: the length and angle that 95 % of the errors of a pose are within. A
rig in which something moved, whose residuals are larger than the noise explains, or whose cameras are not determined in
all directions is not certified: the page states no pose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..calibration.report.answer import badges_of
from ..calibration.report.rig_sections import FRAMES, certified_poses, rig_parts
from ..calibration.rig_result import RigCalibration
from ..calibration.stored_result import NOT_USABLE
from ..core.files.json_values import JsonObject
from ..core.files.records import plain
from ..core.geometry.conventions import CONVENTION
from ..core.presentation.document import Answer, Block, Paragraph, Points, Section, Table
from ..core.presentation.numbers import digits
from ..core.presentation.sections import selected
from ..core.presentation.units import DEG_PER_RAD, MM_PER_M
from ..model.poses.estimated_pose import EstimatedPose
from .budget import LEVEL
from .certificate_sheets import NOT_CERTIFIED, origin_section, refused
from .certified import Certified, certified_of
from .decision import RULE, Decision
from .rig_page import rig_sketch
from .statements import ERROR_MODEL, VALIDITY, input_hashes, traceability

MEASURAND = f"Measurand: the poses of cameras, targets and bases, each in its own frame. {ERROR_MODEL}"


@certified_of.register
def certified_of_rig(result: RigCalibration, decisions: Mapping[str, Decision]) -> Certified:
    """Return what is certified of a rig."""
    refusals = refusals_of(result)
    return Certified(
        refusals, result.camera_names, [result.rig.words, f"method {result.method}"],
        lambda: [_first(result, decisions), _second(result)] if not refusals else [_refused(result, refusals)],
        lambda: _data(result, not refusals),
    )  # fmt: skip


def refusals_of(result: RigCalibration) -> tuple[str, ...]:
    """Return the reasons why nothing is certified; empty where the rig is."""
    found = [f"{NOT_USABLE}: {reason}" for reason in result.reasons]
    found += [str(one) for one in result.cautions if one.phrase not in result.reasons]
    if opened := [name for name, one in result.cameras.items() if len(one.open)]:
        found.append(f"not determined in all directions: {', '.join(opened)}")
    return tuple(found) or result.doubts


def _data(result: RigCalibration, certified: bool) -> JsonObject:
    poses: JsonObject = {
        "poses": {one.name: _stated(result, one) for one in certified_poses(result)},
        "relative": {one.frame: _stated(result, one) for one in result.pairs},
    }
    return {
        **(poses if certified else {}),
        "measurand": {"name": ", ".join(result.camera_names), "convention": CONVENTION, "description": MEASURAND},
        "conditions": [{"name": name, "text": text} for name, text in conditions_of_rig(result)],
        "method": {"name": result.method, "description": _method(result)},
        "cautions": list(result.warnings),
        "noise": plain(result.noise),
        "residuals": {"chi_square": result.chi_square, "dof": result.dof, "p_value": plain(result.p_value)},
        "optimality": result.optimality.to_dict(),
        "traceability": traceability(input_hashes(result.provenance), result.provenance),
    }


def _stated(result: RigCalibration, one: EstimatedPose) -> JsonObject:
    shift, turn = (fact.within_95 for fact in result.facts.select("error of pose", one.frame))
    assert shift is not None and turn is not None
    expanded = {"translation": plain(shift / MM_PER_M), "rotation": plain(turn / DEG_PER_RAD)}
    return one.to_dict() | {"expanded": {"level": LEVEL, **expanded}}


def _method(result: RigCalibration) -> str:
    return f"{result.method}, one estimate of all poses with their joint covariance"


def conditions_of_rig(result: RigCalibration) -> list[tuple[str, str]]:
    """Return the recorded conditions of the measurement as names and texts."""
    rig = result.rig
    sources = dict.fromkeys([*(arm.source for arm in rig.arms.values()), *(view.source for view in rig.views)])
    away = np.concatenate([np.linalg.norm(view.poses[:, :3, 3], axis=1) for view in rig.views])
    rejected = f"{len(result.rejected)} views and {len(result.rejected_poses)} robot poses rejected"
    return [
        ("Rig", rig.words), ("Data", ", ".join(name for name in sources if name) or "not recorded"),
        ("Used", f"{len(result.weights)} views at {len(result.pose_names)} robot poses; {rejected}"),
        ("Camera to target", f"{digits(float(away.min()), 3)} m to {digits(float(away.max()), 3)} m"),
        ("Method", _method(result)), ("Environment", result.about.get("environment", "not recorded")),
    ]  # fmt: skip


def _refused(result: RigCalibration, refusals: Sequence[str]) -> list[Section]:
    answer = Answer(f"{NOT_CERTIFIED}. {result.headline}", "failed")
    return [refused(answer, Points(refusals)), _measured(result), _origin(result)]


def _first(result: RigCalibration, decisions: Mapping[str, Decision]) -> list[Section]:
    verdicts = {name: one.verdict for name, one in decisions.items()}
    said: list[Block] = [Answer(result.headline, result.status), *badges_of(result, verdicts)]
    several = len(decisions) > 1
    bands = [f"{name}: {one.sentence}" if several else one.sentence for name, one in decisions.items() if one.sentence]
    said += [Paragraph(" ".join([*bands, RULE]))] if decisions else []
    return [
        Section("answer", "Result", [*said, Paragraph(MEASURAND)], wide=True),
        Section("rig", "The rig", [rig_sketch(result)], wide=True),
        *selected(rig_parts(result), ("stated",), wide=True),
    ]


def _second(result: RigCalibration) -> list[Section]:
    parts = rig_parts(result)
    return [
        *selected(parts, ("stated-pairs",), wide=True),
        _measured(result),
        *selected(parts, ("all-checks", "noise")),
        _origin(result),
        Section("validity", "Validity", [Paragraph(VALIDITY), Paragraph(FRAMES)], wide=True),
    ]


def _measured(result: RigCalibration) -> Section:
    rows = [[name, text] for name, text in conditions_of_rig(result)]
    return Section("conditions", "Conditions", [Table("", ["", ""], rows, frozenset({1}))])


def _origin(result: RigCalibration) -> Section:
    return origin_section(input_hashes(result.provenance), "", result.provenance)
