"""The figure of a comparison: what is drawn is what the rows say, legibly, whatever the rows say."""

import dataclasses
import math
import subprocess
import sys

import numpy as np
import pytest
from fixtures.comparisons import compare
from support import moved

import uq_handeye as uq
from uq_handeye.core.presentation.colours import BLUE, ORANGE
from uq_handeye.core.presentation.ellipses import render
from uq_handeye.report.comparison.compare import Row, against
from uq_handeye.report.comparison.figure import comparison_picture

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
UNITS = {"m": 1, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9, "deg": 1, "mdeg": 1e-3, "µdeg": 1e-6}


@pytest.fixture(scope="module")
def agreeing():
    return compare(uq.simulate(15, noise=NOISE, seed=5), noise=NOISE)


def shifted(comparison, shifts):
    """The comparison with methods moved by so many standard deviations along each component."""
    base = comparison["4dpa"]
    rows = []
    for row in comparison.rows:
        if row.method in shifts and row.X is not None:
            xi = np.asarray(shifts[row.method]) * row.std
            row = against(dataclasses.replace(row, X=moved(base.X, xi)), base)
        rows.append(row)
    return dataclasses.replace(comparison, rows=tuple(rows))


def failing(comparison, *names):
    """The comparison with methods that failed, the first as one that did not converge."""
    rows = []
    for row in comparison.rows:
        if row.method in names:
            row = Row(row.method, row.year, row.structure, row.form, failure="The motions do not determine X. " * 6)
            if row.method == names[0]:
                X = moved(comparison["4dpa"].X, 1e-3 * np.ones(6))
                row = dataclasses.replace(row, X=X, converged=False, iterations=100, failure="It did not converge.")
                row = against(row, comparison["4dpa"])
        rows.append(row)
    return dataclasses.replace(comparison, rows=tuple(rows))


def no_noise(comparison):
    rows = [
        against(dataclasses.replace(row, covariance=None, d2=None, agrees=None), comparison["4dpa"])
        for row in comparison.rows
    ]
    return dataclasses.replace(comparison, rows=tuple(rows), noise=None)


CASES = {
    "agree": lambda c: c,
    "three differ": lambda c: shifted(
        c, {"tsai": [5, 0, 0, 0, 0, 0], "lu": [0, 0, 0, 4, 4, 0], "park": [0, 6, 0, 0, 0, 6]}
    ),
    "all differ": lambda c: shifted(
        c, {row.method: 6 * np.cos(np.arange(6) + k) for k, row in enumerate(c.rows) if row.method != "4dpa"}
    ),
    "outlier": lambda c: shifted(c, {"tsai": [4000, -3000, 5000, 1e5, -2e5, 3e6], "lu": [9, 9, 0, 0, 9, -9]}),
    "failures": lambda c: failing(c, "gwak", "shiu", "tsai"),
    "no noise": no_noise,
    "one covariance missing": lambda c: dataclasses.replace(
        no_noise(c), rows=(no_noise(c).rows[0], *c.rows[1:]), noise=NOISE
    ),
    "no noise, outlier": lambda c: no_noise(shifted(c, {"shiu": [900, 0, -900, 0, 900, 0]})),
    "exact": lambda c: no_noise(shifted(c, {row.method: np.zeros(6) for row in c.rows})),
    "two methods": lambda c: dataclasses.replace(c, rows=c.rows[-2:]),
    "fifteen": lambda c: dataclasses.replace(
        c, rows=c.rows + tuple(dataclasses.replace(c["lu"], method=f"another {k}") for k in range(15 - len(c.rows)))
    ),
}


def boxes(figure):
    """Every text that shows, with its box: (text, box, axes or None)."""
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()
    found = [(text.get_text(), text.get_window_extent(renderer), None) for text in figure.texts]
    for axis in figure.axes:
        texts = [*axis.texts, axis.title, axis.xaxis.label, axis.yaxis.label]
        texts += axis.get_xticklabels() + axis.get_yticklabels()
        for text in texts:
            box = text.get_window_extent(renderer)
            found.append((text.get_text(), box, axis))
    return [entry for entry in found if entry[0].strip()]


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_texts_neither_overlap_nor_leave_the_figure(agreeing, name):
    figure = comparison_picture(CASES[name](agreeing)).figure
    entries = boxes(figure)
    width, height = figure.canvas.get_width_height()
    for text, box, _ in entries:
        assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height, text
        assert not {"nan", "None"} & set(text.replace("None of", "").split()), text
    clashes = [
        (a, b)
        for k, (a, p, _) in enumerate(entries)
        for b, q, _ in entries[:k]
        if p.padded(-0.8).overlaps(q.padded(-0.8))
    ]
    assert clashes == []


