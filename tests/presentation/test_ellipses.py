"""The figure of the covariance: what is drawn is what is given."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uq_handeye.core.presentation.ellipses import covariance_ellipses, render
from uq_handeye.errors import InputError

X = np.eye(4)
X[:3, :3] = Rotation.from_rotvec([0.4, -0.3, 1.2]).as_matrix()
X[:3, 3] = [0.05, -0.02, 0.1]
_root = np.random.default_rng(3).normal(size=(6, 6)) + 2 * np.eye(6)
DEVIATIONS = np.array([1e-3] * 3 + [0.5e-3] * 3)
COVARIANCE = DEVIATIONS[:, None] * (_root @ _root.T / 6) * DEVIATIONS
FACTORS = {"rad": 1, "mrad": 1e-3, "µrad": 1e-6, "nrad": 1e-9, "m": 1, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9}


def panels(figure):
    """The panels with their axis labels, also where the grid shows them once only."""
    axes = figure.get_axes()
    assert len(axes) == 15
    grid = axes[6:]
    labels = [(axis.get_xlabel(), axis.get_ylabel()) for axis in axes[:6]]
    labels += [(grid[6 + k % 3].get_xlabel(), grid[3 * (k // 3)].get_ylabel()) for k in range(9)]
    return list(zip(axes, labels, strict=True))


def parsed(label):
    """Component and factor of ``$\\theta_x$ (mrad)``."""
    symbol, unit = label.split(" ", 1)
    first = 0 if "theta" in symbol else 3
    return first + "xyz".index(symbol[-2]), FACTORS[unit.strip("()")]


@pytest.mark.usefixtures("without_rendering")
@pytest.mark.slow
@pytest.mark.parametrize("size", [1.0, 1e-6, 1e3])
def test_ellipses_are_those_of_the_covariance(size):
    covariance = size**2 * COVARIANCE
    seen = set()
    for axis, (xlabel, ylabel) in panels(covariance_ellipses(X, covariance)):
        (i, xfactor), (j, yfactor) = parsed(xlabel), parsed(ylabel)
        seen.add(frozenset((i, j)))
        curves = [line.get_xydata() for line in axis.lines if len(line.get_xdata()) > 100]
        assert len(curves) == 3
        precision = np.linalg.inv(covariance[np.ix_([i, j], [i, j])])
        for level, curve in zip((1, 2, 3), curves, strict=True):
            points = curve * [xfactor, yfactor]
            distance = np.einsum("ki,ij,kj->k", points, precision, points)
            np.testing.assert_allclose(distance, level**2, rtol=1e-9)
        (left, right), (low, high) = axis.get_xlim(), axis.get_ylim()
        assert left < curves[2][:, 0].min()
        assert curves[2][:, 0].max() < right
        assert low < curves[2][:, 1].min()
        assert curves[2][:, 1].max() < high
        rho = covariance[i, j] / np.sqrt(covariance[i, i] * covariance[j, j])
        shown = axis.get_title(loc="right").split("= ")[1].replace("\N{MINUS SIGN}", "-")
        assert float(shown) == pytest.approx(rho, abs=5e-4)
        assert 2 <= len([t for t in axis.get_xticks() if left <= t <= right]) <= 6
    assert len(seen) == 15


@pytest.mark.usefixtures("without_rendering")
@pytest.mark.slow
def test_equal_scales_until_they_hide_something():
    def reach(covariance):
        axes = covariance_ellipses(X, covariance).get_axes()
        return [axis.get_xlim()[1] for axis in axes[:3]]

    assert len(set(reach(np.diag([1, 4, 9, 1, 1, 1]) * 1e-6))) == 1
    assert len(set(reach(np.diag([1, 4, 900, 1, 1, 1]) * 1e-6))) > 1
    assert len(set(reach(np.diag([0, 4, 9, 1, 1, 1]) * 1e-6))) == 1


@pytest.mark.usefixtures("without_rendering")
@pytest.mark.slow
def test_samples_and_others():
    samples = np.random.default_rng(0).multivariate_normal(np.zeros(6), COVARIANCE, size=7000)
    others = {"Monte Carlo": COVARIANCE * 1.1, "bound": COVARIANCE * 0.9}
    figure = covariance_ellipses(X, COVARIANCE, samples=samples, others=others, label="4dpa", title="A title")
    axis = figure.get_axes()[0]
    (cloud,) = [line for line in axis.lines if line.get_marker() == "."]
    assert 3000 <= len(cloud.get_xdata()) <= 5000
    styles = {line.get_linestyle() for line in axis.lines if len(line.get_xdata()) == 181}
    assert len(styles) == 3  # not colour alone
    legend = figure.legends[0]
    assert [text.get_text() for text in legend.get_texts()] == [
        "4dpa",
        "Monte Carlo",
        "bound",
        "samples",
    ]
    for part in ("39.3 %", "86.5 %", "98.9 %", "(50.000, -20.000, 100.000) mm"):
        assert part in legend.get_title().get_text()
    assert figure.get_suptitle() == "A title"


@pytest.mark.slow
@pytest.mark.parametrize(
    "covariance",
    [
        1e-18 * np.eye(6),
        1e-40 * np.eye(6),
        np.diag([1.0, 1e2, 1e4, 1e12, 1e-12, 1.0]),
        np.diag([0.0, 1.0, 1.0, 0.0, 0.0, 0.0]),
        np.zeros((6, 6)),
        np.ones((6, 6)),
        -1e-5 * np.ones((6, 6)) + np.eye(6),
    ],
    ids=["tiny", "tinier", "unequal", "singular", "zero", "rank-one", "nearly-uncorrelated"],
)
def test_extreme_covariances_are_drawn(covariance):
    figure = covariance_ellipses(X, covariance)
    for axis in figure.get_axes():
        for line in axis.lines:
            assert np.isfinite(line.get_xydata()).all()
        title = axis.get_title(loc="right")
        assert "nan" not in title
        assert "\N{MINUS SIGN}0.000" not in title


@pytest.mark.usefixtures("without_rendering")
@pytest.mark.slow
def test_undefined_correlation_says_so():
    figure = covariance_ellipses(X, np.diag([0.0, 1, 1, 1, 1, 1]))
    titles = [axis.get_title(loc="right") for axis in figure.get_axes()]
    assert sum("undefined" in title for title in titles) == 5


def texts_overlap(figure):
    """Pairs of axis texts whose boxes intersect, across all panels."""
    figure.draw_without_rendering()  # which puts labels in their places
    boxes = []
    for axis in figure.get_axes():
        texts = [axis.title, axis._right_title, axis.xaxis.label, axis.yaxis.label]
        texts += axis.get_xticklabels() + axis.get_yticklabels()
        (left, right), (low, high) = axis.get_xlim(), axis.get_ylim()
        for text in texts:
            x, y = text.get_position()
            inside = text not in axis.get_xticklabels() or left <= x <= right
            inside &= text not in axis.get_yticklabels() or low <= y <= high
            if text.get_text() and text.get_visible() and inside:
                boxes.append((text.get_text(), text.get_window_extent()))
    return [(a, b) for k, (a, p) in enumerate(boxes) for b, q in boxes[:k] if p.overlaps(q)]


@pytest.mark.slow
@pytest.mark.parametrize("sizes", [[1, 1, 1, 1, 1, 1], [1, 30, 2, 300, 7, 1e4]])
def test_no_text_overlaps(sizes):
    S = COVARIANCE * np.outer(sizes, sizes)
    assert texts_overlap(covariance_ellipses(X, S, title="gripper_T_camera")) == []


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"covariance": np.full((6, 6), np.nan)}, "`covariance`.*finite"),
        ({"covariance": np.diag([np.inf] * 6)}, "`covariance`.*finite"),
        ({"covariance": -np.eye(6)}, "`covariance`"),
        ({"covariance": np.eye(3)}, r"`covariance`.*\(3, 3\)"),
        ({"covariance": [np.eye(6)] * 2}, r"`covariance`.*\(2, 6, 6\)"),
        ({"others": {"bound": np.eye(6) * np.nan}}, r"`others\['bound'\]`.*finite"),
        ({"others": {"estimate": np.eye(6)}}, "names of their own.*'estimate'"),
        ({"others": {str(k): np.eye(6) for k in range(5)}}, "at most 4 others"),
        ({"samples": np.zeros(6)}, "`samples`"),
        ({"samples": [[np.nan] * 6]}, "`samples`"),
        ({"samples": "many"}, "`samples` to be numbers"),
        ({"X": [np.eye(4)] * 2}, "`X`"),
        ({"X": np.eye(4) * np.nan}, "`X`"),
    ],
)
def test_refuses(arguments, match):
    with pytest.raises(InputError, match=match):
        covariance_ellipses(**({"X": X, "covariance": np.eye(6)} | arguments))


@pytest.mark.slow
def test_files():
    png, svg = (render(covariance_ellipses(X, COVARIANCE), kind) for kind in ("png", "svg"))
    assert png.startswith(b"\x89PNG") and b"<svg" in svg[:1000]
    figure = covariance_ellipses(X, COVARIANCE)
    assert render(figure, "svg") == svg  # no date, no random identifiers
    with pytest.raises(InputError, match="'gif'"):
        render(figure, "gif")


@pytest.mark.slow
def test_readers_stay_light_and_figures_leave_no_state():
    code = (
        "import sys, uq_handeye.read; "
        "assert not {'matplotlib', 'pandas', 'sympy', 'emcee'} & set(sys.modules); "
        "import uq_handeye.core.presentation.ellipses; assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
