"""Scores of `uq.calibrate` with default settings on the sets of `rigs`, as a Markdown table.

    python -m studies.one_model.measure [--cells CELL ...] [--sets 20] [--rows FILE.csv]

A cell is words joined by commas, in any order, such as ``0.6,local,30`` or ``2,anywhere,15,eye-to-hand,six,urdf``:

- the accuracy of the arm in mm, with a decimal point or ``mm`` (``0mm``, ``0.15``, ``0.6``, ``2mm``);
- the number of poses (30);
- local, anywhere or distant (boards 1.6 m away among them): the spread of the poses;
- eye-in-hand or eye-to-hand;
- estimated or exact: the intrinsics that PnP is given;
- the arms, taken in turn: three (UR5, IRB 120, Panda), six (all of six axes), all, or a name of `chains.ARMS`;
- nothing, urdf (kinematics without joints) or joints (kinematics with joints): what `calibrate` is told of the arm;
- white, drift, wrong_square or wrong_focal: a rig without an arm.

A list of cells may be given by name: base, others, simple or all. Sets depend on the cell and their number alone, and
not on what `calibrate` is told, so the rows of two programs or of two namings belong to the same sets.

Another installed version is judged by its own interpreter from a folder that holds a link to ``studies`` and not the
package itself.

X is compared as ``xi = (theta, tau)``, left rotation and additive translation; d^2 = xi^T C^-1 xi. *RMS* is the 3-D RMS
of tau, *stated* the square root of the mean trace of the translation's covariance, *inside* the share of sets with d^2
within ``result.quantile(0.95)``. *Far* is the pose of the target in the camera at other postures that see it, of the
spread ``anywhere``, without noise of the measurement and with the intrinsics of the calibrated poses: RMS and stated
size of its position, and the share inside the 95 % region. Shares are of the sets that gave a covariance.
"""

from __future__ import annotations

import argparse
import csv
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from scipy.stats import chi2

import uq_handeye as uq
from studies.one_model.chains import ARMS, SIX_AXES
from studies.one_model.rigs import SETUPS, SIMPLE, SPREADS, DataSet, arm_set, simple_set
from studies.one_model.true_arms import left_errors, rms_length
from uq_handeye.model.shared_errors import population

BASE = ("local", "anywhere")
GROUPS = {"three": ("ur5", "irb120", "panda"), "six": SIX_AXES, "all": ARMS}
INTRINSICS, NAMINGS = ("estimated", "exact"), ("nothing", "urdf", "joints")
POPULATION = population.ARMS
Row = dict[str, Any]


class Cell(NamedTuple):
    """Definition of sets, and what `calibrate` is told of the arm."""

    kind: str = "arm"
    accuracy: float = 0.6  # mm
    spread: str = "local"
    n: int = 30
    setup: str = "eye-in-hand"
    intrinsics: str = "estimated"
    arms: str = "three"
    naming: str = "nothing"

    @classmethod
    def parse(cls, text: str) -> Cell:
        """Read words joined by commas; raises ValueError for one that means nothing."""
        values: dict[str, Any] = {}
        words = {
            "kind": SIMPLE,
            "spread": SPREADS,
            "setup": SETUPS,
            "intrinsics": INTRINSICS,
            "arms": (*GROUPS, *ARMS),
            "naming": NAMINGS,
        }
        for word in text.split(","):
            if named := [name for name, known in words.items() if word in known]:
                values[named[0]] = word
            elif word.isdigit():
                values["n"] = int(word)
            else:
                values["accuracy"] = float(word.removesuffix("mm"))
        return cls(**values)

    @property
    def sets(self) -> str:
        """The part that the sets depend on."""
        words = [self.kind, str(self.n), self.setup]
        if self.kind == "arm":
            words[1:1] = [f"{self.accuracy:g} mm", self.spread]
            words += [self.intrinsics, self.arms]
        return ", ".join(words)

    def __str__(self) -> str:
        return self.sets.removeprefix("arm, ") + ("" if self.naming == "nothing" else f", {self.naming}")


def _listed(*texts: str) -> list[Cell]:
    return [Cell.parse(text) for text in texts]


