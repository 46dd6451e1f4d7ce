"""The figure of a comparison: what is drawn is what the rows say, legibly, whatever the rows say."""

import dataclasses
import math
import subprocess
import sys

import numpy as np
import pytest
from comparison_cases import compare
from support import moved

import uq_handeye as uq
from uq_handeye.core.presentation.ellipses import PAIRS_WITHIN, render
from uq_handeye.report.comparison.compare import CHI2_95, Row, against
from uq_handeye.report.comparison.figure import comparison_figure, png

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
    "all fail": lambda c: dataclasses.replace(failing(c, "", *uq.METHODS), reference=None),
    "warnings": lambda c: dataclasses.replace(c, warnings=("The residuals are larger than they should be. " * 9,) * 2),
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


@pytest.mark.parametrize("name", CASES)
def test_texts_neither_overlap_nor_leave_the_figure(agreeing, name):
    figure = comparison_figure(CASES[name](agreeing))
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


def columns(figure):
    return figure.axes[:6]


def panels(figure):
    return figure.axes[6:]


def factor(axis, along="x"):
    """Rad or m per unit of an axis."""
    unit = getattr(axis, f"get_{along}label")().split("(")[1].rstrip(")")
    return UNITS[unit] * (math.pi / 180 if unit.endswith("deg") else 1)


@pytest.mark.parametrize("name", ["agree", "three differ"])
def test_bars_and_ellipses_are_those_of_the_rows(agreeing, name):
    comparison = CASES[name](agreeing)
    figure = comparison_figure(comparison)
    rows = [row for row in comparison.rows if row.failure is None]
    for k, axis in enumerate(columns(figure)):
        ends = [line.get_xdata() for line in axis.lines if len(line.get_xdata()) == 2 and line.get_ydata()[0] % 1 == 0]
        ends = np.array([e for e in ends if e[0] != e[1] and set(e) != {0, 1}]) * factor(axis)
        assert len(ends) == 2 * len(rows)
        for row, two, one in zip(rows, ends[::2], ends[1::2], strict=True):
            np.testing.assert_allclose(two, row.xi[k] + 2 * row.std[k] * np.array([-1, 1]), atol=1e-15)
            np.testing.assert_allclose(one, row.xi[k] + row.std[k] * np.array([-1, 1]), atol=1e-15)
    pairs = [*PAIRS_WITHIN, *((i + 3, j + 3) for i, j in PAIRS_WITHIN)]
    for axis, (i, j) in zip(panels(figure), pairs, strict=True):
        curves = [line.get_xydata() for line in axis.lines if len(line.get_xdata()) > 100]
        assert len(curves) == len(rows)
        for row, curve in zip(rows, curves, strict=True):
            offset = curve * [factor(axis), factor(axis, "y")] - row.xi[[i, j]]
            precision = np.linalg.inv(row.covariance[np.ix_([i, j], [i, j])])
            distance = np.einsum("ki,ij,kj->k", offset, precision, offset)
            np.testing.assert_allclose(distance, CHI2_95, rtol=1e-9)


def styles(axis):
    """(colour, line style) of the ellipses of a panel."""
    curves = [line for line in axis.lines if len(line.get_xdata()) > 100]
    return [(line.get_color(), str(line._dash_pattern)) for line in curves]


def marks(axis):
    """(colour, marker) of the points of an axis."""
    return [(line.get_color(), line.get_marker()) for line in axis.lines if len(line.get_xdata()) == 1]


def test_who_agrees_is_quiet_and_who_differs_is_not(agreeing):
    comparison = CASES["three differ"](agreeing)
    figure = comparison_figure(comparison)
    rows = [row for row in comparison.rows if row.failure is None]
    found = dict(zip([row.method for row in rows], styles(panels(figure)[0]), strict=True))
    quiet = {found[row.method] for row in rows if row.agrees and row.method != "4dpa"}
    loud = [found[name] for name in ("tsai", "park", "lu")]
    assert len(quiet) == 1
    assert len(set(loud)) == 3 and not quiet & set(loud)
    assert len({colour for colour, _ in loud}) == len({dashes for _, dashes in loud}) == 3
    assert found["4dpa"][0] == "black"
    texts = [text.get_text() for axis in figure.axes for text in axis.texts]
    assert texts.count("differs") == 3
    assert texts.count("agrees") == len(rows) - 4
    assert texts.count("reference") == 1
    assert len({marker for _, marker in marks(columns(figure)[0])}) == 4  # of the three that differ, of the others
    assert all(set(marks(panel)) == set(marks(columns(figure)[0])) for panel in panels(figure))


