"""The picture of docs/explanation/architecture.md: the packages by floor, with their imports.

    python docs/figures/architecture.py [FOLDER]

Writes architecture.svg to FOLDER, docs/images if left out. It is made from every import statement of the package, at
the top of a module, in a function or for a type checker alone. An arrow says that the upper package imports the lower
one; those that follow from others (a imports b, b imports c, a imports c too) are left out, and so is the one import
upward, of the report by `Calibration.report`. A package stands one floor above the highest that it imports.
"""

from __future__ import annotations

import ast
import sys
from functools import cache
from importlib.util import resolve_name
from itertools import combinations, pairwise
from pathlib import Path

Place = tuple[str, int]  # a package, or an arrow that passes, on a floor

ROOT = Path(__file__).resolve().parents[2]
# The lazy doors upward: a result writes its own page and draws its own figures.
DOORS = {
    ("uq_handeye.calibration.result", "uq_handeye.report.page"),
    ("uq_handeye.calibration.result", "uq_handeye.report.figures"),
    ("uq_handeye.calibration.rig_result", "uq_handeye.report.page"),
}
# Modules at the top of the package that stand together; the others there only hand names on.
TOP = ("errors", "findings")
INK, LINE, FILL = "#222222", "#5F5F5F", "#E8F1F8"
WIDTH, HEIGHT, GAP, FLOOR, MARGIN = 140, 26, 24, 56, 12
PULL = 0.9  # of the neighbours against the middle of the picture


@cache
def sources() -> dict[str, Path]:
    """Every module by name, with its file; ``symbolic/`` installs inside the package."""
    found = {}
    for folder, prefix in ((ROOT / "uq_handeye", "uq_handeye"), (ROOT / "symbolic", "uq_handeye.symbolic")):
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            found[".".join((prefix, *parts)).removesuffix(".__init__")] = path
    return found


