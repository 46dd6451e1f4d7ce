"""Texts as they were: sentences of all codes, and first screens. A changed text is seen here, and meant or mended.

`UQ_HANDEYE_GOLDEN=write pytest tests/golden` writes them again; read the difference. Numbers of screens are masked:
they belong to the tests of the numbers.
"""

import importlib
import json
import os
import pkgutil
import re
from pathlib import Path

import pytest
from fixtures.rigs import NOISE, PAIR_NOISE, motions_alone, quietly, with_wrong

import uq_handeye as uq
from uq_handeye.findings import Finding, step_after

HERE = Path(__file__).parent
for module in pkgutil.walk_packages(uq.__path__, "uq_handeye."):
    if module.name.endswith(".sentences"):
        importlib.import_module(module.name)
FINDINGS = [Finding.from_dict(one) for one in json.loads((HERE / "findings.json").read_text(encoding="utf-8"))]
WRITE = os.environ.get("UQ_HANDEYE_GOLDEN") == "write"


def same(name, text):
    path = HERE / f"{name}.txt"
    if WRITE:
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8")


def of_finding(finding):
    """Everything that is said about a finding, one line each."""
    check, effect = finding.record.check, finding.effect
    marks = f"{check}; effect {effect:.4g}{'; rejects' if finding.rejects else ''}"
    parts = [f"{finding.code} ({finding.severity}; {marks})", str(finding), finding.phrase]
    step = step_after([finding])
    return "\n    ".join(parts if step is None else [*parts, f"-> {step}"])


def test_sentences():
    same("sentences", "\n".join(map(of_finding, FINDINGS)) + "\n")


def results():
    poses = uq.simulate(25, noise=NOISE, seed=3)
    to_hand = uq.simulate(20, noise=NOISE, seed=4, setup="eye-to-hand")
    inverse = uq.PosePairs(poses.robot, poses.camera, "eye-to-hand")
    return {
        "given": lambda: quietly(poses, noise=NOISE),
        "estimated": lambda: quietly(poses),
        "fixed": lambda: quietly(to_hand, noise=NOISE),
        "motions": lambda: quietly(motions_alone()[1], noise=PAIR_NOISE),
        "method": lambda: quietly(poses, noise=NOISE, method="tsai"),
        "outlier": lambda: quietly(with_wrong(poses, 4), noise=NOISE, robust=True),
        "other_setup": lambda: quietly(inverse, noise=NOISE),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", results())
def test_screens(name):
    result = results()[name]()
    text = f"{result.summary()}\n{'=' * 79}\n{result.summary(verbose=True)}"
    masked = re.sub(r"[-+ ]?\d+(\.\d+)?(e[-+]?\d+)?(\(\d+\))?", "#", text)
    same(name, re.sub(r"[ -]{2,}", "  ", re.sub(r" +\n", "\n", masked)) + "\n")
