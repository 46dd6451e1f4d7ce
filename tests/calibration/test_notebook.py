"""Results in notebooks: self-contained, escaped HTML; the table of six numbers; one-line repr."""

import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import SEED, moved

import uq_handeye as uq
from uq_handeye.calibration.report.text import calibration_html
from uq_handeye.core.geometry.pose_numbers import pose_numbers
from uq_handeye.core.presentation.document import Caution, Code, Heading, Paragraph, Points, Table
from uq_handeye.core.presentation.html import to_html
from uq_handeye.core.presentation.numbers import concise
from uq_handeye.findings import Finding

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
VOID = {"br", "hr", "img", "meta", "link", "input"}


def caution(text):
    return (Finding("stored.text", "caution", {"text": text}),)


@pytest.fixture(scope="module")
def result():
    return uq.calibrate(uq.simulate(15, noise=NOISE, seed=3), noise=NOISE)


@pytest.fixture(scope="module")
def exact():
    return uq.calibrate(uq.simulate(8, seed=3))


class Balanced(HTMLParser):
    """Tags that open and close as they should; texts and attributes collected."""

    def __init__(self, html):
        super().__init__()
        self.open, self.seen, self.texts, self.attributes = [], set(), [], []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.seen.add(tag)
        self.attributes += attributes
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def test_html_has_the_answer_the_numbers_and_the_matrices(result):
    html = Balanced(result._repr_html_())
    text = " ".join(html.texts)
    assert result.headline in text and "(1 sigma, worst direction)" in text
    for check in result.checks:
        assert check.name in html.texts and check.status in html.texts and check.text in html.texts
    assert all(part.name in html.texts for part in result.accuracy.parts) and "Not included: " in text
    for value, std in zip(*pose_numbers(result.X, result.covariance), strict=True):
        assert concise(value, std) in html.texts
    for value in result.X.ravel():
        assert f"{round(value, 9) + 0.0:.9f}" in html.texts
    for value in result.covariance.ravel():
        assert f"{value:.3e}" in html.texts
    assert html.open == [] and {"details", "summary", "table"} <= html.seen
    translation, rotation = (np.sqrt(np.linalg.eigvalsh(result.covariance[k, k])) for k in (slice(3, 6), slice(3)))
    least, largest = 1e3 * translation[[0, -1]]
    assert f"Translation is about equally certain in all directions ({least:.2f} to {largest:.2f} mm)." in text
    assert np.abs(np.linalg.eigh(result.covariance[:3, :3])[1][:, -1]).argmax() == 2
    ratio, (least, largest) = rotation[-1] / rotation[0], np.degrees(rotation[[0, -1]])
    assert (
        f"Rotation is least certain about gripper z: {largest:.2g} deg, {ratio:.1f} times that about its best" in text
    )
    assert f"({least:.2g} deg)." in text


def test_html_needs_nothing_else_and_sets_no_colours_of_the_page(result):
    html = result._repr_html_()
    parsed = Balanced(html)
    assert not parsed.seen & {"script", "link", "style", "img", "iframe"}
    assert {name for name, _ in parsed.attributes} <= {"style", "scope", "colspan"}
    assert "http" not in html and "url(" not in html
    assert not re.search(r"[;\"]color:", html)  # the text keeps the colour of a light or a dark page
    assert all("rgba(" in tint for tint in re.findall(r"background:[^;\"]*", html))
    assert len(html) < 40_000


def test_html_escapes(result):
    nasty = "<script>alert('x')</script> & \"more\""
    html = calibration_html(replace(result, findings=caution(nasty), method=nasty))
    assert "<script" not in html and "&lt;script&gt;" in html
    assert nasty in " ".join(Balanced(html).texts)
    table = Table(nasty, [nasty], [[nasty], [(nasty, 1)]], units=[""], groups=[(nasty, 1)])
    blocks = [Heading(nasty), Paragraph(nasty), Caution(nasty), Points([nasty]), table, Code("", nasty, "")]
    text = to_html(nasty, blocks, beside=nasty)
    assert "<script" not in text
    assert [part.strip() for part in Balanced(text).texts].count(nasty) == 12


def test_a_warning_is_said_once_and_in_full_only_when_unfolded():
    poses = uq.simulate(15, noise=NOISE, seed=3)
    camera = np.array(poses.camera)
    camera[4, :3, 3] += 0.1
    with pytest.warns(uq.InputWarning) as caught:
        found = uq.calibrate(uq.PosePairs(poses.robot, camera), noise=NOISE)
    said = [str(one.message) for one in caught]
    assert len(said) == len(set(said)) == len(found.warnings)
    first, _, rest = calibration_html(found).partition("<details")
    shown, folded = (
        " ".join(Balanced(f"{text}").texts) for text in (first + "</div>", "<details" + rest[: -len("</div>")])
    )
    for sentence in said:
        sentence = sentence.replace("d^2", "d²")
        assert sentence not in shown and folded.count(sentence) == 1
    outliers = next(check for check in found.checks if check.name == "outliers")
    assert outliers.status == "caution" and outliers.text in shown
    assert f"Cautions in full ({len(found.cautions)})" in folded


