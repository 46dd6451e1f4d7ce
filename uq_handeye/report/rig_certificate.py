"""The certificate of a rig: all poses with their uncertainties, relative poses, decision on each camera, conditions.

Uncertainties are those of the joint covariance: the length and angle that 95 % of the errors of a pose are within. A
rig in which something moved, whose residuals are larger than the noise explains, or whose cameras are not determined in
all directions is not certified: the page states no pose.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..calibration.report.rig_sections import FRAMES, certified_poses, expanded, headline, rig_parts
from ..calibration.rig_result import RigCalibration
from ..calibration.tolerance import Verdict
from ..core.files.about import ABOUT
from ..core.files.json_values import JsonObject
from ..core.files.records import plain
from ..core.levels import CONTRADICTED
from ..core.presentation.document import Answer, Block, Paragraph, Points, Section, Table
from ..core.presentation.numbers import digits, probability
from ..core.presentation.sections import selected
from ..model.poses.estimated_pose import EstimatedPose
from .budget import LEVEL
from .certificate_form import Form, refused
from .decision import RULE, badges_of
from .rig_page import rig_sketch
from .statements import ERROR_MODEL, VALIDITY


@dataclass(frozen=True, eq=False)
class RigCertificate(Form):
    """The certificate of a rig; see `make_certificate`."""

    _format: ClassVar[str] = "uq-handeye rig certificate 1"

    result: RigCalibration
    verdicts: Mapping[str, Verdict]
    about: Mapping[str, str]
    issued: str

    @property
    def refusals(self) -> tuple[str, ...]:
        """Reasons why nothing is certified; empty where the rig is."""
        result = self.result
        found = [*result.reasons]
        found += [text for text in result.warnings if text not in found]
        if opened := [name for name, one in result.cameras.items() if len(one.open)]:
            found.append(f"not determined in all directions: {', '.join(opened)}")
        if result.p_value < CONTRADICTED.probability:
            found.append(f"the residuals are larger than the noise says ({probability(result.p_value)})")
        return tuple(found)

    def _contents(self) -> JsonObject:
        result = self.result
        found: JsonObject = {
            "certified": self.certified, "refusals": list(self.refusals), "about": dict(self.about),
            "decision": {name: one.to_dict() for name, one in self.verdicts.items()},
            "conditions": dict(self._conditions()), "noise": plain(result.noise),
            "chi_square": result.chi_square, "dof": result.dof, "p_value": result.p_value,
            "optimality": result.optimality.to_dict(), "error_model": ERROR_MODEL, "validity": VALIDITY,
        }  # fmt: skip
        if self.certified:
            found["poses"] = {one.name: self._stated(one) for one in certified_poses(result)}
            found["relative"] = {one.frame: self._stated(one) for one in result.pairs}
        return found

    def _stated(self, one: EstimatedPose) -> JsonObject:
        shift, turn = expanded(self.result, one)
        return one.to_dict() | {"expanded": {"level": LEVEL, "translation": plain(shift), "rotation": plain(turn)}}

    def _conditions(self) -> list[tuple[str, str]]:
        result, rig = self.result, self.result.rig
        sources = dict.fromkeys([*(arm.source for arm in rig.arms.values()), *(view.source for view in rig.views)])
        away = np.concatenate([np.linalg.norm(view.poses[:, :3, 3], axis=1) for view in rig.views])
        rejected = f"{len(result.rejected)} views and {len(result.rejected_poses)} robot poses rejected"
        return [
            ("Rig", rig.words), ("Data", ", ".join(name for name in sources if name) or "not recorded"),
            ("Used", f"{len(result.weights)} views at {len(result.pose_names)} robot poses; {rejected}"),
            ("Camera to target", f"{digits(float(away.min()), 3)} m to {digits(float(away.max()), 3)} m"),
            ("Method", f"{result.method}, one estimate of all poses with their joint covariance"),
            ("Environment", self.about.get("environment", "not recorded")),
        ]  # fmt: skip

    def to_html(self) -> str:
        """Return the page as one self-contained HTML text."""
        sheets = [self._first(), self._second()] if self.certified else [self._refused()]
        fields = [(ABOUT[key], self.about.get(key, "")) for key in ABOUT if key != "note" or key in self.about]
        rig = self.result.rig
        return self.page("Rig calibration", ", ".join(rig.cameras), [rig.words], sheets, fields)

    def _refused(self) -> list[Section]:
        return [refused(Answer("NOT CERTIFIED.", "failed"), Points(self.refusals)), self._measured()]

    def _first(self) -> list[Section]:
        result = self.result
        said: list[Block] = [Answer(*headline(result)), *badges_of(self.verdicts)]
        said += [Paragraph(RULE)] if self.verdicts else []
        return [
            Section("answer", "Result", [*said, Paragraph(f"Measurand: the poses below. {ERROR_MODEL}")], wide=True),
            Section("rig", "The rig", [rig_sketch(result)], wide=True),
            *selected(rig_parts(result), ("stated",), wide=True),
        ]

    def _second(self) -> list[Section]:
        parts = rig_parts(self.result)
        return [
            *selected(parts, ("stated-pairs",), wide=True),
            self._measured(),
            *selected(parts, ("checks", "noise")),
            Section("validity", "Validity", [Paragraph(VALIDITY), Paragraph(FRAMES)], wide=True),
        ]

    def _measured(self) -> Section:
        rows = [[name, text] for name, text in self._conditions()]
        return Section("conditions", "Conditions", [Table("", ["", ""], rows, frozenset({1}))])