LISTS = {
    "base": [
        Cell("arm", accuracy, spread, n) for accuracy in (0.0, 0.15, 0.6, 2.0) for spread in BASE for n in (15, 30)
    ],
    "others": _listed(
        *(f"{a}mm,{s},30,eye-to-hand" for a in (0, 0.6, 2) for s in BASE),
        *(f"0.6,{s},{n}" for s in BASE for n in (8, 60)),
        *(f"0mm,{s},{n},exact" for s in BASE for n in (15, 30)),
        *(f"{a}mm,{s},30,{arms}" for a in (0.6, 2) for s in BASE for arms in ("six", "six,urdf", "six,joints")),
        *(f"{a}mm,{s},30,joints" for a in (0.6, 2) for s in BASE),
        *(f"{a}mm,distant,30{i}" for a, i in ((0, ",exact"), (0, ""), (0.6, ""))),
    ),
    "simple": _listed("white,15", "white,40", "drift,15", "drift,40", "wrong_square,15", "wrong_square,40",
                      "wrong_focal,15", "wrong_focal,40"),
}  # fmt: skip
LISTS["all"] = [cell for cells in LISTS.values() for cell in cells]


def drawn(cell: Cell, number: int) -> DataSet:
    """Draw one set of a cell; arms are taken in turn."""
    rng = np.random.default_rng([zlib.crc32(cell.sets.encode()), number])
    if cell.kind != "arm":
        return simple_set(cell.kind, rng, n=cell.n, setup=cell.setup)
    arms = GROUPS.get(cell.arms, (cell.arms,))
    return arm_set(
        arms[number % len(arms)],
        1e-3 * cell.accuracy,
        rng,
        n=cell.n,
        spread=cell.spread,
        setup=cell.setup,
        intrinsics=cell.intrinsics,
    )


def options_of(cell: Cell, of: DataSet) -> dict[str, Any]:
    """Return what `calibrate` is told beside the poses."""
    if cell.naming == "nothing" or of.urdf is None:
        return {}
    told: dict[str, Any] = {"kinematics": uq.Kinematics.from_urdf(of.urdf)}
    return told | ({"joints": of.joints} if cell.naming == "joints" else {})


def scored(cell: Cell, number: int, leave_out: bool = False) -> Row:
    """Score one set. Exceptions of the program are caught and named.

    ``leave_out``: the geometry of the arm is not in the population.
    """
    of = drawn(cell, number)
    population.ARMS = tuple(name for name in POPULATION if not leave_out or not name.startswith(of.arm or "-"))
    row: Row = {"cell": str(cell), "number": number, "arm": of.arm}
    options = options_of(cell, of)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        begun = time.process_time()
        try:
            result = uq.calibrate(of.poses, **options)
        except Exception as error:  # whatever the program raises is a failed set
            return row | {"failed": f"{type(error).__name__}: {str(error)[:90]}"}
        row["cpu"] = time.process_time() - begun
        row["usable"] = bool(getattr(result, "usable", True))
        e = left_errors(of.X_true, np.asarray(result.X))
        row |= {"error": 1e3 * float(np.linalg.norm(e[3:])), "angle": float(np.degrees(np.linalg.norm(e[:3])))}
        C = result.covariance
        if C is None or not np.isfinite(C).all():
            return row | {"failed": "no covariance"}
        row["stated"] = 1e3 * float(np.sqrt(np.trace(C[3:, 3:])))
        row["d2"] = float(e @ np.linalg.solve(C, e))
        row["inside"] = row["d2"] <= float(result.quantile(0.95))
        if of.far is not None and len(of.far.seen):
            row |= _far(result, of, cell.naming)
    return row


