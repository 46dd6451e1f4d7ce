"""The figure of a cross-check: which ellipses stand in which panel, and that it can be written."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from support import SEED

import uq_handeye as uq
from uq_handeye.trials.validation.cross_check.run import cross_check
from uq_handeye.trials.validation.figures_of_covariances import DRAWN as LEVEL
from uq_handeye.trials.validation.figures_of_covariances import PAIRS, cross_check_figure, ellipse

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


@pytest.fixture(scope="module")
def check():
    found = cross_check(uq.simulate(10, noise=NOISE, seed=SEED), noise=NOISE, trials=300, seed=SEED, posterior=False)
    # a posterior that is like the bound
    row = replace(found.row("bound"), key="posterior", label="posterior (emcee)", kind="posterior")
    return replace(found, rows=(*found.rows, row))


@pytest.fixture(scope="module")
def figure(check):
    return cross_check_figure(check)


def panels(figure):
    """The 15 panels, row by row, with the components that each must show."""
    shown = [
        pair for k in range(3) for pair in (PAIRS[k], tuple(i + 3 for i in PAIRS[k]), *((i, 3 + k) for i in range(3)))
    ]
    return list(zip(figure.axes, shown, strict=True))


def curves(axis):
    """The closed curves of a panel: (points, 2) each, in the units of the axes."""
    return [line for line in axis.lines if len(line.get_xdata()) == 181]


def test_every_pair_of_components_has_a_panel(figure):
    assert len(figure.axes) == 15
    symbols = [r"\theta_x", r"\theta_y", r"\theta_z", r"\tau_x", r"\tau_y", r"\tau_z"]
    for axis, (i, j) in panels(figure):
        assert symbols[i] in axis.get_xlabel() and symbols[j] in axis.get_ylabel()
        assert ("rad" in axis.get_xlabel()) == (i < 3) and ("rad" in axis.get_ylabel()) == (j < 3)
    # in a grid of three rows
    for row in range(3):
        assert np.ptp([axis.get_position().y0 for axis in figure.axes[5 * row : 5 * row + 5]]) < 1e-6


def test_ellipses_are_those_of_the_rows(figure, check):
    keys = ["4dpa-sampled", "4dpa-poses", "nguyen-own", "bound", "posterior", "4dpa-literal"]
    for axis, (i, j) in panels(figure):
        lines = curves(axis)
        assert len(lines) == 6
        for line, key in zip(lines, keys, strict=True):
            C = check.row(key).covariance[np.ix_([i, j], [i, j])] * 1e6  # mrad, mm
            x = np.stack([line.get_xdata(), line.get_ydata()])
            distance = np.einsum("it,it->t", x, np.linalg.solve(C, x))
            assert np.allclose(distance, LEVEL**2, rtol=1e-3)


def test_ellipse_of_no_error():
    assert not ellipse(np.zeros((6, 6)), 0, 4).any()


def test_lines_differ_without_colour(figure):
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "4DPA, Monte Carlo",
        "4DPA, first order",
        "Nguyen and Pham, own",
        "bound (efficient, ml)",
        "posterior",
        "4DPA, (45) as printed",
        "300 trials of 4DPA",
    ]
    assert "2 standard deviations" in legend.get_title().get_text() and "86.5 %" in legend.get_title().get_text()
    looks = []
    for line in legend.get_lines():
        lightness = float(np.dot(to_rgb(line.get_color()), (0.3, 0.59, 0.11)))
        looks.append((line.get_linestyle(), line.get_marker(), line.get_linewidth() > 2, round(10 * lightness)))
    assert len(set(looks)) == len(looks)


def test_points_and_curves_fit(figure, check):
    for axis, (i, j) in panels(figure):
        low, high = axis.get_xlim()
        for line in curves(axis):
            assert low < line.get_xdata().min() and line.get_xdata().max() < high
        (points,) = [line for line in axis.lines if line.get_marker() == "."]
        assert np.allclose(points.get_xdata(), 1e3 * check.runs["4dpa"].errors[:, i])
        assert np.allclose(points.get_ydata(), 1e3 * check.runs["4dpa"].errors[:, j])


def test_nothing_overlaps(figure):
    renderer = figure.canvas.get_renderer()
    boxes = [axis.get_tightbbox(renderer) for axis in figure.axes]
    boxes.append(figure.legends[0].get_window_extent(renderer))
    for k, one in enumerate(boxes):
        assert not any(one.overlaps(other) for other in boxes[k + 1 :])
        assert one.x0 >= 0 and one.y0 >= 0 and one.x1 <= figure.bbox.x1 and one.y1 <= figure.bbox.y1


def test_what_there_is_not_is_not_drawn(check):
    rows = tuple(replace(row, covariance=None) if row.key in ("bound", "posterior") else row for row in check.rows)
    figure = cross_check_figure(replace(check, rows=rows))
    assert len(curves(figure.axes[0])) == 4
    assert "posterior" not in [text.get_text() for text in figure.legends[0].get_texts()]


def test_files(check, tmp_path):
    check.figure(tmp_path / "check.png")
    check.figure(tmp_path / "check.svg")
    assert (tmp_path / "check.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (tmp_path / "check.svg").read_bytes()
    with pytest.raises(uq.InputError, match=r"\.png or \.svg"):
        check.figure(tmp_path / "check.tiff")
