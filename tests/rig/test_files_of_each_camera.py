"""A wrong file of one camera of a rig is named, with the option for that camera; a right rig gets no word."""

import os
from pathlib import Path

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.cli.app import main
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.errors import NotConvergedError
from uq_handeye.trials.simulation.several_cameras import simulate_rig

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")]
SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))
HAND = ({"left": "arm", "right": "arm"}, {"board": "world"})
CELL = ({"left": "world", "right": "world"}, {"board": "arm"})
NOISE = {"arm": ("0.3mrad", "0.2mm"), "left": ("1mrad", "0.5mm"), "right": ("1mrad", "0.5mm")}


def longer(C, factor):
    found = C.copy()
    found[:, :3, 3] *= factor
    return found


def transposed(C):
    found = C.copy()
    found[:, :3, :3] = C[:, :3, :3].mT
    return found


FAULTS = {
    "mm": (lambda C: longer(C, 1000.0), "--units right=mm"),
    "cm": (lambda C: longer(C, 100.0), "--units right=cm"),
    "inverse": (inverse, "--camera-frame right=target_T_camera"),
    "transposed": (transposed, "--rotation right=transposed"),
    "size": (lambda C: longer(C, 1.1), "the size of the target is wrong"),
    "shifted": (lambda C: np.roll(C, 1, axis=0), "begins 1 row before"),
}


def run(*arguments):
    with pytest.raises(SystemExit) as exit:
        main([str(part) for part in arguments])
    return exit.value.code


def findings_of(rig):
    """Findings of the result, or of the error, and whether it can be used."""
    try:
        result = uq.calibrate(rig)
    except (uq.InputError, NotConvergedError) as error:
        return error.findings, False
    return result.findings, result.usable


def with_right(rig, C):
    left, right = rig.views
    return uq.Rig(rig.arms, rig.cameras, rig.targets, (left, uq.View("right", right.target, C, right.at)))


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("places", [HAND, CELL], ids=["hand", "cell"])
def test_a_wrong_file_is_named_by_its_camera(places, fault):
    change, option = FAULTS[fault]
    rig, _ = simulate_rig(*places, n_poses=14, noise=NOISE, seed=[SEED, 2])
    found, usable = findings_of(with_right(rig, change(rig.views[1].poses)))
    failures = [one for one in found if one.severity == "failure"]
    assert not usable and option in str(failures[0]) and "right" in failures[0].phrase
    assert not any("Camera left" in str(one) for one in found)


def test_a_target_none_of_whose_views_count_is_named_by_its_camera():
    """Its only camera is in mm: its views count for nothing, and no error of the program comes of it."""
    places = {"left": "world", "right": "arm"}, {"board": "arm", "plate": "world"}
    seen = [("left", "board"), ("right", "plate"), ("left", "plate")]
    rig, _ = simulate_rig(*places, n_poses=12, seen=seen, noise=NOISE, seed=[SEED, 4])
    views = [
        uq.View(view.camera, view.target, longer(view.poses, 1000.0 if view.camera == "right" else 1.0), view.at)
        for view in rig.views
    ]
    found, usable = findings_of(uq.Rig(rig.arms, rig.cameras, rig.targets, views))
    assert not usable and "--units right=mm" in str(found[0])


def test_two_cameras_with_the_poses_of_one_are_named():
    rig, _ = simulate_rig(*HAND, n_poses=12, noise=NOISE, seed=[SEED, 2])
    found, usable = findings_of(with_right(rig, rig.views[0].poses))
    assert not usable and found[0].phrase == "left and right hold the same poses"


def test_a_wrong_setup_is_that_of_both_cameras():
    rig, _ = simulate_rig(*CELL, n_poses=20, noise=NOISE, seed=[SEED, 2])
    found, usable = findings_of(uq.Rig(rig.arms, *HAND, rig.views))
    assert not usable
    assert [one.values["camera"] for one in found if "--setup eye-to-hand" in str(one)] == ["left", "right"]


@pytest.mark.parametrize("places", [HAND, CELL], ids=["hand", "cell"])
def test_a_right_rig_gets_no_word(places):
    for k in range(3):
        rig, _ = simulate_rig(
            *places, n_poses=(8, 20, 40)[k % 3], noise=NOISE, seed=[SEED, 3, k], seen=(1.0, 0.7)[k % 2]
        )
        found, usable = findings_of(rig)
        assert usable and not [one for one in found if one.severity != "note"]


@pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")
@pytest.mark.parametrize(
    ("left", "right", "option"),
    [
        ("left_mm.csv", "right.csv", ["--units", "left=mm"]),
        ("left.csv", "right_inverse.csv", ["--camera-frame", "right=target_T_camera"]),
    ],
)
def test_the_option_that_the_program_names_cures_field_case_18(left, right, option, capsys):
    case = Path(os.environ["UQ_HANDEYE_DATA"]) / "field_cases" / "18_rig_of_two"
    command = ["calibrate", case / "robot.csv", "--camera", f"left={case / left}", "--camera", f"right={case / right}"]
    assert run(*command) == 3
    said = " ".join(capsys.readouterr().out.split())
    assert "NOT USABLE" in said and " ".join(option) in said
    assert run(*command, *option) == 0
