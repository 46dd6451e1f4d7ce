"""Every finding has a sentence that takes what is found; nobody else makes one, and no file depends on one."""

import ast
import importlib
import inspect
import json
import pkgutil
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fixtures.rigs import NOISE, PAIR_NOISE, motions_alone, quietly, with_wrong
from support import SEED

import uq_handeye as uq
from uq_handeye import findings
from uq_handeye.findings import Finding

ROOT = Path(uq.__file__).parent
for module in pkgutil.walk_packages(uq.__path__, "uq_handeye."):
    if module.name.endswith(".sentences"):
        importlib.import_module(module.name)
GOLDEN = json.loads((Path(__file__).parent / "golden" / "findings.json").read_text(encoding="utf-8"))
WORDS = {code: record.words for code, record in findings._RECORDS.items() if not code.startswith("tests.")}

COMPONENT = {"name": "robot rotation", "unit": "rad", "value": 1e-3, "low": 0.0, "high": 2e-3, "status": "estimated"}
WHY = Finding("synchronisation.before_other", "note", {"other": "robot"}).to_dict()
ROW = {"row": 3, "rotation": 0.1, "translation": 0.2, "distance2": 30.0}
# Values by the names of the parameters; other numbers, lists and texts are made from the annotations.
NAMED = {
    "components": [COMPONENT, COMPONENT | {"high": None, "status": "fixed"}],
    "component": COMPONENT,
    "coefficients": [{"name": "k1", "value": 0.1, "std": 0.2}],
    "parts": [{"side": "robot", "times": [1.0, 2.0], "why": WHY}],
    "ends": [{"error": "robot rotation", "of": "rad", "value": 1e-6, "usual": 1e-4, "factor": 4.0}] * 2,
    "worst": [ROW],
    "numbers_moved": [{"name": "cx", "before": 640.0, "after": 640.5, "std": 0.1, "sigma": 5.0}],
    "contradicted": [{"name": "cx", "given": 640.0, "wanted": 640.5, "std": 0.1, "sigma": 5.0}],
    "far_points": [{"pose": 3, "point": "A", "distance": 2e-3}],
    "pairs": [[5, 6]],
    "views": [{"kind": "convention", "name": "ros", "spread": 0.1, "off": 0.1, "length": 0.1, "given": 0.5}],
    "readings": [{"kind": "quaternion", "file": None, "order": "wxyz", "length": 0.1}],
    "reading": {"kind": "scale", "factor": 1e-3, "file": "camera", "unit": "mm"},
    "runs": [[3, 4, 0]],
    "stretches": [[0, 10, 0], [10, 20, -1], [20, 30, 1]],
    "part": "rotation",
    "flag": "downweighted",
    "why": "too few",
    "finding": WHY,
    "test": "normality",
    "name": "focal length",
    "length_of": "target",
    "frame": "gripper",
    "sides": ["robot", "camera"],
    "unit": "mm",
    "errors": [{"name": "focal length", "estimate": 0.01, "sd": 1e-3}],
    "told": [{"group": "joint offsets", "share": 0.4}, {"group": "sag", "share": 0.1}],
    "since": "21",
    "rows": [2, 7],
    "larger": [{"name": "left", "rotation": 0.002, "translation": 1e-3, "times": 4.0}],
    "directions": [{"what": "rotation", "axis": [0.0, 1.0, 0.0], "size": 0.1}],
}
MADE = {"float": 0.25, "int": 3, "str": "text", "bool": True, "Sequence[float]": [0.6, 0.0, 0.8],
        "Sequence[int]": [1, 2, 5], "Sequence[str]": ["x", "y"], "list[str]": ["x", "y"],
        "Paths": [{"name": "board", "by": None, "since": "21"}]}  # fmt: skip


def values_of(code):
    words, made = WORDS[code], {}
    if isinstance(words, str):  # a template, which names no types
        return dict(next(one for one in GOLDEN if one["code"] == code)["values"])
    for name, parameter in inspect.signature(words).parameters.items():
        made[name] = NAMED[name] if name in NAMED else MADE[parameter.annotation.removesuffix(" | None")]
    return made


# Codes are in files of results, and keep the name of their topic where its package has another one.
PACKAGES = {
    **dict.fromkeys(("noise_estimation", "one_model"), "graph"),
    **dict.fromkeys(("monte_carlo", "posterior"), "validation"),
    "input_checks": "diagnostics", "propagation": "methods",
}  # fmt: skip


