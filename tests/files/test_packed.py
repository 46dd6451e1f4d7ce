"""Large arrays of a result file in their compact form."""

from __future__ import annotations

import json

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.core.files.packed import MIN_PACKED_NUMBERS, packed, unpacked

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("shape", [(MIN_PACKED_NUMBERS,), (7, 6, 6), (3, 40, 40), (4, 13, 1)])
def test_arrays_come_back_bit_by_bit(shape: tuple[int, ...]) -> None:
    given = RNG.normal(size=shape) * 10.0 ** RNG.integers(-300, 300, size=shape)
    text = json.loads(json.dumps(packed({"a": given.tolist()})))
    assert "float64" in text["a"]
    assert unpacked(text) == {"a": given.tolist()}


def test_symmetric_matrices_are_written_once() -> None:
    S = RNG.normal(size=(5, 30, 30))
    S = S + S.mT
    whole, lower = (len(packed(A.tolist())["float64"]) for A in (S + np.triu(np.full((30, 30), 1e-3), 1), S))
    assert unpacked(packed(S.tolist())) == S.tolist()
    assert lower < 0.56 * whole


def test_few_numbers_whole_numbers_and_ragged_lists_stay_lists() -> None:
    data = {
        "few": [1.5] * (MIN_PACKED_NUMBERS - 1),
        "whole": list(range(100)),
        "ragged": [[1.0] * 20, [1.0] * 30],
        "mixed": [None, *[1.0] * 60],
    }
    assert packed(data) == data


def test_records_are_columns() -> None:
    records = [{"key": {"owner": "robot", "index": k}, "sd": 0.1 * k, "side": "robot"} for k in range(40)]
    records += [{"key": {"owner": "camera"}, "sd": 2.0, "side": "camera", "more": True}] * 3
    assert unpacked(json.loads(json.dumps(packed(records)))) == records
    assert len(json.dumps(packed(records))) < 0.4 * len(json.dumps(records))


@pytest.mark.parametrize(
    "damage",
    [
        {"shape": [7, 6, 5]},
        {"shape": [-7, 6, 6]},
        {"shape": [10**6, 10**6]},
        {"float64": "AAAA"},
        {"float64": "ä"},
        {"shape": None},
    ],
)
def test_damaged_arrays_are_refused(damage: dict[str, object]) -> None:
    with pytest.raises(uq.InputError, match="damaged"):
        unpacked(packed(RNG.normal(size=(7, 6, 6)).tolist()) | damage)


@pytest.mark.slow
@pytest.mark.parametrize(("n", "timestamps", "most"), [(30, False, 0.3e6), (30, True, 0.45e6), (200, False, 1.1e6)])
def test_a_result_file_is_small_and_keeps_its_numbers(tmp_path, n: int, timestamps: bool, most: float) -> None:
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.05deg", "0.3mm"))
    drawn = uq.simulate(n_poses=n, noise=noise, seed=5)
    times = 10.0 * np.arange(n) if timestamps else None
    result = uq.calibrate(uq.PosePairs(drawn.robot, drawn.camera, drawn.setup, times))
    path = result.save(tmp_path / "result.json")
    assert path.stat().st_size < most
    again = uq.load(path)
    assert again.to_dict() == result.to_dict()
    for before, after in ((result.posterior, again.posterior), (result.noise.camera, again.noise.camera)):
        of = ("covariance", "estimate") if before is result.posterior else ("own", "shared")
        for name in of:
            whole = getattr(before, name)
            np.testing.assert_allclose(getattr(after, name), whole, rtol=0, atol=1e-9 * np.abs(whole).max())
    assert again.noise.robot.keys == result.noise.robot.keys
