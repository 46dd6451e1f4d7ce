"""The page on formats: its examples are files that are read, as the format under whose heading they stand."""

import inspect
import re

import pytest
from fixtures.pages import DOCS

from uq_handeye.formats import export
from uq_handeye.formats.detect import read_contents
from uq_handeye.read import FORMATS, read_poses

PAGE = (DOCS / "formats.md").read_text(encoding="utf-8")
HEADINGS = {"MoveIt calibration": "moveit", "OpenCV FileStorage": "opencv", "Matrices in text": "matrix"}


def examples():
    for section in re.split(r"^### ", PAGE, flags=re.MULTILINE)[1:]:
        heading = section.partition("\n")[0]
        for language, text in re.findall(r"^```(text|yaml|json)\n(.*?)^```", section, re.DOTALL | re.MULTILINE):
            yield HEADINGS.get(heading, heading.lower()), language, text


@pytest.mark.parametrize(("format", "language", "text"), list(examples()))
def test_examples(tmp_path, format, language, text):
    path = tmp_path / f"example.{language}"
    path.write_text(text)
    contents, source = read_contents(path, None)
    assert source.format == format
    if contents.only is None:
        poses = read_poses(path, setup="eye-in-hand")
        assert poses.robot[0, :3, 3].tolist() == [0.4, -0.1, 0.5]
        assert poses.camera[0, :3, 3].tolist() == [0.0, 0.0, 0.6]


def test_every_format_and_argument_is_named():
    for name in FORMATS:
        assert f"| `{name}` |" in PAGE
    for name in export.FORMATS:
        assert f"| `{name}` |" in PAGE
    for name in inspect.signature(read_poses).parameters:
        assert name in ("robot", "camera") or f"{name}=" in PAGE, name
