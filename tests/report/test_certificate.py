"""The certificate: its numbers are those of the result, its budget adds up, and nothing looks certified that is not."""

import json
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from fixtures.few_axes import NOISE as OPEN_NOISE
from fixtures.few_axes import rig as open_rig
from fixtures.reports import Page
from support import SEED, missing

import uq_handeye as uq
from uq_handeye.core.files.about import ABOUT
from uq_handeye.core.geometry.pose_numbers import pose_numbers
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.core.limits import MAX_LISTED
from uq_handeye.core.presentation import page as pdf
from uq_handeye.core.presentation.numbers import digits
from uq_handeye.errors import InputError
from uq_handeye.findings import Finding
from uq_handeye.report.budget import budget_rows, components_of, correlation_of, worst_of
from uq_handeye.report.statements import RP_PER_SD, robot_words

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
ISSUED = "some day"


def simulated(n=12, **options):
    return uq.simulate(n_poses=n, noise=NOISE, seed=SEED, **options)


CASES = {
    "given": lambda: uq.calibrate(simulated(), noise=NOISE),
    "estimated": lambda: uq.calibrate(simulated()),
    "eye-to-hand": lambda: uq.calibrate(simulated(setup="eye-to-hand"), noise=NOISE),
    "declared": lambda: uq.calibrate(simulated(), noise=NOISE, shared=[uq.SharedError.focal_length(0.001)]),
    "published": lambda: uq.calibrate(simulated(), noise=NOISE, method="4dpa"),
    "sandwich": lambda: uq.calibrate(simulated(), noise=NOISE, covariance="sandwich"),
    "open": lambda: uq.calibrate(open_rig("scara", 12, np.random.default_rng(SEED)), noise=OPEN_NOISE),
}


@pytest.fixture(scope="module")
def results():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return {name: make() for name, make in CASES.items()}


def made(result, **options):
    return uq.make_certificate(result, issued=ISSUED, **options)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
@pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")
def test_every_number_is_that_of_the_result_and_the_budget_adds_up(case, results):
    result = results[case]
    data = json.loads(made(result).to_json())
    accuracy = result.accuracy
    assert data["certified"] and data["format"] == "uq-handeye certificate 1"
    stated = data["result"]["worst_direction"]
    for name in ("translation", "rotation"):
        of = stated[name]["measurementUncertaintyUnivariate"]
        assert of["standardMU"]["valueStandardMU"] == getattr(accuracy, name)
        assert of["expandedMU"]["valueExpandedMU"] == getattr(accuracy, f"{name}_95")
        k = getattr(accuracy, f"{name}_95") / getattr(accuracy, name)
        assert of["expandedMU"]["coverageFactor"] == pytest.approx(k, rel=1e-12)
        parts = [source[name] for source in data["budget"]["sources"]]
        root = np.sqrt(np.sum(np.square([part["value"] for part in parts])))
        assert root == pytest.approx(data["budget"]["combined"][name]["value"], rel=1e-12)
        assert root == pytest.approx(getattr(accuracy, name), rel=1e-7)
        assert sum(part["share"] for part in parts) == pytest.approx(1.0, rel=1e-12)
        assert [part["share"] for part in parts] == pytest.approx([(part["value"] / root) ** 2 for part in parts])
    values, deviations = pose_numbers(result.X, result.covariance, opened=result.open_of_X)
    factors = np.repeat([1e3, 180 / np.pi], 3)
    for k, one in enumerate(data["result"]["components"]):
        assert factors[k] * one["value"] == pytest.approx(values[k], rel=1e-12)
        of = one["measurementUncertaintyUnivariate"]
        if np.isinf(deviations[k]):
            assert of is None
            continue
        assert factors[k] * of["standardMU"]["valueStandardMU"] == pytest.approx(deviations[k], rel=1e-12)
        expanded = of["expandedMU"]
        assert expanded["valueExpandedMU"] == pytest.approx(
            expanded["coverageFactor"] * of["standardMU"]["valueStandardMU"], rel=1e-12
        )
        assert (expanded["coverageFactor"] > 1.961) == (of["effectiveDegreesOfFreedom"] is not None)
    assert data["result"]["covariance"]["matrix"] == result.covariance.tolist()
    if case in ("given", "estimated", "declared"):
        if case != "estimated":  # whose sources are shown merged where only their sum is known
            assert [source["name"] for source in data["budget"]["sources"]] == list(result.budget.sources)
        found = result.budget.expanded(worst=True)["X translation"]
        assert worst_of(result)[0].dof == found.dof