def test_what_cannot_be_used_is_said_first(result):
    poses = uq.simulate(15, noise=NOISE, seed=3)
    with pytest.warns(uq.InputWarning):
        inverted = uq.calibrate(uq.PosePairs(poses.robot, np.linalg.inv(poses.camera)), noise=NOISE)
    assert not inverted.usable
    html = calibration_html(inverted)
    assert html.index("NOT USABLE") < html.index("<table")
    assert "NOT USABLE" in repr(inverted) and "NOT USABLE" not in repr(result)


def test_without_covariance_it_is_said(exact):
    html = exact._repr_html_()
    assert exact.headline in unescape(html) and "(?)" in html and "nan" not in html.lower()
    assert "Covariance" not in html
    assert repr(exact) == "Calibration(gripper_T_camera by efficient, 8 poses: uncertainty not determined)"
    table = exact.to_dataframe()
    assert table["std"].isna().all()
    assert table["concise"].iloc[0].endswith("(?) mm")


def test_repr_says_the_answer_in_one_line(result):
    pattern = r"Calibration\(gripper_T_camera by efficient, 15 poses: \d\.\d+ mm, 0\.\d+ deg \(1 sigma, worst axis\)\)"
    assert re.fullmatch(pattern, repr(result))
    move = 1e3 * np.sqrt(np.linalg.eigvalsh(result.covariance[3:, 3:])[-1])
    assert f": {move:.2g} mm," in repr(result)
    motions = uq.relative_motions(uq.simulate(15, noise=NOISE, seed=3))
    alone = uq.calibrate(uq.Motions(motions.A, motions.B), noise=uq.PairNoise(B=1e-5 * np.eye(6)), method="4dpa")
    assert repr(alone).startswith("Calibration(X by 4dpa, 14 pairs: ")


def test_table_has_the_numbers_and_their_deviations(result):
    table = result.to_dataframe()
    assert list(table.columns) == ["value", "std", "unit", "concise"]
    assert table.index.name == "gripper_T_camera"
    np.testing.assert_allclose(table["value"][:3].astype(float), 1e3 * result.X[:3, 3])
    rotvec = Rotation.from_matrix(result.X[:3, :3]).as_rotvec()
    np.testing.assert_allclose(table["value"][3:].astype(float), np.degrees(rotvec))
    np.testing.assert_allclose(table["std"][:3].astype(float), 1e3 * result.std[3:])
    # the deviations of the rotation vector, by drawing errors
    errors = np.random.default_rng(SEED).multivariate_normal(np.zeros(6), result.covariance, size=20_000)
    drawn = Rotation.from_matrix(moved(result.X, errors)[:, :3, :3]).as_rotvec()
    np.testing.assert_allclose(table["std"][3:].astype(float), np.degrees(drawn.std(axis=0)), rtol=0.03)
    assert list(table["unit"]) == ["mm"] * 3 + ["deg"] * 3
    for _, row in table.iterrows():
        assert row["concise"] == concise(row["value"], row["std"], row["unit"])


def test_summary_has_the_pieces_of_a_fit_report(result):
    """Variables with deviations, how many data and variables, chi-square and reduced, sorted correlations."""
    text = result.summary(verbose=True, threshold=0.1)
    assert "Data: 90 residuals (6 of each pose), 12 variables (of X and W)." in text
    fit = result.fit
    start = f"Fit: chi-square {fit.chi2:.1f} with 78 degrees of freedom (reduced: {fit.chi2 / 78:.2f})"
    assert start in text
    listed = [abs(float(x)) for x in re.findall(r" with \w+ [xyz]: ([+-]\d\.\d\d)$", text, re.MULTILINE)]
    assert listed == sorted(listed, reverse=True) and min(listed) >= 0.1 and len(listed) > 2


@pytest.mark.slow
def test_every_other_result_has_a_form_for_notebooks():
    poses = uq.simulate(8, noise=NOISE, seed=3)
    results = {
        "Comparison of methods": uq.compare(poses, noise=NOISE, methods=["park", "4dpa"]),
        "Plan": uq.plan(poses, noise=NOISE, k=1),
        "Monte Carlo": uq.monte_carlo(poses, noise=NOISE, trials=100, seed=SEED),
    }
    for title, found in results.items():
        html = found._repr_html_()
        assert title in html and "<table" in html
        if title == "Comparison of methods":  # the verdict is seen at once
            assert html.index(found.verdict) < html.index("<details")
        Balanced(html)
