"""A progress bar on stderr, where that is a terminal: work done, speed, and remaining time."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


def _on_terminal() -> bool:
    return sys.stderr is not None and sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


@contextmanager
def working(label: str, show: bool = True) -> Iterator[Callable[[str], None]]:
    """Show that something takes its time and cannot be counted, where `progress_bar` would show a bar.

    Yields a function that takes what to say behind the label.
    """
    if not (show and _on_terminal()):
        yield lambda text: None
        return
    from rich.console import Console

    with Console(stderr=True).status(label, spinner="line") as status:
        yield lambda text: status.update(f"{label}: {text}")


@contextmanager
def progress_bar(label: str, total: int | None, unit: str, show: bool = True) -> Iterator[Callable[[int], None]]:
    """Yield a function that takes the number of further steps done; nothing is shown in a pipe, or unless ``show``.

    The bar goes away at the end. ``total`` None: not known beforehand.
    """
    if not (show and _on_terminal()):
        yield lambda more: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Done(ProgressColumn):
        def render(self, task: Task) -> Text:
            of = "" if task.total is None else f"/{int(task.total):,}"
            rate = "" if not task.speed else f", {task.speed:,.0f}/s"
            return Text(f"{int(task.completed):,}{of} {unit}{rate}", no_wrap=True)

    columns = (TextColumn("{task.description}"), BarColumn(16), Done(), TextColumn("left"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=total)
        yield lambda more: bar.advance(task, more)
