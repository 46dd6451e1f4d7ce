"""Write the tables of the documentation that repeat what the code holds.

    python docs/figures/tables.py [--check]

A table lies between the comments ``<!-- table: NAME -->`` and ``<!-- end of table -->`` of its page and is made anew by
the function of that name. With --check nothing is written, and the exit status is 1 if a page differs;
`tests/test_tables.py` does the same. Needs the package only.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import uq_handeye as uq
from uq_handeye.cli.exit_status import ExitStatus
from uq_handeye.core.geometry.conventions import CONVENTIONS
from uq_handeye.core.levels import LEVELS
from uq_handeye.core.presentation.units import small_unit
from uq_handeye.fit.diagnostics.sentences import DECLARE
from uq_handeye.model.errors.key import ErrorKey
from uq_handeye.model.errors.keys import DRIFTS
from uq_handeye.model.errors.sizes import CLASSES, SIZES, Size
from uq_handeye.model.shared_errors.assumed import assumed_drift, replace_defaults
from uq_handeye.model.shared_errors.shared_error import OF_LENGTHS, SharedError

DOCS = Path(__file__).resolve().parents[1]
# 95 % point of chi-square with six degrees of freedom.
INSIDE_95 = 12.592
MARKED = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.DOTALL)


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def quantity(name: ErrorKey | str, size: Size) -> str:
    """Return the median of the size of an error in the unit that people read; without one where it is of columns."""
    factor, unit = small_unit(size.unit) if size.unit or name in OF_LENGTHS else (1.0, "")
    return f"{factor * size.median:g} {unit}".strip()


def known(size: Size) -> str:
    """Return how well a size is known before the data."""
    return "known" if size.is_known else f"factor {size.factor:g}"


def default_errors() -> dict[ErrorKey, tuple[SharedError | None, SharedError | None]]:
    """Return the errors assumed by default: of finished camera poses, and of poses from corners or points."""
    poses = replace(uq.simulate(10, seed=1), truth=None, timestamps=range(10))
    drift = assumed_drift(poses)
    both = [{error.key: error for error in (*replace_defaults((), known), *drift)} for known in (False, True)]
    return {key: (both[0].get(key), both[1].get(key)) for key in SIZES if key in both[0] or key in both[1]}


def sizes() -> str:
    """Return the table of the sizes that are assumed where nothing is declared."""
    rows = ([str(key), quantity(key, size), known(size), size.source] for key, size in SIZES.items())
    return table(["error", "median", "before the data", "source"], rows)


def classes() -> str:
    """Return the table of the accuracy of classes of arms."""
    rows = ([f"`{name}`", quantity(name, size), known(size), size.source] for name, size in CLASSES.items())
    return table(["class", "median", "before the data", "arms"], rows)


def defaults() -> str:
    """Return the table of the errors that are assumed by default, by the kind of camera poses."""
    rows = []
    for key, (finished, from_corners) in default_errors().items():
        option = f"`{DECLARE[key][0]}`" if key in DECLARE else f'`--size "{key}=..."`'
        when = ", with timestamps" if key in DRIFTS.values() else ""
        rows.append([str(key), *("yes" + when if error else "no" for error in (finished, from_corners)), option])
    return table(["error", "finished camera poses", "poses from corners or points", "declared by"], rows)


def covered() -> str:
    """Return the table of the systematic errors in the covariance, with the size that is assumed of each."""
    rows = []
    for key, (_, from_corners) in default_errors().items():
        how = "yes" if from_corners else "yes; for poses from corners as their calibration determined it"
        how += ", with timestamps" if key in DRIFTS.values() else ""
        size = SIZES[key]
        rows.append([str(key), how, f"{quantity(key, size)}, {known(size)}"])
    return table(["error", "covered by default", "assumed size"], rows)


def levels() -> str:
    """Return the table of the statistical levels."""
    rows = ([name, f"{level.probability:g}", level.triggers, level.source] for name, level in LEVELS.items())
    return table(["level", "probability", "what it triggers", "source"], rows)


def conventions() -> str:
    """Return the table of the conventions of covariances."""
    header = ["name", "order", "rotation in the axes of the", "translation", "angle", "factor", "measured with"]
    rows = (
        [f"`{one.name}`", one.order, one.axes, one.translation, one.angle, one.factor, one.source]
        for one in CONVENTIONS.values()
    )
    return table(header, rows)


def exit_statuses() -> str:
    """Return the table of the exit statuses."""
    return table(["status", "meaning"], ([str(int(status)), status.meaning] for status in ExitStatus))


def simulators() -> str:
    """Return what `studies/simulators/measure.py` found in pictures of MuJoCo."""
    stored = json.loads((DOCS.parent / "studies" / "simulators" / "measured.json").read_text(encoding="utf-8"))
    rows = []
    for one in stored["table"]:
        said = f"NOT USABLE: {one['named'].partition(';')[0]}" if not one["usable"] else "usable"
        offset = "principalpixel" if any(one["offset"]) else "none"
        numbers = f"{one['corner_rms']:.3f}", f"{one['mm']:.3f}", f"{one['deg']:.4f}"
        rows.append([str(one["texels"]), offset, one["camera"], *numbers, said])
    head = ["texels a square", "offset of the centre", "intrinsics", "corners (px)", "X (mm)", "X (deg)", "said"]
    return table(head, rows)


# Rows of `studies/scene/measure.py` in words.
SCENES = {
    "table": "table with boxes", "flat": "flat table", "wide": "wide lens, f 620", "narrow": "narrow lens, f 2600",
    "noisy": "noise of 10 grey levels", "eight": "8 pictures", "twelve": "12 pictures", "sixty": "60 pictures",
    "weak": "weak texture", "tiles": "repeated tiles", "blur": "30 % of pictures blurred",
    "moved": "a box moved by 50 mm half way", "wrong": "robot pose 6 wrong by 1.1 deg, 15 mm",
    "shuffled": "pictures in another order", "gripper": "gripper in the picture",
    "dull": "gripper before a plain table",
    "halves": "two halves without a common match", "in_hand": "fixed camera, textured box in the hand",
    "optical": "rotations about the optical axis only", "one_axis": "tilts about one axis only",
}  # fmt: skip

# Findings of pictures in words.
SAID = {"scene.gripper": "gripper left out", "scene.moved": "the object that moved, with its pictures"}


def of_scenes() -> dict[str, Any]:
    """Return what the study of scenes measured."""
    found: dict[str, Any] = json.loads((DOCS.parent / "studies" / "scene" / "measured.json").read_text("utf-8"))
    return found


def rms(lines: Sequence[Mapping[str, Any]], name: str) -> float:
    """Return the root mean square of a column."""
    return math.sqrt(sum(line[name] ** 2 for line in lines) / len(lines))


def share_inside(lines: Sequence[Mapping[str, Any]]) -> str:
    """Return how many are within the 95 % region of six numbers."""
    return f"{sum(line['d2'] < INSIDE_95 for line in lines)} of {len(lines)}"


def scenes() -> str:
    """Return X from rendered pictures."""
    rows = []
    for name, words in SCENES.items():
        lines = of_scenes()["pictures"].get(name)
        if not lines:
            continue
        one = lines[0]
        if "refused" in one:
            said = "refused: " + one["refused"].partition(":")[0].partition(".")[0]
            rows.append([words, "", "", "", "", said + (f", {one['in_order']} of 20 right" if one["in_order"] else "")])
            continue
        named = ", ".join(f"row {k} rejected" for k in one["rejected"])
        named = ", ".join(filter(None, [named, *(words for code, words in SAID.items() if code in one["findings"])]))
        numbers = [f"{rms(lines, 'mm'):.2f} mm, {rms(lines, 'deg'):.3f} deg", f"{rms(lines, 'stated_mm'):.2f} mm"]
        said = named if one["usable"] else "NOT USABLE"
        rows.append([words, f"{one['pictures']} of {one['of']}", *numbers, share_inside(lines), said])
    return table(["pictures", "used", "X, RMS over robot noises", "stated", "inside 95 %", "said"], rows)


def tracks() -> str:
    """Return X from simulated tracks."""
    sys.path.insert(0, str(DOCS.parent))
    from studies.scene.measure import TRACKS

    rows = []
    for name, lines in of_scenes()["tracks"].items():
        row = [TRACKS[name].words, str(len(lines))]
        opened = sum("calibration.open" in line["defaults"]["cautions"] for line in lines)
        if opened:
            rows.append([*row, "", "", "", f"NOT USABLE, a direction is open: {opened} of {len(lines)}", "", "", ""])
            continue
        for way in ("exact", "defaults"):
            found = [line[way] for line in lines if way in line]
            d2 = sum(one["d2"] for one in found) / len(found)
            numbers = f"{rms(found, 'mm'):.2f} / {rms(found, 'stated_mm'):.2f} mm"
            row += [numbers, f"{d2:.1f}", share_inside(found)]
        rows.append([*row, f"{sum(line['consistency'] for line in lines) / len(lines):.2f}"])
    head = ["tracks", "draws", "noise declared: RMS / stated", "d^2", "inside 95 %"]
    return table([*head, "estimated: RMS / stated", "d^2", "inside 95 %", "poses and lens"], rows)


def drawn_scenes() -> str:
    """Return X from rendered scenes that are drawn at random."""
    stored = json.loads((DOCS.parent / "studies" / "scene" / "varied.json").read_text("utf-8"))
    rows = []
    for one in stored:
        more = [
            words
            for words, is_so in (
                (f"{100 * one['smeared']:.0f} % blurred", one["smeared"] > 0),
                ("gripper", one["gripper"]),
                ("an object moved", one["moved"] > 0),
                ("a wrong robot pose", one["wrong"] > 0),
            )
            if is_so
        ]
        scene = f"{one['room']}, {one['texture']}, {one['scale']:.1f} m" + "".join(f"; {words}" for words in more)
        pictures = f"{one['n']} of {one['size'][0]} x {one['size'][1]}"
        row = [scene, pictures, f"{one['robot_deg']:.3f} deg, {one['robot_mm']:.2f} mm"]
        if "refused" in one:
            rows.append([*row, "refused", "", ""])
            continue
        row += [f"{one['mm']:.2f} mm, {one['deg']:.3f} deg", f"{one['stated_mm']:.2f} mm"]
        rows.append([*row, f"{one['d2']:.1f}" if one["usable"] else "NOT USABLE"])
    return table(["scene", "pictures", "robot noise", "X off by", "stated", "d^2"], rows)


TABLES: dict[str, Callable[[], str]] = {
    make.__name__: make
    for make in (
        sizes,
        classes,
        defaults,
        covered,
        levels,
        conventions,
        simulators,
        scenes,
        tracks,
        drawn_scenes,
        exit_statuses,
    )
}


def pages() -> list[Path]:
    """Return the pages that have such tables."""
    return [path for path in sorted(DOCS.rglob("*.md")) if MARKED.search(path.read_text(encoding="utf-8"))]


def made(text: str) -> str:
    """Return the text of a page with its tables made anew."""
    return MARKED.sub(lambda found: f"{found[1]}{TABLES[found[2]]()}\n{found[3]}", text)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the tables, or name the pages that differ."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="write nothing")
    check = parser.parse_args(arguments).check
    different = 0
    for path in pages():
        before = path.read_text(encoding="utf-8")
        after = made(before)
        if after != before:
            different += 1
            print(path.relative_to(DOCS))
            if not check:
                path.write_text(after, encoding="utf-8")
    return int(check and different > 0)


if __name__ == "__main__":
    sys.exit(main())
