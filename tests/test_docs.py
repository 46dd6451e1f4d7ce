"""The documentation can be followed word for word: its commands run, print what is shown, and links lead somewhere."""

import dataclasses
import inspect
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from fixtures.pages import DOCS, ROOT, SHOWN, blocks, missing, prepare, run_page
from fixtures.streams import motion, streams

import uq_handeye as uq
from uq_handeye.model.kinematics.kinematic_errors import POPULATIONS
from uq_handeye.read import write_pose_file

# Files that the commands of a page write, beside what they print.
WRITTEN = {
    "README.md": {"report.html", "handeye.yaml", "result/result.json", "result/poses.csv"},
    "docs/how-to/validation.md": {"run/result.json", "chain/corner.png", "all/cross_check.svg"},
    "docs/how-to/camera.md": {
        "result/result.json",
        "camera/camera.csv",
        "camera/camera_covariance.npz",
        "camera/intrinsics.json",
        "camera/intrinsics.yaml",
        "camera/corners.csv",
        "camera/board.csv",
        "camera/report.html",
    },
}


@pytest.mark.parametrize(
    "page",
    # The page for users of OpenCV calls `calibrateHandEye`, which OpenCV 5.0 does not have.
    [pytest.param(page, marks=pytest.mark.opencv4 if "opencv" in page else pytest.mark.docs) for page in SHOWN],
)
def test_a_page_prints_what_it_shows(page, tmp_path, monkeypatch, without_rendering):
    """If this fails, run `python docs/figures/refresh_outputs.py`."""
    monkeypatch.chdir(tmp_path)
    prepare(ROOT / page, tmp_path)
    for block in run_page(ROOT / page):
        assert block.kind != "shown" or missing(block) == [], block.printed
    written = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}
    assert WRITTEN.get(page, set()) <= written


def test_the_guide_from_pictures_names_the_files_that_it_writes(tmp_path):
    """Their names are those of the table; the page runs above."""
    page = (DOCS / "how-to" / "camera.md").read_text(encoding="utf-8")
    rows = "".join(re.findall(r"^\| .*", page, re.MULTILINE))
    named = set(re.findall(r"`(\w+\.(?:csv|npz|json|yaml|html))`", rows))
    named -= {"camchain.yaml", "transforms.json"}  # of other programs
    assert named == {Path(name).name for name in WRITTEN["docs/how-to/camera.md"] if name.startswith("camera/")}


def test_every_guide_is_run():
    # without_a_board: tests/scene/test_rendered.py
    # plan: tests/cli/test_plan.py; few_axes: tests/cli/test_known.py; exclude, watch: their files there
    elsewhere = {
        "index",
        "by_words",
        "exclude",
        "few_axes",
        "few_poses",
        "gallery",
        "good_and_bad",
        "gpu",
        "live",
        "plan",
        "real_cell",
        "recalibrate",
        "synchronise",
        "watch",
        "without_a_board",
    }
    guides = {page.stem for page in (DOCS / "how-to").glob("*.md")}
    assert guides == elsewhere | {Path(page).stem for page in SHOWN if "/how-to/" in page}


