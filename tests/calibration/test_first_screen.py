"""The first screen of many kinds of results: 26 lines of 80 columns, nothing twice, and all else in the long text."""

import re
from dataclasses import replace

import numpy as np
import pytest
from fixtures import few_axes
from fixtures.rigs import NOISE, PAIR_NOISE, motions_alone, quietly, with_wrong
from fixtures.rigs_on_arms import ARM, rig
from support import SEED

import uq_handeye as uq
from uq_handeye.calibration.report.answer import next_step
from uq_handeye.calibration.report.first_screen import LINES, first_screen, title_of
from uq_handeye.core.files.source import Source
from uq_handeye.core.presentation.document import COLUMNS, to_text

POSES = uq.simulate(20, noise=NOISE, seed=SEED)
SMALL = uq.PoseNoise.isotropic(robot=("0.01deg", "0.02mm"), camera=("0.03deg", "0.15mm"))


def of_arm():
    return quietly(rig(np.random.default_rng(SEED)).poses, kinematics=ARM)


CASES = {
    "noise given": lambda: quietly(POSES, noise=NOISE),
    "noise estimated": lambda: quietly(POSES),
    "noise too small, many cautions": lambda: quietly(POSES, noise=SMALL),
    "outliers": lambda: quietly(with_wrong(with_wrong(POSES, 4), 9, 0.03)),
    "prior": lambda: quietly(POSES, prior=uq.NoisePrior(robot=(None, "0.05mm"))),
    "eye-to-hand": lambda: quietly(uq.simulate(20, noise=NOISE, setup="eye-to-hand", seed=SEED), noise=NOISE),
    "few poses": lambda: quietly(POSES.rows(range(4)), noise=NOISE),
    "motions": lambda: quietly(motions_alone()[1], noise=PAIR_NOISE),
    "sandwich": lambda: quietly(POSES, covariance="sandwich"),
    "published": lambda: quietly(POSES, method="park"),
    "scale": lambda: quietly(POSES, noise=NOISE, method="4dpa", scale=1e4),
    "exact data": lambda: quietly(uq.PosePairs(POSES.truth.robot, POSES.truth.camera)),
    "open directions": lambda: quietly(few_axes.rig("scara", 15, np.random.default_rng(2)), noise=few_axes.NOISE),
    "joints": of_arm,
    "not usable, inverse": lambda: quietly(uq.PosePairs(POSES.robot, np.linalg.inv(POSES.camera)), noise=NOISE),
    "not usable, shifted": lambda: quietly(uq.PosePairs(POSES.robot[1:], POSES.camera[:-1]), noise=NOISE),
    "not usable, same file": lambda: quietly(uq.PosePairs(POSES.robot, POSES.robot), noise=NOISE),
}
STATUSES = {"ok", "caution", "failed", "not run"}


@pytest.fixture(scope="module", params=CASES)
def result(request):
    found = CASES[request.param]()
    if found.provenance is not None and "outliers" in request.param:
        names = (
            "recorded_by_the_controller_of_cell_7_on_monday.csv",
            "camera_target_poses_of_monday.csv",
            "joints.csv",
        )
        sources = tuple(Source(name, "csv", 1, "") for name in names)
        found = replace(found, provenance=replace(found.provenance, sources=sources))
    return found


def last_of(result):
    written = "Wrote a_folder_with_a_long_name/of_cell_7/result.json with 19 more files and a_report_of_cell_7.html."
    return (written, f"Next: {next_step(result)}.")


@pytest.mark.slow
def test_it_fits_a_terminal(result):
    verdict = result.verdict("1mm,0.1deg", at="0.5m")
    for document in (
        first_screen(result),
        first_screen(result, last=last_of(result)),
        first_screen(result, last=last_of(result), verdicts={"camera": verdict}),
    ):
        lines = to_text(document, COLUMNS).splitlines()
        assert len(lines) <= LINES and max(map(len, lines)) <= COLUMNS, "\n".join(lines)
    said = str(verdict) if not result.reasons else "NOT SHOWN: X is not usable."
    assert said in " ".join(" ".join(lines).split())
    assert result.summary() == to_text(first_screen(result), COLUMNS)


