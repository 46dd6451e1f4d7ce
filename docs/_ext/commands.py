"""The directive ``commands``: one section per command of `uq-handeye`, made from what its ``--help`` prints."""

from __future__ import annotations

import inspect
from typing import Any

import typer
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from uq_handeye.cli.app import app as program


def paragraphs(text: str) -> list[nodes.Node]:
    """The help text; the line that starts with "Example:" stands as code."""
    found: list[nodes.Node] = []
    for part in inspect.cleandoc(text).split("\n\n"):
        words = " ".join(part.split())
        if words.startswith("Example:"):
            code = words.removeprefix("Example:").strip()
            found.append(nodes.literal_block(code, code, language="text"))
        else:
            found.append(nodes.paragraph(words, words))
    return found


def parameter(value: Any) -> nodes.definition_list_item:
    """An argument or option: names, what it takes, what it means."""
    names = ", ".join([*value.opts, *value.secondary_opts]) if value.param_type_name == "option" else ""
    # Typer keeps the type of a value in other places from version to version; its name says enough
    takes = "" if getattr(value, "is_flag", False) else value.metavar or value.name.upper()
    term = nodes.term("", "", nodes.literal("", f"{names} {takes}".strip()))
    words = " ".join((getattr(value, "help", None) or "").split())
    default = value.default
    if isinstance(default, (str, int, float)) and not isinstance(default, bool):
        words += f" Default: {default}."
    return nodes.definition_list_item("", term, nodes.definition("", nodes.paragraph(words, words)))


class Commands(Directive):
    """``commands``: all commands in the order of the help."""

    def run(self) -> list[nodes.Node]:
        sections: list[nodes.Node] = []
        for name, command in typer.main.get_command(program).commands.items():  # type: ignore[attr-defined]
            section = nodes.section(ids=[nodes.make_id(f"command-{name}")])
            section += nodes.title("", f"uq-handeye {name}")
            section += paragraphs(command.help or "")
            panels: dict[str | None, list[Any]] = {}
            for value in command.params:
                if value.name != "help" and not getattr(value, "hidden", False):
                    panels.setdefault(getattr(value, "rich_help_panel", None), []).append(value)
            for panel, values in panels.items():
                if panel:
                    section += nodes.paragraph("", "", nodes.strong(panel, panel))
                section += nodes.definition_list("", *map(parameter, values))
            self.state.document.note_explicit_target(section)
            sections.append(section)
        return sections


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
