"""Directives ``commands`` and ``command NAME``: pages of the commands, made from the texts that the help prints."""

from __future__ import annotations

from typing import Any

import typer
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from uq_handeye.cli.app import app as program
from uq_handeye.cli.help import Row, describe, rows


def table(found: list[Row]) -> nodes.table:
    """Return a table of options: names and text."""
    group = nodes.tgroup(cols=2)
    group += [nodes.colspec(colwidth=30), nodes.colspec(colwidth=70)]
    body = nodes.tbody()
    for row in found:
        text = nodes.paragraph(row.text, row.text)
        name = nodes.paragraph("", "", nodes.literal("", row.names))
        body += nodes.row("", nodes.entry("", name), nodes.entry("", text))
    group += body
    return nodes.table("", group, classes=["options"])


def described(command: Any) -> list[nodes.Node]:
    """Return summary, examples, paragraphs and options of a command."""
    about = describe(command)
    found: list[nodes.Node] = [nodes.paragraph(about.summary, about.summary)]
    found.append(nodes.literal_block(about.examples, about.examples, language="sh", classes=["command"]))
    found += [nodes.paragraph(text, text) for text in about.paragraphs]
    groups: dict[str, list[Row]] = {}
    for row in rows(command):
        groups.setdefault(row.group, []).append(row)
    for group, members in groups.items():
        found += [nodes.rubric(group, group), table(members)]
    return found


class Commands(Directive):
    """Directive ``commands``: all commands in the order of the help."""

    def run(self) -> list[nodes.Node]:
        sections: list[nodes.Node] = []
        for name, command in typer.main.get_command(program).commands.items():  # type: ignore[attr-defined]
            section = nodes.section(ids=[nodes.make_id(f"command-{name}")])
            section += nodes.title("", f"uq-handeye {name}")
            section += described(command)
            self.state.document.note_explicit_target(section)
            sections.append(section)
        return sections


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