@pytest.mark.slow
def test_it_has_every_part_once(result):
    text = to_text(first_screen(result, last=last_of(result)), COLUMNS)
    flat = " ".join(text.split())
    lines = text.splitlines()
    assert lines[0].startswith(f"{result.frame} from ") and flat.count(result.headline) == 1
    marked = [line.split("  ")[0] for line in lines if line.split("  ")[0] in STATUSES]
    assert sum(status in ("ok", "not run") for status in marked) <= 1  # one line of those that are not wrong
    for check in result.checks:
        assert re.search(rf"\b{check.name}\b", flat), check.name
        short = check.status in ("ok", "not run")
        assert short or check.text in flat or "as the headline says" in flat
    assert np.allclose([list(map(float, line.split())) for line in _matrix(lines)], result.X, atol=1e-9)
    assert flat.count("Next: ") == 1 and "translation x" in flat and "rotation vector x" in flat
    assert (" +- " in flat or re.search(r"\d\(\d+\)", flat) is not None) == (result.covariance is not None)
    sentences = [part for part in re.split(r"(?<=[.:;])\s|\n\n", flat) if len(part) > 25]
    assert len(sentences) == len(set(sentences))
    if result.reasons:
        assert lines[1].startswith("NOT USABLE: ") and "1 sigma, worst" not in flat
    elif result.accuracy is not None:
        assert not result.usable or "good for a tolerance of " in flat or "no tolerance is shown to be met" in flat
    assert "(assumed)" not in flat and "others)" not in flat
    assert not {"nan", "None", "inf"} & set(re.findall(r"\w+", flat))


def _matrix(lines):
    return [line for line in lines if re.fullmatch(r"(\s*-?\d+\.\d{9}){4}", line)]


@pytest.mark.slow
def test_the_long_text_has_everything(result):
    """The statement, every finding in full, and the numbers behind them."""
    flat = " ".join(result.summary(verbose=True).split())
    for text in (result.headline, *map(str, result.cautions), *(check.name for check in result.checks)):
        assert " ".join(text.split()) in flat
    for caution in result.cautions:
        assert flat.count(" ".join(str(caution).split())) == 1, caution
    for part in ("Residuals of AX = XB", "as quaternion", "(inverse of X)", "Diagnostics"):
        assert part in flat
    assert (result.analysis is None) or "Uncertainty budget of X" in flat


@pytest.mark.slow
def test_it_is_the_same_of_a_stored_result(result):
    again = uq.Calibration.from_dict(result.to_dict())
    assert again.summary() == result.summary() and next_step(again) == next_step(result)


@pytest.mark.slow
def test_the_next_step_is_about_what_matters_most():
    steps = {
        "not usable, inverse": "run again with --camera-frame target_T_camera; or, if the camera is fixed, with "
        "--setup eye-to-hand",
        "not usable, same file": "give the file of the camera poses as the second one",
        "open directions": "add poses that rotate about another axis: uq-handeye plan chooses them",
        "noise too small, many cautions": "leave the noise out, it is then estimated; or correct it",
        "exact data": "give the noise: --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm",
    }
    for name, step in steps.items():
        assert next_step(CASES[name]()) == step
    fine = CASES["noise given"]()
    assert next_step(fine).startswith("take more poses") and next_step(fine, "r.html") == "open r.html"


def test_the_title_is_one_line_whatever_the_files_are_called():
    found = CASES["noise given"]()

    def title(*names):
        sources = tuple(Source(name, "csv", 1, "") for name in names)
        return title_of(replace(found, provenance=replace(found.provenance, sources=sources)))

    end = ": 20 poses, eye-in-hand, efficient"
    assert title("robot.csv", "camera.csv") == f"gripper_T_camera from robot.csv, camera.csv{end}"
    assert title("robot.csv", "camera.csv", "joints.csv") == f"gripper_T_camera from robot.csv + 2 more{end}"
    assert title("r" * 200) == f"gripper_T_camera from {'r' * 11}...{'r' * 10}{end}"
    assert all(len(title(*["x" * n] * 3)) <= COLUMNS for n in range(1, 60))