def of_package(code):
    """Return whether the code is worded in the module ``sentences`` of its package."""
    package = PACKAGES.get(code.split(".")[0], code.split(".")[0])
    return any(f'"{code}"' in path.read_text(encoding="utf-8") for path in ROOT.rglob(f"{package}/*sentences.py"))


@pytest.mark.parametrize("code", [code for code in WORDS if code != "stored.text"])
def test_every_code_has_a_sentence_in_its_package(code):
    assert of_package(code)
    values = values_of(code)
    if code == "noise_estimation.exact":
        values["parts"] = ["rotation"]
    if code == "calibration.open":
        values |= {"directions": [[0.0] * 5 + [1.0] + [0.0] * 5 + [-1.0]], "setup": "eye-in-hand"}
    text = str(Finding(code, "note", values))
    text = text.replace('=(None, "', '=("')  # an argument of two sides
    assert text.strip() and "None" not in text and "nan" not in text and "{" not in text


@pytest.mark.parametrize(
    "reading",
    [
        {"kind": "inverse robot", "setup": "eye-in-hand", "length": 0.1},
        {"kind": "inverse camera", "length": 0.1},
        {"kind": "quaternion", "file": "camera", "order": "xyzw", "length": 0.1},
        {"kind": "scale", "factor": 0.5, "file": None, "unit": None},
    ],
)
def test_every_reading_has_words(reading):
    values = {"rotation": 0.1, "translation": 0.1, "readings": [reading]}
    assert "It would fit if" in str(Finding("input_checks.poses_unexplained", "failure", values))