@pytest.mark.slow
def test_correlations_are_those_of_drawn_errors(results):
    """The six numbers of poses that are drawn from the covariance."""
    result, rng = results["given"], np.random.default_rng(SEED)
    xi = rng.multivariate_normal(np.zeros(6), 1e-2 * result.covariance, size=2000)
    drawn = np.array([pose_numbers(X, None)[0] for X in perturb(result.X, xi)])
    expected = np.corrcoef(drawn.T)
    assert correlation_of(result) == pytest.approx(expected, abs=5 / np.sqrt(2000))


def test_inputs_are_those_that_were_declared_or_found(results):
    """The noise of a pose by itself, without the errors that all poses share."""
    inputs = {row.name: row.input.uncertainty for row in budget_rows(results["declared"])}
    assert inputs["camera translation"] == "0.5 mm" and inputs["robot rotation"] == "0.02 deg"
    assert inputs["focal length"] == "0.1 %"
    estimate = results["estimated"].noise_estimate
    found = {row.name: row.input for row in budget_rows(results["estimated"])}
    name = "camera translation" if "camera translation" in found else "camera (rotation and translation)"
    assert digits(1e3 * estimate["camera translation"].size, 2) in found[name].uncertainty
    assert found["focal length"].origin == "assumed"


def test_components_have_the_degrees_of_freedom_of_welch_and_satterthwaite(results):
    """The formula of JCGM 100, G.2b, written out for one component and independent estimates."""
    result = results["estimated"]
    one, v = components_of(result)[2], result.budget.covariances[:, 5, 5]
    assert one.u**2 == pytest.approx(v.sum(), rel=1e-9)
    assert np.isinf(one.dof)  # sizes are integrated over: what is open of them is in the covariance
    R = np.diag(np.linspace(0.1, 0.5, len(v)))
    (found,) = replace(result.budget, relative=R).expanded_along(np.eye(12)[5:6])
    assert found.dof == pytest.approx(2 * v.sum() ** 2 / (v @ R @ v), rel=1e-9) and np.isfinite(found.dof)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
@pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")
def test_the_page_has_everything(case, results):
    result = results[case]
    page = Page(made(result).to_html())
    assert page.broken == [] and page.stack == []
    anchors = [attributes["id"] for attributes in page.all("section")]
    assert anchors[0] == "answer"
    assert {"x", "worst", "conditions", "checks", "budget", "scope", "traceability", "robot", "validity"} <= {*anchors}
    everything = " ".join(page.texts.values())
    assert not re.search(r"\b(nan|inf|None)\b", everything)
    assert result.headline in " ".join(page.texts["answer"].split()).replace("\N{MINUS SIGN}", "-")
    assert result.provenance.data_sha256 in everything
    assert "Signature" in everything and "until uq-handeye check says changed" in everything
    assert "No characteristic of ISO 9283 was measured" in everything
    assert "ISO/IEC 17025" in everything and ISSUED in everything
    if case == "open":
        assert "Not determined" in page.words("worst") and "not determined" in page.words("x")


def test_what_is_not_usable_is_never_certified(results, tmp_path):
    failure = (Finding("stored.text", "failure", {"text": "Wrong files."}),)
    not_known = uq.calibrate(uq.simulate(n_poses=6, seed=SEED))
    for result in (replace(results["given"], findings=failure), not_known):
        found = made(result, tolerance="1mm")
        assert not found.certified and not found.decision.verdict.passed
        data, page = found.to_dict(), Page(found.to_html())
        assert not data["certified"] and data["result"] is None and data["budget"] is None and data["refusals"]
        assert page.words("answer").startswith("NOT CERTIFIED NOT CERTIFIED.")
        everything = " ".join(page.texts.values())
        assert "Signature" not in everything and "PASS" not in everything
        assert not {"x", "worst", "budget", "validity"} & {of["id"] for of in page.all("section")}
        number = f"{1e3 * result.X[0, 3]:.1f}".replace("-", "\N{MINUS SIGN}")
        assert number not in everything


