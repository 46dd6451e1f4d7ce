"""X from stored corners of pictures that MuJoCo rendered: the camera of the model, and the usual mistakes, named."""

import json

import numpy as np
import pytest
from scipy import stats

from studies.simulators import cell
from studies.simulators.measure import FILE, of_corners
from uq_handeye.model.camera.corners import Corners

STORED = json.loads(FILE.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def corners():
    of = STORED["corners"]
    points = np.pad(cell.BOARD.side * np.array(of["point"], float), ((0, 0), (0, 1)))
    return Corners(np.array(of["row"]), points, np.array(of["pixels"]), image_size=cell.SIZE)


def test_stored_joints_are_those_of_the_cell():
    np.testing.assert_allclose(cell.postures(), STORED["joints"])


@pytest.mark.slow
@pytest.mark.parametrize("given", [cell.intrinsics(cell.OFFSET), None], ids=["model", "estimated"])
def test_the_camera_of_the_model_gives_its_x(corners, given):
    found = of_corners(corners, given)
    assert found["usable"] and found["mm"] < 0.05 and found["deg"] < 0.005
    assert found["d2"] < stats.chi2.ppf(0.9999, 6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("move", "words"),
    [
        ((0.5, 0.5), "half a pixel"),
        (tuple(2 * np.array(cell.OFFSET)), "has the other sign"),
        (cell.OFFSET, "another crop"),
    ],
    ids=["half a pixel", "sign", "left out"],
)
def test_mistakes_are_named(corners, move, words):
    given = cell.intrinsics(cell.OFFSET)
    found = of_corners(corners, {**given, "cx": given["cx"] + move[0], "cy": given["cy"] + move[1]})
    assert not found["usable"] and words in found["named"]