@cache
def imports(module: str) -> list[tuple[int, str]]:
    """Lines and modules of the package that a module imports anywhere, the door left out."""
    path, found = sources()[module], set()
    folder = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {(node.lineno, alias.name) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = resolve_name("." * node.level + (node.module or ""), folder) if node.level else str(node.module)
            names = [f"{start}.{alias.name}" for alias in node.names]
            found |= {(node.lineno, name if name in sources() else start) for name in names}
    own = sorted((line, name) for line, name in found if name.partition(".")[0] == "uq_handeye")
    return [(line, name) for line, name in own if (module, name) not in DOORS]


def graph() -> dict[str, set[str]]:
    """The packages, each with those that it imports; folders inside a package belong to it."""
    found: dict[str, set[str]] = {}
    for module in sources():
        name = _package(module)
        if name:
            lower = {_package(other) for _, other in imports(module)} - {"", name}
            found.setdefault(name, set()).update(lower)
    return found


def _package(module: str) -> str:
    name = module.removeprefix("uq_handeye").lstrip(".").partition(".")[0]
    if name in TOP:
        return ", ".join(TOP)
    is_folder = f"uq_handeye.{name}" in sources() and sources()[f"uq_handeye.{name}"].name == "__init__.py"
    return name if name and is_folder else ""


def reduced(arrows: dict[str, set[str]]) -> dict[str, set[str]]:
    """The same without arrows that follow from others."""

    @cache
    def below(name: str) -> frozenset[str]:
        return frozenset(arrows[name]).union(*(below(lower) for lower in arrows[name]))

    return {name: {low for low in lower if not any(low in below(k) for k in lower)} for name, lower in arrows.items()}


def floors(arrows: dict[str, set[str]]) -> dict[str, int]:
    """The floor of every package: one above the highest that it imports.

    One that imports nothing stands right below the lowest that imports it.
    """

    @cache
    def height(name: str) -> int:
        return 1 + max(map(height, arrows[name]), default=-1)

    found = {name: height(name) for name in arrows}
    for name in sorted(arrows):
        users = [found[user] for user in arrows if name in arrows[user]]
        if not arrows[name] and users:
            found[name] = min(users) - 1
    return found


def chains(arrows: dict[str, set[str]], floor: dict[str, int]) -> list[list[Place]]:
    """The places that each arrow passes, from its package down, one per floor."""
    return [
        [
            (user, floor[user]),
            *((f"{user} {lower}", k) for k in range(floor[user] - 1, floor[lower], -1)),
            (lower, floor[lower]),
        ]
        for user in sorted(arrows)
        for lower in sorted(arrows[user])
    ]


def placed(arrows: dict[str, set[str]]) -> tuple[dict[Place, float], list[list[Place]]]:
    """Return the middle of each place, in px from the left, so that arrows cross seldom; and the chains of places.

    Floors are put in the order of the mean of their neighbours above and below, in turn; the order with the fewest
    crossings is kept.
    """
    floor = floors(arrows)
    lines = chains(arrows, floor)
    steps = [pair for line in lines for pair in pairwise(line)]
    rows: list[list[Place]] = [[] for _ in range(1 + max(floor.values()))]
    for place in sorted({*((name, k) for name, k in floor.items()), *(place for step in steps for place in step)}):
        rows[place[1]].append(place)
    best = (_crossings(rows, steps), [list(row) for row in rows])
    for sweep in range(24):
        order = rows if sweep % 2 else rows[::-1]
        for row in order:
            at = {place: k / len(level) for level in rows for k, place in enumerate(level, start=1)}

            def mean(place: Place, at: dict[Place, float] = at) -> float:
                near = [at[b if a == place else a] for a, b in steps if place in (a, b)]
                return sum(near) / len(near) if near else at[place]

            row.sort(key=mean)
        count = _crossings(rows, steps)
        if count < best[0]:
            best = count, [list(row) for row in rows]
    return _straightened(best[1], steps, arrows), lines


def _straightened(
    rows: list[list[Place]], steps: list[tuple[Place, Place]], arrows: dict[str, set[str]]
) -> dict[Place, float]:
    """Each place below and above its neighbours, as far as the places of its floor leave room, in this order."""
    near: dict[Place, list[Place]] = {place: [] for row in rows for place in row}
    for a, b in steps:
        near[a].append(b)
        near[b].append(a)
    half = {place: (WIDTH if place[0] in arrows else GAP) / 2 for place in near}
    x = {place: (k - (len(row) - 1) / 2) * (WIDTH + GAP) for row in rows for k, place in enumerate(row)}
    for sweep in range(200):
        for row in rows if sweep % 2 else rows[::-1]:
            wished = [PULL * sum(x[other] for other in near[place]) / max(len(near[place]), 1) for place in row]
            right, left = list(wished), list(wished)
            for k in range(1, len(row)):
                right[k] = max(right[k], right[k - 1] + half[row[k - 1]] + half[row[k]] + GAP)
            for k in range(len(row) - 2, -1, -1):
                left[k] = min(left[k], left[k + 1] - half[row[k + 1]] - half[row[k]] - GAP)
            for place, a, b in zip(row, left, right, strict=True):
                x[place] = (a + b) / 2
    edge = min(x[place] - half[place] for place in x) - MARGIN
    return {place: at - edge for place, at in x.items()}


def _crossings(rows: list[list[Place]], steps: list[tuple[Place, Place]]) -> int:
    at = {place: k for row in rows for k, place in enumerate(row)}
    return sum(
        (at[a] - at[c]) * (at[b] - at[d]) < 0
        for (a, b), (c, d) in combinations(steps, 2)
        if a[1] == c[1] and b[1] == d[1]
    )


def picture(arrows: dict[str, set[str]]) -> str:
    """The packages of a graph and the arrows that follow from no others, as SVG."""
    arrows = reduced(arrows)
    x, lines = placed(arrows)
    top = max(k for _, k in x)
    width, height = (
        max(at + (WIDTH if place[0] in arrows else 0) / 2 for place, at in x.items()) + MARGIN,
        FLOOR * top + HEIGHT + 2 * MARGIN,
    )

    def y(k: int) -> float:
        return MARGIN + HEIGHT / 2 + FLOOR * (top - k)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif" font-size="12">',
        "<title>The packages of uq_handeye by floor; an arrow says that the upper one imports the lower one</title>",
        f'<rect width="100%" height="100%" fill="white"/><defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" '
        f'markerWidth="7" markerHeight="7" orient="auto"><path d="M0 0L8 4L0 8z" fill="{LINE}"/></marker></defs>',
    ]
    for line in lines:
        path = f"M{x[line[0]]:.0f} {y(line[0][1]) + HEIGHT / 2:.0f}"
        for a, b in pairwise(line):
            start, end = y(a[1]) + HEIGHT / 2 * (a == line[0]), y(b[1]) - HEIGHT / 2 * (b == line[-1])
            middle = (start + end) / 2
            path += f"C{x[a]:.0f} {middle:.0f} {x[b]:.0f} {middle:.0f} {x[b]:.0f} {end:.0f}"
        parts.append(f'<path d="{path}" fill="none" stroke="{LINE}" stroke-width="1.2" marker-end="url(#head)"/>')
    for name, k in ((name, k) for name, k in x if name in arrows):
        left, at = x[name, k] - WIDTH / 2, y(k)
        parts.append(
            f'<rect x="{left:.0f}" y="{at - HEIGHT / 2:.0f}" width="{WIDTH}" height="{HEIGHT}" rx="4" fill="{FILL}" '
            f'stroke="{LINE}"/><text x="{x[name, k]:.0f}" y="{at + 4:.0f}" text-anchor="middle" '
            f'fill="{INK}">{name}</text>'
        )
    return "\n".join([*parts, "</svg>"]) + "\n"


def main(folder: Path) -> None:
    """Write the picture."""
    (folder / "architecture.svg").write_text(picture(graph()), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images")
