"""Results of one camera and of several have the same names, and nothing in the package asks for the kind."""

import re

import pytest
from fixtures.pages import ROOT

import uq_handeye as uq

KINDS = r"(?:Calibration|RigCalibration|RigPoses|Estimated|Statement|Checked)"
ASKS = re.compile(
    rf"isinstance\([^()]*,[^\n]*?\b(?<!\.){KINDS}\b|\bcase {KINDS}\(|type\(\w+\) (?:is|==|in) [^\n]*\b{KINDS}\b"
    rf"|hasattr\((?:result|stored), |is_of_rig|stored_rig"
)
SHARED = [
    "cameras",
    "targets",
    "arms",
    "relative",
    "pairs",
    "camera_names",
    "target_names",
    "camera_poses",
    "of_camera",
    "one_of_each",
    "new_measurements",
    "headline",
    "status",
    "reasons",
    "contradictions",
    "answered",
    "usable",
    "findings",
    "warnings",
    "advice",
    "remedy",
    "is_stated",
    "open_words",
    "split",
    "facts",
    "verdicts",
    "conformity",
    "provenance",
    "about",
    "kinematics",
    "n_measured",
    "item",
    "digest",
    "identity",
    "summary",
    "report",
    "export",
    "save",
    "to_json",
    "to_dict",
    "from_dict",
    "from_json",
]


def test_no_branch_asks_for_the_kind_of_a_result():
    asked = [
        f"{path.relative_to(ROOT)}: {found[0]}"
        for path in sorted((ROOT / "uq_handeye").rglob("*.py"))
        for found in ASKS.finditer(path.read_text(encoding="utf-8"))
    ]
    assert asked == []


@pytest.mark.parametrize(
    "text",
    ["if isinstance(result, RigCalibration):", "isinstance(found, (A, Calibration))", "        case Calibration():",
     "type(result) is RigCalibration", "hasattr(result, 'rig')", "(rig := stored_rig(path)) is None"],
)  # fmt: skip
def test_branches_are_recognised(text):
    assert ASKS.search(text)


def test_what_is_no_branch_is_not():
    for text in (
        "isinstance(camera, CameraCalibration)",
        "def _of_rig(result: RigCalibration)",
        "Calibration.from_json",
    ):
        assert not ASKS.search(text)


def test_both_kinds_have_the_same_names():
    for kind in (uq.Calibration, uq.RigCalibration):
        fields = {*dir(kind), *getattr(kind, "__dataclass_fields__", {}), "provenance", "about", "split", "kinematics"}
        assert [name for name in SHARED if name not in fields] == []
