"""MJCF models: chains out of them against MuJoCo's own kinematics, and what is refused, by name."""

import json
from pathlib import Path

import numpy as np
import pytest
from kinematics.poses_of_mujoco import MODELS, G

from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.errors import InputError
from uq_handeye.model.kinematics.chain import Kinematics

STORED = json.loads(Path(__file__).with_name("poses_of_mujoco.json").read_text(encoding="utf-8"))
CASES = [(name, tip) for name, (_, tips) in MODELS.items() for tip in tips]


def one(body="", joint='<joint name="j"/>', rest=""):
    return f'<mujoco>{rest}<worldbody><body name="a" {body}>{joint}{G}</body></worldbody></mujoco>'


@pytest.mark.parametrize(("name", "tip"), CASES)
def test_poses_are_those_of_mujoco(name, tip):
    stored = STORED[name]
    chain = Kinematics.from_mjcf(MODELS[name][0], None, tip)
    q = np.array(stored["joints"])[:, [stored["names"].index(joint) for joint in chain.names]]
    np.testing.assert_allclose(chain.poses(q)[:, :3], stored["poses"][tip], atol=1e-9)
    for limits, joint in zip(chain.limits, chain.names, strict=True):
        known = stored["limits"][stored["names"].index(joint)]
        np.testing.assert_allclose(limits, [-np.inf, np.inf] if known is None else known, atol=1e-12)


def test_base_below_the_world_has_its_own_direction_of_gravity():
    text, _ = MODELS["classes"]
    whole, part = Kinematics.from_mjcf(text, None, "hand"), Kinematics.from_mjcf(text, "foot", "hand")
    q = np.array(STORED["classes"]["joints"])
    base_T_world = part.poses(q) @ inverse(whole.poses(q))
    np.testing.assert_allclose(base_T_world, np.broadcast_to(base_T_world[0], base_T_world.shape), atol=1e-12)
    np.testing.assert_allclose(part.up, base_T_world[0, :3, :3] @ [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(Kinematics.from_mjcf(text, None, "hand", up=[1, 0, 0]).up, [1, 0, 0])
    sideways = one(rest='<option gravity="0 -3 0"/>')
    np.testing.assert_allclose(Kinematics.from_mjcf(sideways).up, [0, 1, 0])


def test_the_only_end_is_the_tip():
    chain = Kinematics.from_mjcf(MODELS["radians"][0])
    assert (chain.base, chain.tip, chain.names) == ("world", "c", ("j1", "j2", "j3"))


def test_files_are_read_as_texts_are(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(MODELS["radians"][0], encoding="utf-8")
    a, b = Kinematics.from_mjcf(path), Kinematics.from_mjcf(MODELS["radians"][0])
    np.testing.assert_array_equal(a.poses([0.1, 0.2, 0.1]), b.poses([0.1, 0.2, 0.1]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot/>", r"line 1: expected an MJCF model, which starts with <mujoco>, got <robot>; give a URDF by --urdf"),
        ("<mujoco>", "not XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "without a document type or entities"),
        ('<mujoco>\n<include file="arm.xml"/></mujoco>', r"line 2: <include> is not read.*mj_saveLastXML"),
        (one(joint='<joint/><replicate count="3"/>'), "<replicate> is not read"),
        (one(rest='<compiler angle="grad"/>'), "degree or radian, got 'grad'"),
        (one(rest='<compiler coordinate="global"/>'), "global coordinates"),
        (one(rest='<compiler eulerseq="xya"/>'), "eulerseq, got 'xya'"),
        (one('quat="1 0 0 0" euler="0 0 1"'), "body 'a' has quat and euler; expected one orientation"),
        (one('quat="0 0 0 0"'), "quat is no orientation"),
        (one('pos="1 2"'), "expected 3 finite numbers as pos, got '1 2'"),
        (one('pos="1 2 nan"'), "expected 3 finite numbers as pos"),
        (one('pos="300 0 900"'), "is the model in millimetres"),
        (one(joint='<joint axis="0 0 0"/>'), "the axis is zero"),
        (one(joint='<joint name="j" class="fast"/>'), "of the class 'fast', which <default> does not have"),
        (one(joint='<joint name="j" type="ball"/>'), "joint 'j' is of the type 'ball'; expected hinge and slide"),
        (one(joint="<freejoint/>"), "joint 'a_joint' is of the type 'free'.*give the base that floats"),
        (one(joint=""), "no body moves with respect to 'world'"),
        (one(joint='<joint name="j"/><joint name="j"/>'), "two joints of this name"),
        (one(rest='<compiler autolimits="false"/>', joint='<joint range="0 1"/>'), "range and, with autolimits false"),
        (one(rest='<equality><joint joint1="j" joint2="k"/></equality>'), "'j' is coupled to 'k' by <equality>"),
        (one(joint=f'<joint/><body name="b">{G}</body><body name="c">{G}</body>'), "several ends, 'b', 'c'; give"),
    ],
)  # fmt: skip
def test_what_is_no_chain_is_refused(text, message):
    with pytest.raises(InputError, match=f"(?s){message}"):
        Kinematics.from_mjcf(text)


@pytest.mark.parametrize(
    ("base", "tip", "message"),
    [
        (None, "hnad", "no body or site 'hnad' for the tip; nearest: 'hand'"),
        ("box", "hand", "the tip 'hand' is not below the base 'box'"),
        ("hand", "tool", "no joint moves between 'hand' and 'tool'"),
    ],
)
def test_wrong_ends_are_refused(base, tip, message):
    with pytest.raises(InputError, match=message):
        Kinematics.from_mjcf(MODELS["classes"][0], base, tip)


def test_a_urdf_reader_names_the_option_of_mjcf():
    with pytest.raises(InputError, match=r"give an MJCF model by --robot-model FILE\.xml"):
        Kinematics.from_urdf(one())