def _far(result: Any, of: DataSet, naming: str) -> Row:
    """Score predictions at the other postures that see the target; none where the program does not give them."""
    assert of.far is not None
    try:
        at: dict[str, Any] = {"joints": of.far.joints} if naming == "joints" else {"robot": of.far.robot}
        ahead = result.predict_camera(**at, new_measurement=False)
    except Exception as error:
        return {"no_prediction": f"{type(error).__name__}: {str(error)[:90]}"}
    off = left_errors(of.far.seen, np.asarray(ahead.poses))
    C = np.asarray(ahead.covariance)
    d2 = np.sum(off * np.linalg.solve(C, off[..., None])[..., 0], axis=-1)
    return {
        "far": 1e3 * rms_length(off[:, 3:]),
        "far_stated": 1e3 * float(np.sqrt(np.mean(np.trace(C[:, 3:, 3:], axis1=1, axis2=2)))),
        "far_inside": float(np.mean(d2 <= chi2.ppf(0.95, 6))),
    }


COLUMNS = (
    "cell", "sets", "failed", "not usable", "RMS mm", "stated mm", "stated / RMS", "mean d²", "median d²",
    "inside 95 %", "far mm", "far stated", "far inside", "CPU s",
)  # fmt: skip


def summary(cell: Cell, rows: Sequence[Row]) -> list[str]:
    """Return the line of the table for one cell."""
    good = [row for row in rows if "d2" in row]

    def of(name: str) -> Any:
        return np.array([row[name] for row in good if name in row], dtype=float)

    def rms(name: str) -> float:
        return float(np.sqrt(np.mean(of(name) ** 2)))

    line = [str(cell), str(len(rows)), str(len(rows) - len(good)), str(sum(not row["usable"] for row in good))]
    if not good:
        return line + ["-"] * (len(COLUMNS) - len(line))
    line += [f"{rms('error'):.2f}", f"{rms('stated'):.2f}", f"{rms('stated') / rms('error'):.2f}"]
    line += [f"{of('d2').mean():.1f}", f"{np.median(of('d2')):.1f}", f"{100 * of('inside').mean():.0f} %"]
    if len(of("far")):
        line += [f"{rms('far'):.2f}", f"{rms('far_stated'):.2f}", f"{100 * of('far_inside').mean():.0f} %"]
    else:
        line += ["-"] * 3
    return [*line, f"{of('cpu').mean():.2f}"]


def cells_of(texts: Iterable[str]) -> list[Cell]:
    """Return the cells of names of `LISTS` and of cells as text."""
    return [cell for text in texts for cell in (LISTS[text] if text in LISTS else [Cell.parse(text)])]


def main(argv: Sequence[str] | None = None) -> None:
    """Measure the cells, and print each line when it is known."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.one_model.measure",
        description=(__doc__ or "").partition("\n")[0],
        epilog=(__doc__ or "").partition("\n")[2],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--cells", nargs="+", default=["base"], metavar="CELL", help="default: base")
    parser.add_argument("--sets", type=int, default=20, help="number of sets of each cell (default: 20)")
    parser.add_argument("--rows", type=Path, metavar="FILE", help="CSV file for the scores of each set")
    parser.add_argument(
        "--leave-out", action="store_true", help="take the geometry of the arm judged out of the population"
    )
    options = parser.parse_args(argv)
    try:
        cells = cells_of(options.cells)
    except ValueError as error:
        parser.error(f"Not the word of a cell: {error}.")
    cv2.setNumThreads(1)
    scored(Cell("white", n=10), 0)  # imports are not counted as CPU time
    print(f"uq-handeye {uq.__version__}, {options.sets} sets of each cell\n")
    print("| " + " | ".join(COLUMNS) + " |\n" + "|---" * len(COLUMNS) + "|", flush=True)
    every: list[Row] = []
    reasons: Counter[str] = Counter()
    for cell in cells:
        rows = [scored(cell, number, options.leave_out) for number in range(options.sets)]
        print("| " + " | ".join(summary(cell, rows)) + " |", flush=True)
        every += rows
        reasons.update(f"{cell}: {row['failed']}" for row in rows if "failed" in row)
        reasons.update(f"{cell}: no prediction, {row['no_prediction']}" for row in rows if "no_prediction" in row)
    for reason, count in reasons.items():
        print(f"\n{count} x {reason}")
    if options.rows is not None:
        names = list(dict.fromkeys(name for row in every for name in row))
        with options.rows.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, names)
            writer.writeheader()
            writer.writerows(every)


if __name__ == "__main__":
    main()