def drawn(comparison):
    return comparison_picture(comparison).figure


def in_order(comparison):
    """The rows as they are drawn, the reference first."""
    rows = [row for row in comparison.rows if row.failure is None]
    return sorted(rows, key=lambda row: row.method != comparison.reference)


def columns(figure):
    """The panels of theta_x to tau_z: translation stands above."""
    return [*figure.axes[3:], *figure.axes[:3]]


def factor(axis):
    """Rad or m per unit of an axis."""
    unit = axis.get_xlabel().split("(")[1].rstrip(")")
    return UNITS[unit] * (math.pi / 180 if unit.endswith("deg") else 1)


def marks(axis):
    """(colour, marker) of the points of an axis."""
    return [(line.get_color(), line.get_marker()) for line in axis.lines if len(line.get_xdata()) == 1]


@pytest.mark.usefixtures("without_rendering")
@pytest.mark.slow
@pytest.mark.parametrize("name", ["agree", "three differ"])
def test_bars_are_those_of_the_rows(agreeing, name):
    comparison = CASES[name](agreeing)
    rows = in_order(comparison)
    for k, axis in enumerate(columns(drawn(comparison))):
        low, high = (end * factor(axis) for end in axis.get_xlim())
        bars = [line for line in axis.lines if len(line.get_xdata()) == 2 and line.get_solid_capstyle() == "butt"]
        inside = [row for row in rows if low <= row.xi[k] <= high]
        assert len(bars) == 2 * len(inside)
        for row, two, one in zip(inside, bars[::2], bars[1::2], strict=True):
            for level, bar in ((2, two), (1, one)):
                ends = row.xi[k] + level * row.std[k] * np.array([-1, 1])
                np.testing.assert_allclose(bar.get_xdata() * factor(axis), ends, atol=2e-4 * (high - low))


@pytest.mark.usefixtures("without_rendering")
@pytest.mark.slow
def test_who_differs_is_marked_and_named(agreeing):
    comparison = CASES["three differ"](agreeing)
    figure = drawn(comparison)
    rows = in_order(comparison)
    expected = ["black" if row.method == "4dpa" else ORANGE if row.agrees is False else BLUE for row in rows]
    for axis in columns(figure):
        assert [colour for colour, _ in marks(axis)] == expected
    names = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert names == [f"{row.method}, differs" if row.agrees is False else row.method for row in rows]
    assert sum("differs" in name for name in names) == 3


@pytest.mark.usefixtures("without_rendering")
@pytest.mark.slow
def test_an_outlier_does_not_squash_the_others(agreeing):
    plain, wild = (columns(drawn(CASES[name](agreeing)))[3] for name in ("agree", "outlier"))
    extent = [np.ptp(axis.get_xlim()) * factor(axis) for axis in (plain, wild)]
    assert extent[1] < 5 * extent[0]
    value = 1e5 * agreeing["tsai"].std[3] / factor(wild)
    shown = [text.get_text() for text in wild.texts if text.get_text().startswith("+")]
    assert len(shown) == 1 and float(shown[0]) == pytest.approx(value, rel=0.06)


@pytest.mark.usefixtures("without_rendering")
@pytest.mark.slow
def test_failures_are_left_out(agreeing):
    names = [text.get_text() for text in drawn(CASES["failures"](agreeing)).axes[0].get_yticklabels()]
    assert len(names) == len(agreeing.rows) - 3 and not {"gwak", "shiu", "tsai"} & set(names)


@pytest.mark.slow
def test_nothing_to_draw(agreeing):
    nothing = dataclasses.replace(failing(agreeing, "", *uq.METHODS), reference=None)
    assert comparison_picture(nothing) is None
    assert comparison_picture(dataclasses.replace(agreeing, rows=(agreeing["4dpa"],))) is None


@pytest.mark.usefixtures("without_rendering")
@pytest.mark.slow
def test_without_noise_there_are_points_alone(agreeing):
    figure = drawn(no_noise(agreeing))
    bars = [line for axis in figure.axes for line in axis.lines if line.get_solid_capstyle() == "butt"]
    assert bars == []


@pytest.mark.slow
def test_files_are_repeatable_and_small(agreeing):
    figure = drawn(CASES["three differ"](agreeing))
    assert len(render(figure, "png")) < 250_000
    assert render(drawn(CASES["three differ"](agreeing)), "svg") == render(figure, "svg")


@pytest.mark.slow
def test_matplotlib_is_loaded_for_the_figure_alone():
    code = (
        "import sys, uq_handeye.report.comparison.compare; "
        "assert not {'matplotlib', 'pandas', 'rich'} & set(sys.modules); "
        "import uq_handeye.report.comparison.figure; assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
