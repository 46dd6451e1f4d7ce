"""Help: two screens of 80 columns with examples first; every option with --help-all; examples that can be typed."""

import re
import shlex

import pytest
import typer
from fixtures.commands import run
from fixtures.pages import ROOT

from uq_handeye.cli import app as cli
from uq_handeye.cli.help import EXAMPLES, describe, rows

PROGRAM = typer.main.get_command(cli.app)
COMMANDS = PROGRAM.commands


@pytest.fixture(autouse=True)
def eighty_columns(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")


def lines_of(*arguments):
    done = run(*arguments)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    return lines


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_help_is_two_screens(name):
    lines = lines_of(name, "--help")
    assert len(lines) <= 52
    assert lines[0].startswith(f"Usage: uq-handeye {name}")
    assert 2 < lines.index(EXAMPLES) < min(k for k, line in enumerate(lines) if line.endswith(":") and k > 4)
    assert f"  uq-handeye {name}" in lines[lines.index(EXAMPLES) + 1 :][0] + lines[lines.index(EXAMPLES) + 2]
    assert lines[-1] == f"All options: uq-handeye {name} --help-all"


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_help_all_lists_every_option(name):
    text = "\n".join(lines_of(name, "--help-all"))
    for value in COMMANDS[name].params:
        names = value.opts if value.param_type_name == "option" else [value.metavar]
        for shown in names:
            assert re.search(rf"(^|[\s,/]){re.escape(shown)}($|[\s,/.])", text, re.MULTILINE), shown


@pytest.mark.slow
def test_help_of_the_program_is_one_screen():
    lines = lines_of("--help")
    assert len(lines) <= 32
    assert lines == lines_of()
    assert all(any(line.startswith(f"  {name} ") for line in lines) for name in COMMANDS)
    assert all(len(describe(command).summary) <= 65 for command in COMMANDS.values())
    assert next(iter(COMMANDS)) == "calibrate"
    assert "--install-completion" in "\n".join(lines_of("--help-all"))


def test_help_is_as_wide_as_the_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    table = run("plan", "--help").stdout.partition("Arguments:")[2].splitlines()
    assert 50 < max(map(len, table)) <= 60


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_examples_can_be_typed(name):
    """Every option is there, and the shell would read it so."""
    text = describe(COMMANDS[name]).examples.replace("\\\n", " ")
    typed = [shlex.split(line, comments=True) for line in text.splitlines()]
    typed = [words for words in typed if words]
    assert any(words[:2] == ["uq-handeye", name] for words in typed)
    for _, command, *words in typed:
        COMMANDS[command].make_context(command, words, resilient_parsing=False)


def test_every_command_has_a_page():
    pages = ROOT / "docs" / "reference" / "commands"
    assert sorted(page.stem for page in pages.iterdir()) == sorted(COMMANDS)
    listed = re.findall(r"^commands/(.*)$", (pages.parent / "commands.md").read_text(), re.MULTILINE)
    assert listed == list(COMMANDS)
    for name in COMMANDS:
        text = (pages / f"{name}.md").read_text()
        heads = ["# " + name, "## When to use it", "## Files", "## Exit status", "## Options", "## See also"]
        assert re.findall("^#.*", text, re.MULTILINE) == heads
        assert f"```{{command}} {name}\n" in text and f"```{{options}} {name}\n" in text


@pytest.mark.parametrize("name", COMMANDS)
def test_texts_of_options(name):
    """Noun phrases in full sentences, by the style sheet; what is taken has a name."""
    for row in rows(COMMANDS[name]):
        assert row.text[:1].isupper() and row.text.endswith("."), row
        assert not re.search(r"[Ll]eft out|^Of |^Or |[Bb]eside|by itself", row.text), row
        assert row.text.count("Default:") <= 1, row
    for value in COMMANDS[name].params:
        assert value.metavar is not None, value.name
