"""Result files carry a checksum: any change of a value is refused, another layout is not."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.cli.app import main
from uq_handeye.core.files.json_files import CHECKSUM, require_signed, signed_text
from uq_handeye.errors import InputError


def _leaves(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    if isinstance(tree, dict | list):
        items = tree.items() if isinstance(tree, dict) else enumerate(tree)
        return [leaf for key, part in items for leaf in _leaves(part, (*path, key))]
    return [path]


def test_every_changed_value_is_refused() -> None:
    tree = {"X": [[1.0, 2.0], [3.0, 4.0]], "name": "a", "usable": True, "more": {"n": 3, "none": None}}
    data = json.loads(signed_text(tree))
    require_signed(data)
    for path in _leaves(data):
        changed = json.loads(json.dumps(data))
        at = changed
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = at[path[-1]] + 1e-9 if isinstance(at[path[-1]], float) else "other"
        with pytest.raises(InputError, match="checksum"):
            require_signed(changed)


def test_edited_result_is_refused_and_another_layout_is_not(tmp_path: Path) -> None:
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.1mm"), camera=("0.1deg", "0.5mm"))
    result = uq.calibrate(uq.simulate(n_poses=12, noise=noise, seed=3))
    file = result.save(tmp_path / "result.json")
    assert np.array_equal(uq.load(file).X, result.X)
    data = json.loads(file.read_text())
    file.write_text(json.dumps(dict(reversed(data.items())), indent=1))
    assert np.array_equal(uq.load(file).X, result.X)
    data["provenance"]["command"] = "another"
    file.write_text(json.dumps(data))
    with pytest.raises(InputError, match="changed after it was written"):
        uq.load(file)
    del data[CHECKSUM]
    file.write_text(json.dumps(data))
    with pytest.raises(InputError, match="checksum"):
        uq.load(file)


def test_update_changes_notes_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.1mm"), camera=("0.1deg", "0.5mm"))
    result = uq.calibrate(uq.simulate(n_poses=12, noise=noise, seed=5))
    file = result.save(tmp_path / "result.json")
    with pytest.raises(SystemExit) as done:
        main(["update", str(file), "--about", "operator=Ada", "-o", str(tmp_path / "new")])
    assert done.value.code == 0
    found = uq.load(tmp_path / "new" / "result.json")
    assert found.about["operator"] == "Ada"
    assert np.array_equal(found.X, result.X)
    capsys.readouterr()
