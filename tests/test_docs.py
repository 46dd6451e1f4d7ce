"""The guide through a real cell works word for word."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
GUIDE = DOCS / "real_cell.md"


def run_commands(block):
    """What a reader would type, line by line."""
    for line in block.splitlines():
        program = "from uq_handeye.cli import main; main()"
        done = subprocess.run([sys.executable, "-c", program, *line.split()[1:]], text=True, capture_output=True)
        assert done.returncode == 0, done.stderr


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_the_guide_runs(tmp_path, monkeypatch, capsys):
    blocks = re.findall(r"```(text|python)\n(.*?)```", GUIDE.read_text(), re.DOTALL)
    assert [kind for kind, _ in blocks] == ["text", "python", "python", "python"]
    monkeypatch.chdir(tmp_path)
    run_commands(blocks[0][1])
    assert sorted(file.name for file in (tmp_path / "result").iterdir()) == [
        "ellipses.png",
        "ellipses.svg",
        "poses.csv",
        "result.json",
    ]
    names: dict = {}
    for _, code in blocks[1:]:
        exec(code, names)
    printed = capsys.readouterr().out
    assert "gripper_T_camera by efficient from 30 poses" in printed
    assert "robot translation + camera translation" in printed
    assert "robot translation + camera translation" not in names["result"].budget.sources  # the prior splits them
    assert names["found"].frame == "gripper" and names["found"].std.shape == (2, 3)


def test_the_page_on_validation_runs(tmp_path, monkeypatch, capsys):
    page = (DOCS / "validation.md").read_text()
    commands = [block for block in re.findall(r"```text\n(.*?)```", page, re.DOTALL) if block.startswith("uq-handeye")]
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    for block in commands:
        run_commands(block)
    assert (tmp_path / "run" / "result.json").exists()
    assert (tmp_path / "chain" / "corner.png").exists()
    assert (tmp_path / "all" / "cross_check.svg").exists()
    exec(code, {})
    assert "The covariance is true as far as 2,000 trials can tell" in capsys.readouterr().out
