"""Directives of the commands, made from the texts that the help prints.

``commands`` is the table of all commands; ``command NAME`` has summary, examples and explanation of one, ``options
NAME`` its options in a table per group.
"""

from __future__ import annotations

import re
from typing import Any

import typer
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx import addnodes
from sphinx.application import Sphinx

from uq_handeye.cli.app import app as program
from uq_handeye.cli.help import describe, rows


def commands() -> dict[str, Any]:
    """Return the commands by name, in the order of the help."""
    found: dict[str, Any] = typer.main.get_command(program).commands  # type: ignore[attr-defined]
    return found


def paragraph(text: str) -> nodes.paragraph:
    """Return a paragraph with the names of options as code."""
    parts = re.split(r"(?<![\w-])(--?[a-z][a-z-]*)", text)
    return nodes.paragraph("", "", *(nodes.literal("", p) if k % 2 else nodes.Text(p) for k, p in enumerate(parts)))


def table(cells: list[tuple[nodes.Node, str]]) -> nodes.table:
    """Return a table of names and texts."""
    body = nodes.tbody()
    for name, text in cells:
        left = nodes.entry("", nodes.paragraph("", "", name))
        body += nodes.row("", left, nodes.entry("", paragraph(text)))
    group = nodes.tgroup("", nodes.colspec(colwidth=30), nodes.colspec(colwidth=70), body, cols=2)
    return nodes.table("", group, classes=["options"])


class Commands(Directive):
    """Directive ``commands``: every command with its summary and a link, in groups."""

    def run(self) -> list[nodes.Node]:
        groups: dict[str, list[tuple[nodes.Node, str]]] = {}
        for name, command in commands().items():
            link = addnodes.pending_xref(
                "", nodes.literal(name, name), refdomain="std", reftype="doc", refexplicit=True,
                reftarget=f"/reference/commands/{name}", refwarn=True,
            )  # fmt: skip
            groups.setdefault(str(command.rich_help_panel), []).append((link, describe(command).summary))
        return [node for name, cells in groups.items() for node in (nodes.rubric(name, name), table(cells))]


class Command(Directive):
    """Directive ``command NAME``: summary, examples and explanation."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        about = describe(commands()[self.arguments[0]])
        code = nodes.literal_block(about.examples, about.examples, language="sh", classes=["command"])
        return [paragraph(about.summary), code, *map(paragraph, about.paragraphs)]


class Options(Directive):
    """Directive ``options NAME``: every argument and option, in groups."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        groups: dict[str, list[tuple[nodes.Node, str]]] = {}
        for row in rows(commands()[self.arguments[0]]):
            groups.setdefault(row.group, []).append((nodes.literal("", row.names), row.text))
        return [node for name, cells in groups.items() for node in (nodes.rubric(name, name), table(cells))]


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("commands", Commands)
    app.add_directive("command", Command)
    app.add_directive("options", Options)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
