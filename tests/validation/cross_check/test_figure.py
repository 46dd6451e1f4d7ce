"""The figure of a cross-check: which ellipses stand in which panel, and that it can be written."""

from dataclasses import replace

import numpy as np
import pytest
from support import SEED

import uq_handeye as uq
from uq_handeye.trials.validation.cross_check.run import cross_check
from uq_handeye.trials.validation.figure_of_cross_check import cross_check_figure

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


def curves(axis):
    """The closed curves of a panel: (points, 2) each, in the units of the axes."""
    return [line for line in axis.lines if len(line.get_xdata()) == 181]


@pytest.mark.slow
def test_ellipses_are_those_of_the_rows(figure, check):
    keys = ["4dpa-poses", "4dpa-sampled", "nguyen-own", "bound", "posterior"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "4DPA, first order",
        "4DPA, Monte Carlo",
        "Nguyen and Pham, own",
        "bound (efficient, ml)",
        "posterior",
        "samples",
    ]
    for axis, (i, j) in ((figure.axes[0], (0, 1)), (figure.axes[3], (3, 4)), (figure.axes[6], (0, 3))):
        lines = curves(axis)
        for line, key in zip(lines[2::3], keys, strict=True):  # of 3 standard deviations
            C = check.row(key).covariance[np.ix_([i, j], [i, j])] * 1e6  # mrad, mm
            x = np.stack([line.get_xdata(), line.get_ydata()])
            assert np.allclose(np.einsum("it,it->t", x, np.linalg.solve(C, x)), 9, rtol=1e-3)
        (points,) = [line for line in axis.lines if line.get_marker() == "."]
        assert np.allclose(points.get_xdata(), 1e3 * check.runs["4dpa"].errors[:, i])
        assert np.allclose(points.get_ydata(), 1e3 * check.runs["4dpa"].errors[:, j])


@pytest.mark.usefixtures("without_rendering")
@pytest.mark.slow
def test_what_there_is_not_is_not_drawn(check):
    rows = tuple(replace(row, covariance=None) if row.key in ("bound", "posterior") else row for row in check.rows)
    figure = cross_check_figure(replace(check, rows=rows))
    assert len(curves(figure.axes[0])) == 9
    assert "posterior" not in [text.get_text() for text in figure.legends[0].get_texts()]
    nothing = tuple(replace(row, covariance=None) for row in check.rows)
    assert len(cross_check_figure(replace(check, rows=nothing, runs={})).axes) == 15


@pytest.mark.slow
def test_files(check, tmp_path, without_rendering):
    check.figure(tmp_path / "check.png")
    check.figure(tmp_path / "check.svg")
    assert (tmp_path / "check.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (tmp_path / "check.svg").read_bytes()
    with pytest.raises(uq.InputError, match=r"\.png or \.svg"):
        check.figure(tmp_path / "check.tiff")