def test_fourteen_that_differ_are_told_apart(agreeing):
    rows = [agreeing["4dpa"]]
    for k in range(14):
        row = dataclasses.replace(
            agreeing["park"], method=f"m{k}", X=moved(rows[0].X, 0.01 * np.cos(np.arange(6) * k + k))
        )
        rows.append(against(row, rows[0]))
    assert not any(row.agrees for row in rows[1:])
    found = styles(panels(comparison_figure(dataclasses.replace(agreeing, rows=tuple(rows))))[0])
    assert len(set(found)) == 15


def test_an_outlier_does_not_squash_the_others(agreeing):
    plain, wild = (columns(comparison_figure(CASES[name](agreeing)))[3] for name in ("agree", "outlier"))
    extent = [np.ptp(axis.get_xlim()) * factor(axis) for axis in (plain, wild)]
    assert extent[1] < 5 * extent[0]
    value = 1e5 * agreeing["tsai"].std[3] / factor(wild)
    shown = [text.get_text() for text in wild.texts if text.get_text().startswith("+")]
    assert len(shown) == 1 and float(shown[0]) == pytest.approx(value, rel=0.06)


def test_failures_are_named(agreeing):
    figure = comparison_figure(CASES["failures"](agreeing))
    texts = [" ".join(text.get_text().split()) for axis in figure.axes for text in axis.texts]
    assert sum(text.startswith("failed: The motions do not determine X.") for text in texts) == 2
    assert "It did not converge." in texts
    hollow = [line for line in columns(figure)[0].lines if line.get_markerfacecolor() == "white"]
    assert len(hollow) == 1


def undetermined(comparison, name):
    """The comparison with a method whose covariance means nothing, far away from all others."""
    row = comparison[name]
    changes = {"X": moved(row.X, 0.4 * np.ones(6)), "covariance": 1e8 * row.covariance, "d2": None, "agrees": None}
    row = dataclasses.replace(row, failure="With this noise the motions do not determine X.", **changes)
    row = against(row, comparison[comparison.reference])
    return dataclasses.replace(
        comparison, rows=tuple(row if row.method == name else other for other in comparison.rows)
    )


def test_an_undetermined_method_is_hollow_and_does_not_squash_the_others(agreeing):
    plain, figure = (comparison_figure(c) for c in (agreeing, undetermined(agreeing, "shiu")))
    for before, after in zip(columns(plain), columns(figure), strict=True):
        assert np.ptp(after.get_xlim()) * factor(after) < 1.5 * np.ptp(before.get_xlim()) * factor(before)
        assert any(text.get_text()[0] == "+" for text in after.texts if text.get_text()[0] in "+\N{MINUS SIGN}")
    texts = [" ".join(text.get_text().split()) for axis in figure.axes for text in axis.texts]
    assert any(text.startswith("undetermined: With this noise") for text in texts)
    assert any("Hollow: not to be relied on" in " ".join(text.get_text().split()) for text in figure.texts)
    curves = [line for line in panels(figure)[0].lines if len(line.get_xdata()) > 100]
    assert len(curves) == sum(row.failure is None for row in undetermined(agreeing, "shiu").rows)


def test_without_noise_every_method_has_its_own_mark_in_all_panels():
    comparison = no_noise(compare(uq.simulate(15, noise=NOISE, seed=0)))
    figure = comparison_figure(comparison)
    rows = [row for row in comparison.rows if row.failure is None]
    assert len(rows) > 7
    for panel in panels(figure):
        inside = [mark for mark in marks(panel) if mark[1] not in "<>v^"]
        assert len(set(inside)) == len(inside) > 5
        assert set(inside) <= set(marks(columns(figure)[0])) | {mark for c in columns(figure) for mark in marks(c)}


def test_without_noise_it_says_that_there_are_no_ellipses(agreeing):
    figure = comparison_figure(no_noise(agreeing))
    assert any("no ellipses" in " ".join(text.get_text().split()) for text in figure.texts)
    assert all(len(line.get_xdata()) <= 2 for axis in figure.axes for line in axis.lines)


def test_warnings_are_in_sight(agreeing):
    figure = comparison_figure(CASES["warnings"](agreeing))
    assert any(text.get_text().startswith("CAUTION, 2 warnings: The residuals") for text in figure.texts)


def test_files_are_repeatable_and_small(agreeing):
    figure = comparison_figure(CASES["three differ"](agreeing))
    small, svg = png(figure), render(figure, "svg")
    assert small.startswith(b"\x89PNG") and len(small) < 250_000
    assert render(comparison_figure(CASES["three differ"](agreeing)), "svg") == svg


def test_matplotlib_is_loaded_for_the_figure_alone():
    code = (
        "import sys, uq_handeye.report.comparison.compare; "
        "assert not {'matplotlib', 'pandas', 'rich'} & set(sys.modules); "
        "import uq_handeye.report.comparison.figure; assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
