"""The report as text: what stands in it, for every kind of result; escaping; the same file again."""

import html
import json
import os
import re
import subprocess
import sys
import warnings
import zlib
from dataclasses import replace
from functools import cache
from importlib import resources
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fixtures.reports import Page
from support import SEED, missing

import uq_handeye as uq
from uq_handeye.calibration.accuracy import Statement
from uq_handeye.calibration.parts import Provenance
from uq_handeye.calibration.report.answer import status_with
from uq_handeye.calibration.tolerance import Tolerance, Verdict
from uq_handeye.core.files.about import ABOUT
from uq_handeye.core.files.source import Source
from uq_handeye.core.presentation import page as pdf
from uq_handeye.core.presentation.figure_parts import canvas
from uq_handeye.core.presentation.html import pretty
from uq_handeye.errors import InputError, InputWarning, MissingExtraError
from uq_handeye.findings import Finding
from uq_handeye.fit.graph.reference import Reference
from uq_handeye.model.poses.timing import TimeOffset, Timing
from uq_handeye.report import sections
from uq_handeye.report.comparison.compare import compare_result
from uq_handeye.report.page import report_html
from uq_handeye.report.sections import NO_COVARIANCE

pytestmark = pytest.mark.slow

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
FOLDED = [
    "full", "ellipses", "residuals", "full-budget", "shared", "task-space", "observability", "noise", "covariances",
    "methods", "scope", "forms", "repeat",
]  # fmt: skip
FIRST = ["answer", "checks", "by-pose", "x", "ahead"]


def caution(text):
    return (Finding("stored.text", "caution", {"text": text}),)


def simulated(n=12, **options):
    return uq.simulate(n_poses=n, noise=NOISE, seed=SEED, **options)


@pytest.fixture(scope="module")
def result():
    return uq.calibrate(simulated(), noise=NOISE)


@pytest.fixture(scope="module")
def small():
    """A result without figures, whose report takes no time."""
    return uq.calibrate(uq.simulate(n_poses=6, seed=SEED))


@pytest.fixture(scope="module")
def text(result):
    return report_html(result, comparison=compare_result(result), date="some day")


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


@pytest.fixture
def quick(monkeypatch, without_rendering):
    """Without the pictures, which take longest and have tests of their own."""
    monkeypatch.setattr("uq_handeye.report.figures.covariance_ellipses", lambda *_, **__: canvas(1.0))


def bare_motions():
    motions = uq.relative_motions(simulated(), "consecutive")
    return uq.calibrate(uq.Motions(motions.A, motions.B), noise=uq.PairNoise(B=1e-6 * np.eye(6)))