def emitted(node):
    """Codes in calls of Finding(...): the text, or what an f-string begins with."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Finding" and node.args:
        return node.args[0]
    return None


@pytest.mark.docs
def test_only_sentences_have_words_and_only_of_codes_that_are_found():
    """Calls of Finding hold no text but codes, names and states: at most three words, without a full stop."""
    plain, found = [], set()
    for file in ROOT.rglob("*.py"):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if (code := emitted(node)) is None:
                continue
            if isinstance(code, ast.Constant):
                found.add(code.value)
            for part in ast.walk(node):
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    plain.append((file.name, part.value))
    assert [item for item in plain if len(item[1].split()) > 3 or (item[1].endswith(".") and " " in item[1])] == []
    assert found <= set(WORDS) and len(found) > 30


# --------------------------------------------------------------------------------------------------- what is found


def spoilt(seed=SEED):
    """Data sets with something wrong, and how to calibrate them."""
    good = uq.simulate(25, noise=NOISE, seed=seed)
    rng = np.random.default_rng(seed)

    def changed(robot=good.robot, camera=good.camera, setup=good.setup):
        return uq.PosePairs(robot, camera, setup)

    def scaled(T, factor):
        T = T.copy()
        T[:, :3, 3] *= factor
        return T

    lost = good.robot.copy()
    lost[:, 2, 3] = lost[:, 1, 3]
    still = good.camera.copy()
    still[5] = still[4]
    many = uq.simulate(40, noise=NOISE, seed=seed)
    small = uq.PoseNoise.isotropic(robot=("0.002deg", "0.005mm"), camera=("0.005deg", "0.02mm"))
    large = uq.PoseNoise.isotropic(robot=("1deg", "3mm"), camera=("1deg", "5mm"))
    drift = good.camera.copy()
    drift[:, 0, 3] += np.linspace(0, 0.01, len(drift))
    _, alone = motions_alone()
    return {
        "good": (good, {"noise": NOISE}),
        "estimated": (good, {}),
        "other setup": (changed(setup="eye-to-hand"), {"noise": NOISE}),
        "inverse": (changed(camera=np.linalg.inv(good.camera)), {"noise": NOISE, "robust": False}),
        "millimetres": (changed(camera=scaled(good.camera, 1e3)), {"noise": NOISE, "robust": False}),
        "scale": (changed(camera=scaled(good.camera, 1.05)), {"noise": NOISE, "robust": False}),
        "lost column": (changed(robot=lost), {"noise": NOISE, "robust": False}),
        "repeated": (changed(camera=still), {}),
        "wrong one": (with_wrong(good, 4), {"noise": NOISE, "robust": False}),
        "wrong one, robust": (with_wrong(good, 4), {}),
        "shifted": (uq.PosePairs(many.robot[1:], many.camera[:-1], many.setup), {"noise": NOISE, "robust": False}),
        "shuffled": (changed(camera=good.camera[rng.permutation(25)]), {"noise": NOISE, "robust": False}),
        "small noise": (good, {"noise": small, "robust": False}),
        "large noise": (good, {"noise": large}),
        "drift": (changed(camera=drift), {"noise": NOISE, "robust": False}),
        "few": (uq.simulate(4, noise=NOISE, seed=seed), {}),
        "data sheet": (good, {"prior": uq.NoisePrior(robot=("1e-6deg", "1e-6mm"), camera=("1e-5deg", "1e-5mm"))}),
        "motions": (alone, {"noise": PAIR_NOISE}),
        "park": (good, {"method": "park"}),
        "exact": (uq.PosePairs(good.truth.robot, good.truth.camera), {"covariance": "sandwich"}),
    }


def everything_found(result):
    found = list(result.findings)
    if result.noise_estimate is not None:
        found += result.noise_estimate.findings
    if result.analysis is not None:
        found += [*result.diagnostics.findings, result.split_half.finding, result.split_in_time.finding]
    return found


@pytest.mark.docs
@pytest.mark.parametrize("name", spoilt())
def test_what_is_found_in_bad_data_has_words_and_is_stored_as_it_is(name):
    data, options = spoilt()[name]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = uq.calibrate(data, **options)
    assert [str(item.message) for item in caught] == list(result.warnings)
    assert all(item.category is uq.InputWarning for item in caught)
    for finding in everything_found(result):
        assert finding.code in WORDS
        words = WORDS[finding.code]
        assert isinstance(words, str) or words(**finding.values) == str(finding)
        assert "this version has no sentence" not in str(finding)
    again = uq.Calibration.from_dict(json.loads(result.to_json()))
    assert again.findings == result.findings and everything_found(again) == everything_found(result)
    assert again.summary() == result.summary()


@pytest.mark.docs
def test_severity_says_whether_X_can_be_used():
    worst = {
        name: max((found.severity for found in quietly(data, **options).findings), key=ORDER.index, default="note")
        for name, (data, options) in spoilt().items()
        if name in EXPECTED
    }
    assert worst == EXPECTED


ORDER = ("note", "caution", "failure")
EXPECTED = {
    "good": "note",
    "other setup": "failure",
    "inverse": "failure",
    "millimetres": "failure",
    "shifted": "failure",
    "shuffled": "failure",
    "small noise": "failure",
    "large noise": "caution",
    "repeated": "caution",
    "wrong one, robust": "caution",
    "few": "caution",
}


# -------------------------------------------------------------------------------------------------- what is stored


@pytest.mark.docs
def test_a_reworded_sentence_leaves_files_readable(monkeypatch):
    result = quietly(with_wrong(uq.simulate(20, noise=NOISE, seed=SEED), 4))
    data = json.loads(result.to_json())
    for code in WORDS:
        words = lambda code=code, **_: f"Something else about {code}."  # noqa: E731
        monkeypatch.setitem(findings._RECORDS, code, replace(findings._RECORDS[code], words=words))
    again = uq.Calibration.from_dict(data)
    assert again.findings == result.findings
    np.testing.assert_array_equal(again.covariance, result.covariance)
    assert again.warnings == tuple(f"Something else about {f.code}." for f in result.findings if f.severity != "note")


@pytest.mark.docs
def test_reading_words_nothing(monkeypatch):
    result = quietly(with_wrong(uq.simulate(20, noise=NOISE, seed=SEED), 4))
    data = json.loads(result.to_json())

    def never(*args, **values):
        pytest.fail("a sentence was made")

    monkeypatch.setattr(Finding, "__str__", never)
    monkeypatch.setattr(uq.Calibration, "to_dict", never)
    monkeypatch.setattr(uq.Calibration, "summary", never)
    assert uq.Calibration.from_dict(data).findings == result.findings


@pytest.mark.docs
def test_no_time_of_day_is_stored():
    poses = uq.simulate(20, noise=NOISE, seed=SEED)
    assert quietly(poses).to_json() == quietly(poses).to_json()


@pytest.mark.stored
def test_a_code_of_tomorrow_leaves_a_file_readable():
    data = quietly(uq.simulate(20, noise=NOISE, seed=SEED), noise=NOISE).to_dict()
    new = {"code": "calibration.of_tomorrow", "severity": "caution", "values": {"share": 0.5}}
    again = uq.Calibration.from_dict(data | {"findings": [new]})
    assert again.to_dict()["findings"] == [new] and "calibration.of_tomorrow: share = 0.5" in again.warnings[0]


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5])
def test_other_formats_are_refused_by_name(number, tmp_path):
    file = tmp_path / "result.json"
    file.write_text(json.dumps({"format": f"uq-handeye calibration {number}"}), encoding="utf-8")
    with pytest.raises(uq.InputError, match=rf"got 'uq-handeye calibration {number}'"):
        uq.Calibration.from_json(file)