@pytest.mark.slow
def test_a_lower_limit_is_marked(results):
    marked = uq.calibrate(simulated(), shared=[])  # residuals cannot show what all poses share
    assert marked.accuracy.lower_limit
    data, page = made(marked).to_dict(), Page(made(marked).to_html())
    assert data["result"]["lower_limit"] and "LOWER LIMIT" in page.words("answer")
    assert "Result (lower limit)" in page.words("x") and "95 % of the errors are within (lower limit)" in page.words(
        "budget"
    )
    assert "LOWER LIMIT" not in Page(made(results["given"]).to_html()).words("answer")


def test_the_decision_has_a_guard_band(results):
    result = results["given"]
    decision = made(result, tolerance="5mm,1deg").decision
    assert decision.verdict.passed and 0 < decision.margin < 1 and " % of the tolerance" in decision.sentence
    at = (decision.guard_band.translation, decision.guard_band.rotation)
    assert result.verdict(at).probability == pytest.approx(0.95, abs=2e-4)
    assert result.verdict(tuple(0.98 * x for x in at)).probability < 0.95
    small = made(result, tolerance="0.1mm", at="0.5m")
    assert small.decision.margin < 0 and small.decision.guard_band.at == 0.5
    assert "times the tolerance" in small.decision.sentence
    assert small.to_dict()["decision"]["verdict"] != "PASS"


def test_words_of_iso_9283_depend_on_what_is_known(results):
    rng = np.random.default_rng(SEED)
    away = np.linalg.norm(rng.normal(size=(200_000, 3)), axis=1)
    assert away.mean() + 3 * away.std() == pytest.approx(RP_PER_SD, rel=5e-3)
    given, estimated = (" ".join(robot_words(results[case])) for case in ("given", "estimated"))
    assert "0.05 mm" in given and "RP_l" in given and "no robot accuracy is declared" in given
    assert "not identifiable" in estimated or "do not separate" in estimated
    poses = simulated(20)
    declared = uq.calibrate(poses, noise=NOISE, shared=[uq.SharedError.robot_accuracy("0.5mm", "0.05deg")])
    assert "0.5 mm, 0.05 deg (declared)" in " ".join(robot_words(declared))


def test_the_identifier_is_that_of_the_contents(results):
    one, same = made(results["given"]), uq.make_certificate(results["given"], issued="another day")
    assert one.identifier == same.identifier != made(results["given"], about={"cell": "B7"}).identifier
    assert one.to_dict()["identifier"] == one.identifier


@pytest.mark.slow
def test_a_stored_result_gives_the_same(results, tmp_path):
    for case in ("estimated", "published"):
        path = tmp_path / "result.json"
        results[case].to_json(path)
        assert made(uq.Calibration.from_json(path)).identifier == made(results[case]).identifier


@pytest.mark.browser
def test_two_pages_with_everything_given(results):
    """A full title block, a budget of many sources, a verdict; on letter, which is shorter than A4."""
    weasyprint = pdf.find_weasyprint()
    if weasyprint is None:
        missing("browser", "needs WeasyPrint (extra pdf) and Pango (Debian: libpango-1.0-0, libpangoft2-1.0-0)")
    result = results["estimated"]
    b = result.budget
    assert len(budget_rows(result, 3)) == 3
    about = dict.fromkeys(ABOUT, "A text of the length that a text may have, 80 signs or so")
    html = made(result, tolerance="1mm,0.1deg", about=about).to_html()
    html = html.replace("</style>", "@page { size: letter; }\n</style>", 1)
    assert len(b.sources) <= MAX_LISTED
    assert len(weasyprint.HTML(string=html).render().pages) == 2


def test_files_by_suffix(results, tmp_path):
    found = made(results["given"])
    path = results["given"].report(tmp_path / "preset.json", certificate=True)
    assert json.loads(path.read_text())["identifier"] == found.identifier
    assert json.loads(found.write(tmp_path / "c.json").read_text()) == json.loads(found.to_json())
    assert found.write(tmp_path / "c.html").read_text() == found.to_html()
    with pytest.raises(InputError, match=r"Expected `path` to end in \.html, \.pdf, \.json"):
        found.write(tmp_path / "c.txt")
    with pytest.raises(InputError, match="paper"):
        found.write(tmp_path / "c.pdf", paper="a3")
    with pytest.raises(InputError, match="Calibration, got dict"):
        uq.make_certificate({})
    with pytest.raises(InputError, match="beside `at`"):
        uq.make_certificate(results["given"], at="0.5m")
    with pytest.raises(InputError, match="Unknown name"):
        uq.make_certificate(results["given"], about={"colour": "red"})