CASES = {
    "eye-to-hand": lambda: uq.calibrate(simulated(setup="eye-to-hand"), noise=NOISE),
    "estimated": lambda: uq.calibrate(simulated()),
    "motions": bare_motions,
    "published": lambda: uq.calibrate(simulated(), noise=NOISE, method="park"),
    "exact": lambda: uq.calibrate(uq.simulate(n_poses=6, seed=SEED)),
    "three poses, Hotelling": lambda: replace(
        uq.calibrate(uq.simulate(n_poses=4, noise=NOISE, seed=SEED), noise=NOISE),
        reference=Reference("Hotelling", 3.0),
    ),
    "loaded": lambda: replace(uq.calibrate(simulated(), noise=NOISE), data=None),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")
def test_every_kind_of_result_has_every_section(case, quick):
    of = CASES[case]()
    found = Page(report_html(of))
    anchors = [attributes["id"] for attributes in found.all("section")]
    assert anchors[:5] == FIRST and anchors[-len(FOLDED) :] == FOLDED
    middle = [name for name in anchors[5 : -len(FOLDED)] if name not in ("cautions", "further")]
    assert middle == (["error", "budget", "rig"] if case not in ("exact", "published") else ["error", "budget"])
    assert len(found.all("details")) == len(FOLDED) + ("further" in anchors)
    assert found.broken == [] and found.stack == []
    for anchor in FOLDED:
        assert len(found.words(anchor)) > 60, anchor
    everything = " ".join(found.texts.values())
    assert not re.search(r"\b(nan|inf|None|<NA>)\b", everything)
    said = {
        "motions": ("rig", "the motions came without poses."),
        "published": ("observability", "by the methods efficient and ml, not by park."),
        "exact": ("answer", "The accuracy of gripper_T_camera is not known"),
        "loaded": ("rig", "the stored result holds no poses"),
        "three poses, Hotelling": ("scope", "There is no 95 % ellipsoid from so few poses"),
        "estimated": ("noise", "Noise, estimated from the residuals"),
        "eye-to-hand": ("x", "X: the camera in the base frame"),
    }[case]
    assert said[1] in found.words(said[0])
    assert repeated(found) == []
    for anchor, text in found.texts.items():
        if anchor not in ("answer", "cautions", "further", "noise", "forms", "repeat", ""):  # findings have advice
            assert not re.search(r"(?<![\w-])--[a-z]|\w=\w|result\.[a-z]", text), anchor


def repeated(found):
    """Sentences of some length that stand twice among paragraphs and list items."""
    said = [part.strip() for text in found.prose for part in re.split(r"(?<=[.!?]) (?=[A-Z])", text)]
    others = [found.words("forms"), "Not known, because", NO_COVARIANCE, "The budget is computed"]  # say why not
    return [
        part
        for part in {*said}
        if len(part) > 40 and said.count(part) > 1 and not any(part in text or text in part for text in others)
    ]


def test_the_number_comes_first_and_x_has_its_deviations(result, page):
    assert page.words("answer").startswith(f"Result {result.headline}")
    words = page.words("x")
    for k, axis in enumerate("xyz"):
        found = re.search(rf"translation {axis} ([\N{{MINUS SIGN}}\d.]+) ([\d.]+) mm", words)
        shown = found[1].replace("\N{MINUS SIGN}", "-")
        last = 10.0 ** -len(shown.partition(".")[2])
        assert float(shown) == pytest.approx(1e3 * result.X[k, 3], abs=0.51 * last)
        assert float(found[2]) == pytest.approx(1e3 * result.std[3 + k], rel=0.05)
    translation, rotation = result.facts.directions
    assert translation in page.words("full") and rotation in page.words("full")


def test_every_check_is_a_line_with_its_word(result, page):
    words = page.words("checks")
    for check in result.checks:
        assert f"{check.status} {check.name} {pretty(check.text)}" in words


def test_points_ahead_agree_with_the_headline(result, page):
    accuracy = result.accuracy
    row = re.search(r"([\d.]+) m \(target\) ([\d.]+) ([\d.]+)", page.words("ahead"))
    assert [float(x) for x in row.groups()] == pytest.approx(
        [accuracy.distance, 1e3 * accuracy.point, 1e3 * accuracy.point_95], rel=0.05
    )
    at = result.accuracy.distance * 2
    further = re.search(rf"{at:.3g}0* m ([\d.]+)", page.words("ahead"))
    point = result.uncertainty_at([0, 0, at]).covariance
    assert float(further[1]) == pytest.approx(1e3 * np.sqrt(np.linalg.eigvalsh(point)[-1]), rel=0.05)


@pytest.mark.parametrize(
    ("statuses", "usable", "word", "colour", "of_verdict"),
    [
        (["ok", "ok"], True, None, "ok", None),
        (["ok", "ok"], True, "PASS", "ok", "ok"),
        (["ok", "ok"], True, "NOT SHOWN", "ok", "caution"),
        (["ok", "ok"], True, "FAIL", "ok", "failed"),
        (["ok", "not run"], True, "PASS", "ok", "ok"),
        (["ok", "caution"], True, None, "caution", None),
        (["ok", "failed"], False, "NOT SHOWN", "failed", "failed"),
    ],
)
def test_the_colour_is_that_of_terminal_and_notebook(statuses, usable, word, colour, of_verdict):
    checks = tuple(SimpleNamespace(status=status) for status in statuses)
    of = SimpleNamespace(
        checks=checks,
        reasons=() if usable else ("why",),
        accuracy=SimpleNamespace(lower_limit=False),
        cautions=("one",) if "caution" in statuses else (),
    )
    status = Statement.status.fget
    assert status(of) == colour
    if word is not None:
        verdict = Verdict(word, None, Tolerance.read("1mm"))
        assert status_with(SimpleNamespace(status=status(of)), verdict) == of_verdict
    of.accuracy.lower_limit = True
    assert status(of) != "ok"
    of.accuracy = None
    assert status(of) != "ok"


def test_the_verdict_stands_on_page_one(result, quick):
    for tolerance, word in (("1m,10deg", "PASS"), ("0.001mm", "FAIL")):
        verdict = result.verdict(tolerance)
        words = Page(report_html(result, verdict=verdict, folded=False)).words("answer")
        assert verdict.word == word or verdict.reasons
        assert f"{verdict.word} {verdict.sentence}" in words


def test_cautions_stand_out_in_the_order_of_their_effect(small):
    texts = [f"The axes are <parallel>, number {k}. {'x' * 300}." for k in range(8)]
    of = replace(small, findings=tuple(found for text in texts for found in caution(text)))
    warned = Page(report_html(of))
    assert warned.words("cautions").startswith("Cautions Caution The axes are <parallel>, number 0.")
    assert {"class": "marked"} in warned.all("li")
    everything = f"{warned.words('cautions')} {warned.words('further')}"
    assert [everything.count(text) for text in texts] == [1] * 8  # those that do not fit have a section
    assert sorted(texts, key=everything.index) == [str(found) for found in of.cautions if str(found) in texts]
    assert "further" in [attributes["id"] for attributes in warned.all("section")]
    assert "cautions" not in Page(report_html(small)).texts


def test_what_was_not_tested_is_said(quick):
    few = uq.calibrate(simulated(n=5), noise=NOISE)
    for found in (few, uq.calibrate(simulated(n=5), noise=NOISE, method="park")):
        words = Page(report_html(replace(found, findings=()))).words("observability")
        assert "Tests that were not run:" in words and re.search("(was|were) not run, because", words)
    words = Page(report_html(few)).words("observability")
    for test in ("autocorrelation", "normality", "linear pattern", "split-half test (even and odd rows)"):
        assert test in words
    estimated = uq.calibrate(simulated())
    assert estimated.fit.p_value is None and json.loads(estimated.to_json())["fit"]["p_value"] is None
    everything = " ".join(Page(report_html(estimated)).texts.values())
    assert "chi-square test of the noise was not run" in everything


def test_the_title_block_is_escaped_and_has_room_to_write(small, tmp_path):
    hostile = "<script>alert(1)</script>"
    of = replace(small, about={"cell": "B7"})
    text = of.report(tmp_path / "r.html", comparison=False, about={"operator": hostile, "note": "A note."}).read_text(
        encoding="utf-8"
    )
    assert hostile not in text
    found = Page(text)
    words = found.words("")
    for part in ("Cell B7", f"Operator {hostile}", "Note A note."):
        assert part in words
    assert len([a for a in found.all("div") if a.get("class") == "blank"]) == 6
    assert "Robot serial number" in words and "Signature" in " ".join(found.texts.values())
    with pytest.raises(InputError, match="Unknown name 'colour'"):
        of.report(tmp_path / "r.html", comparison=False, about={"colour": "red"})


def test_a_finding_keeps_its_advice_and_stands_once(small):
    found = caution('The target moves. It fits with setup="eye-to-hand" (--setup eye-to-hand). Look at the files.')
    page = Page(report_html(replace(small, findings=found)))
    assert "Caution The target moves. It fits with setup=" in page.words("cautions")
    assert sum("The target moves." in text for text in page.prose) == 1


@pytest.mark.browser
@pytest.mark.parametrize(
    ("case", "paper"), [("demo", "a4"), ("kuka_1", "letter"), ("not usable", "letter"), ("exact", "a4")]
)
@pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")
def test_two_printed_pages(case, paper, tmp_path):
    if pdf.find_weasyprint() is None:
        missing("browser", "needs WeasyPrint (extra pdf) and Pango (Debian: libpango-1.0-0, libpangoft2-1.0-0)")
    if case in ("kuka_1", "not usable") and "UQ_HANDEYE_DATA" not in os.environ:
        pytest.skip("needs UQ_HANDEYE_DATA")
    of = replace(printed(case), about=dict.fromkeys(ABOUT, "A text of the length that a text may have, 80 signs or so"))
    path = of.report(tmp_path / "report.pdf", paper=paper, verdict=of.verdict("1mm,0.1deg"))
    assert pages_of(path) == 2


@cache
def printed(case):
    if case == "demo":
        data = resources.files("uq_handeye") / "data"
        return uq.calibrate(uq.read_poses(data / "robot.csv", data / "camera.csv"), noise=NOISE)
    if case == "exact":
        return CASES["exact"]()
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / "kuka_1"
    poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv")
    if case == "kuka_1":
        return uq.calibrate(poses)
    return uq.calibrate(uq.PosePairs(poses.robot, np.linalg.inv(poses.camera)), noise=NOISE)


def pages_of(path):
    """The number of pages that the tree of a PDF states."""
    data = path.read_bytes()
    parts = re.findall(rb"FlateDecode.*?stream\r?\n(.*?)endstream", data, re.DOTALL)
    texts = [data, *(zlib.decompress(part) for part in parts if part[:1] == b"x")]
    counts = [re.findall(rb"/Type /Pages.*?/Count (\d+)", text, re.DOTALL) for text in texts]
    return max(int(count) for found in counts for count in found)


def test_a_full_report_has_the_folded_sections_open(small, tmp_path):
    found = Page(small.report(tmp_path / "r.html", comparison=False, details=True).read_text(encoding="utf-8"))
    assert all("open" in attributes for attributes in found.all("details"))
    assert not any("open" in attributes for attributes in Page(report_html(small)).all("details"))
    with pytest.raises(InputError, match="`paper` to be a4 or letter"):
        small.report(tmp_path / "r.pdf", paper="a5")


def test_methods_are_compared_with_this_result(result, page, quick):
    words = page.words("methods")
    assert "efficient (this result)" in words
    for name in uq.METHODS:
        assert f" {name} " in words
    assert "66 pairs of 12 poses" in words
    given = uq.compare(simulated(), noise=NOISE, methods=["4dpa", "li", "tsai"])
    own = Page(report_html(result, comparison=given)).words("methods")
    assert given.verdict in own.replace("²", "^2") and "this result" not in own
    for row in given.rows:
        if row.failure is not None:
            assert row.failure in own


def test_rejected_poses_are_left_out_of_the_comparison(quick):
    poses = simulated()
    camera = np.array(poses.camera)
    camera[4, :3, 3] += 0.1
    with pytest.warns(uq.InputWarning):
        of = uq.calibrate(uq.PosePairs(poses.robot, camera))
    words = Page(report_html(of, comparison=compare_result(of))).words("methods")
    assert "55 pairs of 11 poses" in words and "Without the pose rejected here." in words


def test_a_cross_check_lists_its_relations(result, quick):
    check = uq.cross_check(simulated(), noise=NOISE, trials=200, posterior=False)
    words = Page(report_html(result, cross_check=check)).words("ellipses")
    for relation in check.relations:
        assert relation.statement.replace("`", "") in words
    assert "Cross-check, 200 trials" in words
    assert "No cross-check was run." in Page(report_html(result)).words("ellipses")


def test_everything_to_repeat_the_run(small):
    source = Source("rig<script>alert(1)</script>.csv", "csv", 1234, "ab" * 32, ("metres & <b>scalar</b> last",))
    before = small.provenance
    command = 'uq-handeye calibrate "a b.csv" --robot-noise <x>'
    made = Provenance(before.data_sha256, before.options, before.versions, (source,), command)
    text = report_html(replace(small, provenance=made))
    assert "alert(1)</script>" not in text and "<b>scalar" not in text
    words = Page(text).words("repeat")
    for part in (source.name, "1,234", source.sha256, source.notes[0], command, before.data_sha256):
        assert part in words
    for name, value in (before.options | before.versions).items():
        assert name in words and ("not given" if value is None else str(value)) in words
    assert "report written on" in words.lower()
    without = Page(report_html(replace(small, provenance=None))).words("repeat")
    assert "Not known where this result comes from" in without


def test_x_is_there_to_copy(result, text):
    from uq_handeye.formats.snippets import texts

    for snippet in texts(result):
        assert html.escape(snippet.text, quote=True).replace("&#x27;", "&#39;").replace("&quot;", "&#34;") in text


def test_the_convention_and_the_limits_are_said(page):
    words = page.words("scope")
    for part in ("rotation first, left rotation", "Systematic errors", "no accuracy"):
        assert part in words


# --------------------------------------------------------------------------------------------------- the file itself


def test_nothing_is_loaded_from_anywhere(page, text):
    for tag, attributes in page.elements:
        for name, value in attributes.items():
            if name in ("src", "href", "xlink:href", "action", "data", "srcset", "poster"):
                assert value.startswith(("#", "data:")), (tag, name, value)
    assert "@import" not in text
    assert not re.search(r"url\((?!#|&#34;#)", text)
    assert "default-src 'none'" in text
    assert len(text.encode()) < 3_000_000


def test_accessible(page):
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(b <= a + 1 for a, b in pairwise(levels))
    assert page.all("html")[0]["lang"] == "en"
    figures = [a for a in page.all("div") if a.get("role") == "img"]
    assert len(figures) == len(page.all("figure")) == len(page.all("figcaption")) == 8
    assert all(len(a["aria-label"]) > 60 for a in figures)
    assert all(a.get("scope") in ("row", "col") for a in page.all("th"))
    ids = [a["id"] for _, a in page.elements if "id" in a]
    assert len(ids) == len(set(ids))
    targets = [a["href"][1:] for a in page.all("a")]
    assert {"answer", *FOLDED} <= set(targets) <= set(ids)
    assert all(a["aria-labelledby"] in ids for a in page.all("table"))


def test_the_same_result_gives_the_same_file(result, text):
    other = report_html(result, comparison=compare_result(result), date="another day")
    assert other.replace("another day", "some day") == text


def test_a_page_computes_nothing(quick, tmp_path, monkeypatch):
    """Neither a calibration nor a test of the data: the result has them, the comparison was handed over."""
    of = uq.calibrate(simulated(), noise=NOISE)
    given = compare_result(of)
    assert all(row.seconds is None for row in given.comparison.rows)  # no time is shown, none is measured
    of.summary(verbose=True)  # asks for what the result works out when it is first asked for

    def computes(*_, **__):
        raise AssertionError("the report computes")

    for name in (
        "calibration.calibrate.calibrate",
        "report.comparison.compare.calibrate",
        "report.comparison.compare.compare",
        "calibration.analysis.diagnose",
        "calibration.analysis.resampled",
        "calibration.analysis.split_fit",
        "calibration.analysis.budget",
    ):
        monkeypatch.setattr(f"uq_handeye.{name}", computes)
    of.report(tmp_path / "given.html", comparison=given)
    of.report(tmp_path / "none.html", comparison=False)
    assert "Not compared with other methods." in (tmp_path / "none.html").read_text(encoding="utf-8")


def test_true_compares_before_the_page_is_written(small, quick, tmp_path):
    text = small.report(tmp_path / "report.html").read_text(encoding="utf-8")
    assert "efficient (this result)" in Page(text).words("methods")


def test_written_whole_or_not_at_all(small, tmp_path):
    path = tmp_path / "report.html"
    assert small.report(path, comparison=False) == path
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    for name in ("report.txt", "report"):
        with pytest.raises(InputError, match=r"`path` to end in .html or .pdf"):
            small.report(tmp_path / name)
    with pytest.raises(InputError, match="no-such-folder"):
        small.report(tmp_path / "no-such-folder" / "report.html", comparison=False)
    with pytest.raises(InputError, match="`comparison` to be True, False or a Comparison, got str"):
        small.report(path, comparison="yes")
    other = uq.compare(simulated(setup="eye-to-hand"), noise=NOISE, methods=["4dpa"])
    with pytest.raises(InputError, match=r"`comparison` to be of gripper_T_camera.*base_T_camera"):
        small.report(path, comparison=other)


def test_pdf_without_any_printer_names_both_ways(small, tmp_path, monkeypatch):
    monkeypatch.setattr(pdf, "find_weasyprint", lambda: None)
    monkeypatch.setattr(pdf.shutil, "which", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"WeasyPrint.*\.\[pdf\].*Chromium"):
        small.report(tmp_path / "report.pdf", comparison=False)
    assert list(tmp_path.iterdir()) == []


def test_pdf_by_a_browser_that_fails_says_so(small, tmp_path, monkeypatch):
    monkeypatch.setattr(pdf, "find_weasyprint", lambda: None)
    monkeypatch.setattr(pdf.shutil, "which", lambda name: sys.executable)  # does not know the options
    with pytest.raises(InputError, match=r"did not print the report.*\.html"):
        small.report(tmp_path / "report.pdf", comparison=False)


@pytest.mark.browser
def test_pdf_by_weasyprint(tmp_path):
    if pdf.find_weasyprint() is None:
        missing("browser", "needs WeasyPrint (extra pdf) and Pango (Debian: libpango-1.0-0, libpangoft2-1.0-0)")
    path = CASES["published"]().report(tmp_path / "report.pdf", comparison=False)
    assert path.read_bytes().startswith(b"%PDF") and path.stat().st_size > 50_000


@pytest.mark.parametrize(
    ("plain", "shown"),
    [
        ("d^2 = -1.5 +- 2", "d² = \N{MINUS SIGN}1.5 ± 2"),
        ("(-0.2, -3)", "(\N{MINUS SIGN}0.2, \N{MINUS SIGN}3)"),
        ("1e-15 on 2026-11-21, x-1", "1e-15 on 2026-11-21, x-1"),
        ("--robot-noise of `ml`", "--robot-noise of ml"),
    ],
)
def test_signs_of_print(plain, shown):
    assert pretty(plain) == shown


def test_the_package_stays_light():
    code = "import sys, uq_handeye; assert not {'matplotlib', 'jinja2', 'weasyprint', 'pandas'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


# ------------------------------------------------------------------------------------------------- what repeats a run


def test_the_noise_that_was_given_can_be_given_again(result):
    words = " ".join(t for row in sections._noise(result) for t in row)
    for name, rotation, translation in (("robot", 0.02, 5e-5), ("camera", 0.1, 5e-4)):
        found = re.search(rf"noise of {name} (\S+) rad, (\S+) m", words)
        assert np.allclose([float(x) for x in found.groups()], [np.radians(rotation), translation], rtol=1e-12)
    several = uq.PoseNoise(None, np.stack([NOISE.camera] * 12))
    facts = sections._noise(replace(result, noise=several))
    assert facts[0] == ["noise of robot", "exact"]
    assert re.fullmatch(r"12 x 6 x 6, SHA-256 [0-9a-f]{64}", facts[1][1])
    other = several.camera.copy()
    other[3, 2, 2] *= 1.001
    assert sections._noise(replace(result, noise=uq.PoseNoise(None, other)))[1] != facts[1]
    diagonal = np.diag([1e-6, 2e-6, 1e-6, 1e-8, 1e-8, 1e-8])  # axes that differ are not two numbers
    assert "SHA-256" in sections._noise(replace(result, noise=uq.PoseNoise(diagonal)))[0][1]
    pairs = uq.PairNoise(B=1e-6 * np.eye(6))
    assert [fact[0] for fact in sections._noise(replace(result, noise=pairs))] == ["noise of A", "noise of B"]


def test_the_section_on_the_run_has_noise_and_time_offset(result, page, quick):
    assert "noise of camera" in page.words("repeat") and "time offset" not in page.words("repeat")
    offset = TimeOffset(-0.0168947, 0.00117944, "robot", (0.1,) * 6, 0.3)
    with_offset = Page(report_html(replace(result, time_offset=offset)))
    assert "by the noise alone: the time offset" in with_offset.words("observability")
    assert "by the noise alone" not in page.words("observability")
    found = with_offset.words("repeat")
    assert "time offset (s) -0.0168947" in found and "its standard deviation (s) 0.00117944" in found


def test_what_many_methods_say_is_said_once(result):
    rate = np.ones((12, 6))
    poses = replace(simulated(), timing=Timing(0.1, 1e-3, rate, "robot"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        compared = uq.compare(poses, noise=NOISE)
    said = [text for text in compared.own_warnings if "time offset" in text]
    assert len(said) == 1 and said[0].startswith("tsai, shiu, ") and "the method takes it as exact" in said[0]


def test_numbers_in_a_column_keep_their_zeros(page, result):
    weights = re.findall(r" (\d\.\d+) kept", page.words("residuals"))
    assert weights == [f"{w:.3f}" for w in result.table.weight]