def test_a_wrong_output_would_be_found(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = tmp_path / "page.md"
    page.write_text("```python\nprint('one')\nprint('two')\n```\n\n```text\none\n...\nthree\n```\n")
    assert missing(run_page(page)[-1]) == ["three"]


@pytest.mark.docs
def test_the_guide_through_a_real_cell_runs(tmp_path, monkeypatch, without_rendering):
    monkeypatch.chdir(tmp_path)
    page = DOCS / "how-to" / "real_cell.md"
    assert [block.kind for block in blocks(page)] == ["command", "python", "python", "python"]
    found = run_page(page)
    assert {"result.json", "poses.csv", "ellipses.png", "ellipses.svg"} <= {
        f.name for f in (tmp_path / "result").iterdir()
    }
    printed = "".join(block.printed for block in found)
    assert "30 poses, eye-in-hand, efficient" in printed
    assert "sizes of the errors" in printed and "camera translation" in printed  # of the budget


@pytest.mark.docs
def test_the_page_on_streams_runs(tmp_path, monkeypatch, rng):
    monkeypatch.chdir(tmp_path)
    *_, robot, camera = streams(rng, motion(rng, 6.0), 0.02, 6.0)
    for name, stream in (("robot.csv", robot), ("camera.csv", camera)):
        write_pose_file(name, stream.poses, stream.timestamps)
    (code,) = run_page(DOCS / "how-to" / "synchronise.md")
    assert "offset" in code.printed and (tmp_path / "sync.png").exists()


def test_the_page_on_poses_of_a_gpu_runs():
    _, shown = run_page(DOCS / "how-to" / "gpu.md")
    assert missing(shown) == []


def pages():
    return [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")] + sorted(DOCS.rglob("*.md"))


def anchors(page):
    """Headings of a page as GitHub and MyST name them."""
    titles = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower().strip()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files_and_headings(page):
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if target.startswith(("http://", "https://")):
            continue
        path, _, anchor = target.partition("#")
        file = page if not path else (DOCS / path[1:] if path.startswith("/") else page.parent / path)
        assert file.exists(), f"{target} in {page.name}"
        assert not anchor or anchor in anchors(file), f"{target} in {page.name}"


def test_every_public_name_is_in_the_reference_once():
    text = "".join(page.read_text(encoding="utf-8") for page in (DOCS / "reference").rglob("*.md"))
    described = re.findall(r"^\.\. auto(?:function|class|exception):: (\w+)$", text, re.MULTILINE)
    constants = ["METHODS", "ROBOT_WORLD_METHODS"]
    assert sorted(described + constants) == sorted(uq.__all__)
    assert all(f"`{name}`" in text for name in constants)


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_every_field_of_a_result_is_on_its_page():
    page = (DOCS / "reference" / "result_file.md").read_text(encoding="utf-8")
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    fields = uq.calibrate(uq.simulate(n_poses=10, noise=noise, seed=1)).to_dict()
    names = set(re.findall(r"`([\w]+)`", page))
    assert {*fields, *fields["analysis"], *fields["provenance"]} <= names


@pytest.mark.slow
def test_every_field_of_a_result_is_in_the_reference(monkeypatch):
    """Fields that the docstring does not list come from the comments beside them, by an extension of the build."""
    monkeypatch.syspath_prepend(DOCS / "_ext")
    source = (
        (DOCS / "_ext" / "fields.py").read_text(encoding="utf-8").replace("from sphinx.application import Sphinx", "")
    )
    extension = {"__name__": "fields"}
    exec(compile(source, "fields.py", "exec"), extension)
    for name in uq.__all__:
        cls = getattr(uq, name)
        if not dataclasses.is_dataclass(cls):
            continue
        lines = inspect.getdoc(cls).splitlines()
        extension["describe"](None, "class", name, cls, None, lines)
        listed = {part.strip() for line in lines if " : " in line for part in line.split(" : ")[0].split(",")}
        listed |= {line.strip() for line in lines}
        public = {field.name for field in dataclasses.fields(cls) if not field.name.startswith("_")}
        assert public - listed - {"setup"} == set(), name
    ((_, _, comment),) = [field for field in extension["fields_of"](uq.Plan) if field[0] == "chosen"]
    assert comment == "(k,) rows of the candidates, from 0"


def test_every_word_of_the_glossary_is_explained_once():
    text = (DOCS / "reference" / "glossary.md").read_text(encoding="utf-8")
    words = re.findall(r"^(.+)\n: ", text, re.MULTILINE)
    assert len(words) > 30 and len(set(words)) == len(words)
    for word in ("NEES", "X", "W", "Cramer-Rao bound", "residual", "intrinsics", "4DPA"):
        assert word in words


def test_the_citation_names_this_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["cff-version"] == "1.2.0" and citation["version"] == uq.__version__
    assert {"message", "title", "authors"} <= set(citation)


def test_the_readme_has_the_two_blocks_of_the_gate():
    command = [sys.executable, ROOT / ".ci" / "readme_commands.py", ROOT / "README.md"]
    install, tests, end = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\0")
    assert end == "" and len(install.splitlines()) == len(tests.splitlines()) == 1
    assert install.endswith("uq-handeye demo") and tests.endswith("pytest")
    assert install in (DOCS / "install.md").read_text(encoding="utf-8")
    assert tests in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", ["README.md", "docs/install.md"])
def test_every_extra_is_in_the_table_of_installs(page):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    rows = (ROOT / page).read_text(encoding="utf-8").split("| install |")[1].split("\n\n")[0]
    extras = project["optional-dependencies"]
    # docs and test are parts of dev; bench is for the gate; posterior holds nothing
    assert set(re.findall(r"\.\[(\w+)\]", rows)) - {"docs"} == set(extras) - {
        "docs",
        "test",
        "bench",
        "posterior",
        "kinhec",
    }
    assert {name for entry in extras["all"] for name in re.findall(r"\w+", entry.split("[")[1].split("]")[0])} == {
        "camera",
        "scene",
        "pdf",
        "rosbag",
        "parquet",
        "sdp",
        "cluster",
        "live",
    }


def test_the_populations_of_arms_are_those_of_the_code():
    text = (DOCS / "explanation" / "kinematics.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)`[^|]*\|(.*)\|$", text, re.MULTILINE))
    assert list(rows) == list(POPULATIONS)
    for name, population in POPULATIONS.items():
        told = [float(cell.split()[0]) for cell in rows[name].split("|")]
        assert told == pytest.approx([*(1e3 * sd for sd in population[:-1]), population.factor]), name
