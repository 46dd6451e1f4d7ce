"""Tables of poses, noise, points and plans in notebooks and as text: units, few digits, colours of the page."""

import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from support import SEED

import uq_handeye as uq
from uq_handeye.core.presentation.document import Answer, Checks
from uq_handeye.core.presentation.html import to_html
from uq_handeye.fit.diagnostics.pose_table import PoseTable
from uq_handeye.fit.diagnostics.task_space import PointUncertainty

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


def words(html):
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", html)).split())


def table(n, **values):
    rng = np.random.default_rng(SEED)
    ones = np.ones(n)
    made = PoseTable("pose", *(1e-3 * rng.random((2, n))), 6 * rng.random(n), ones / n, ones, ("kept",) * n)
    return replace(made, **values)


@pytest.mark.parametrize(
    "made",
    [
        table(30),
        NOISE,
        uq.PairNoise(A=np.eye(6)),
        PointUncertainty(np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)), "base"),
        uq.plan(uq.simulate(n_poses=8, noise=NOISE, seed=SEED), k=1, noise=NOISE, sample=12),
    ],
    ids=lambda made: type(made).__name__,
)
def test_html_keeps_the_colours_of_the_page_and_has_units(made):
    html = made._repr_html_()
    assert type(made).__name__ in words(html)[:20]
    assert "<table" in html and re.search(r"\b(mm|deg)\b", words(html))
    assert not re.search(r"[;\"]color:|<script|http|url\(", html)
    assert html.count("<table") == html.count("</table>") == html.count("overflow-x:auto")
    assert len(repr(made)) < 120 and "array" not in repr(made) and "\n" not in repr(made)


def test_a_pose_table_shows_the_worst_first_and_all_of_them_folded():
    distance2 = np.arange(30.0)
    made = table(30, distance2=distance2, flag=("kept",) * 29 + ("rejected",))
    assert repr(made) == "PoseTable(30 poses: 29 kept, 1 rejected)"
    html = made._repr_html_()
    first, rest = html.split("<details>")
    numbers = [int(k) for k in re.findall(r'<th scope="row"[^>]*>(\d+)<', first)]
    assert numbers == list(range(29, 17, -1))
    assert [int(k) for k in re.findall(r'<th scope="row"[^>]*>(\d+)<', rest)] == list(range(30))
    assert first.count("<tr style=") == 1 and "rejected" in first  # it stands out
    assert "d²" in html and "d^2" not in html
    assert "translation" in made.to_text() and "mm" in made.to_text()
    assert "<details>" not in table(5)._repr_html_()
    assert repr(table(0)) == "PoseTable(0 poses)" and "No poses" in table(0)._repr_html_()


def test_noise_says_what_is_known_of_each_side():
    assert repr(NOISE) == "PoseNoise(robot: 0.02 deg, 0.05 mm; camera: 0.1 deg, 0.5 mm)"
    per_pose = np.diag([1e-6, 1e-6, 4e-6, 1e-6, 1e-6, 1e-6]) * np.arange(1, 4)[:, None, None]
    made = uq.PoseNoise(camera=per_pose)
    assert repr(made) == "PoseNoise(robot: exact; camera: x 0.081, y 0.081, z 0.16 deg, 1.4 mm)"
    assert "3 poses, median" in words(made._repr_html_())
    S = 1e-6 * (np.eye(6) + 0.5 * (np.eye(6, k=1) + np.eye(6, k=-1)))
    assert "robot: the components are correlated, up to 0.50." in words(uq.PoseNoise(robot=S)._repr_html_())
    joint = uq.PoseNoise(camera=np.kron(np.ones((2, 2)) + np.eye(2), 1e-6 * np.eye(6)))
    assert "one joint covariance of all poses" in words(joint._repr_html_())


def test_points_have_their_deviations_and_what_is_open():
    S = np.array([np.diag([1e-6, 4e-6, 1e-6]), np.diag([1e-6, np.inf, 1e-6])])
    made = PointUncertainty(np.array([[0.1, 0.2, 0.3]] * 2), S, "base")
    assert repr(made) == "PointUncertainty(2 points in the base frame: 95 % radius 4.2 to open)"
    text = words(made._repr_html_())
    assert "100.0(1.0) 200.0(2.0) 300.0(1.0) 4.2" in text and "200(open)" in text
    many = PointUncertainty(np.zeros((3, 100, 3)), np.zeros((3, 100, 3, 3)), "gripper")
    assert "300 points in the gripper frame" in words(many._repr_html_())
    assert len(many._repr_html_()) < 120_000
    empty = PointUncertainty(np.zeros((0, 3)), np.zeros((0, 3, 3)), "base")
    assert repr(empty) == "PointUncertainty(0 points in the base frame)" and "<table" in empty._repr_html_()


def test_status_is_printed_and_coloured():
    html = to_html("Title", [Answer("NOT USABLE: <why>", "failed"), Checks([("not run", "noise", "a & b")])], seen=2)
    assert words(html) == "Title NOT USABLE: <why> not run noise a & b"
    assert html.count("border-left:4px solid #") == 2
