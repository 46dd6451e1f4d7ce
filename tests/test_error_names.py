"""Names of errors are made where text is made, and nothing is concluded from them: a key says what an error is."""

import ast
import sys
from pathlib import Path

import numpy as np
import pytest
from fixtures.rigs import NOISE, quietly

import uq_handeye as uq
from uq_handeye.model.errors import key as key_module
from uq_handeye.model.errors.key import ErrorKey, Kind, Owner
from uq_handeye.model.errors.keys import ARM, FOCAL_LENGTH, PRINCIPAL_POINT
from uq_handeye.model.errors.sizes import SIZES
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise

PACKAGE = Path(uq.__file__).parent
# Where text is made, and where names come from a command line.
TEXT = ("report/", "cli/", "live_session/", "core/formatting/", "core/presentation/", "core/files/one_line.py")
TEXT_FILES = ("key.py", "key_text.py", "sentences.py", "text.py", "page.py")
NAMES = {kind.value for kind in Kind if " " in kind.value} | {str(key) for key in SIZES if " " in str(key)}
TAKING_APART = (
    *("startswith", "endswith", "split", "rsplit", "partition", "rpartition", "removeprefix", "removesuffix"),
    *("replace", "find", "rfind", "index", "rindex", "__contains__", "__getitem__"),
)


def is_text(path):
    """Return whether a file makes text; its path is relative to the package."""
    return path.name in TEXT_FILES or any(part in f"{path.as_posix()}" for part in TEXT)


def literals(source):
    """Return lines and values of the texts in a program that are no docstrings."""
    tree = ast.parse(source)
    bodies = [node.body[0] for node in ast.walk(tree) if isinstance(getattr(node, "body", None), list) and node.body]
    docstrings = {id(first.value) for first in bodies if isinstance(first, ast.Expr)}
    found = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return [(node.lineno, node.value) for node in found if id(node) not in docstrings]


def named(source):
    """Return the names of errors that a program spells out."""
    if not any(name in source for name in NAMES):
        return []
    return [f"{line}: {value}" for line, value in literals(source) if value.strip() in NAMES]


def test_no_name_of_an_error_is_spelled_out_outside_text():
    found = [
        f"{path.relative_to(PACKAGE)}:{where}"
        for path in sorted(PACKAGE.rglob("*.py")) if not is_text(path.relative_to(PACKAGE))
        for where in named(path.read_text(encoding="utf-8"))
    ]  # fmt: skip
    assert found == []
    assert named('"""focal length"""\nif name == "focal length":\n    pass') == ["2: focal length"]


class Watched(str):
    """A name of an error that keeps where in the package it was taken apart."""

    where: set[str] = set()  # noqa: RUF012


def _watching(method):
    def call(self, *arguments):
        caller = Path(sys._getframe(1).f_code.co_filename)
        if caller.is_relative_to(PACKAGE) and not is_text(caller.relative_to(PACKAGE)):
            Watched.where.add(f"{caller.relative_to(PACKAGE)}: {method}")
        return getattr(str, method)(self, *arguments)

    return call


for method in TAKING_APART:
    setattr(Watched, method, _watching(method))


@pytest.fixture
def watched(monkeypatch):
    """Make every name of an error a `Watched` one."""
    text = key_module.text_of
    monkeypatch.setattr(key_module, "text_of", lambda *values: Watched(text(*values)))
    Watched.where.clear()
    return Watched.where


def test_a_name_that_is_taken_apart_is_seen(watched):
    name = str(FOCAL_LENGTH)
    namespace = {"name": name}
    exec(compile("name.partition(' ')", str(PACKAGE / "fit" / "somewhere.py"), "exec"), namespace)
    exec(compile("name.partition(' ')", str(PACKAGE / "report" / "somewhere.py"), "exec"), namespace)
    assert watched == {"fit/somewhere.py: partition"}


@pytest.mark.slow
def test_no_name_of_an_error_is_taken_apart(watched, tmp_path):
    """Estimated and given noise, columns of one's own, files, budget, screens, check, update and a rig."""
    poses = uq.simulate(24, noise=NOISE, seed=4)
    first, later = (uq.PosePairs(poses.robot[part], poses.camera[part], poses.setup, timestamps=np.arange(24.0)[part])
                    for part in (slice(0, 16), slice(16, 24)))  # fmt: skip
    own = uq.SharedError.columns("waves", np.random.default_rng(0).normal(size=(16, 6, 2)), 1e-4, "robot")
    for options in ({}, {"noise": NOISE, "shared": [own]}):
        result = quietly(first, **options)
        result.to_json(tmp_path / "result.json")
        again = uq.Calibration.from_json(tmp_path / "result.json")
        assert again.budget.keys == result.budget.keys and again.accuracy.parts == result.accuracy.parts
        assert again.summary() == result.summary()
    result = quietly(first, shared=[])
    assert uq.check(result, later, same=("camera",)).summary()
    assert uq.update(result, later).shared
    exact, _ = simulate_rig({"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=16, seed=2)
    rig = with_noise(exact, NOISE, 1)
    found = quietly(rig)
    assert uq.check(found, with_noise(exact, NOISE, 2), same=("left", "board")).dof > 0
    assert watched == set()


def test_keys_are_plain_values():
    for key in (FOCAL_LENGTH, PRINCIPAL_POINT.number("x"), ARM[0].number("elbow").of("left arm"),
                ErrorKey(Owner.CAMERA, Kind.OWN, 3, "waves")):  # fmt: skip
        assert ErrorKey.from_dict(key.to_dict()) == key
    assert ARM[0].number("elbow").of("left").to_dict() == {
        "owner": "robot", "kind": "joint offsets", "index": "elbow", "name": "left",
    }  # fmt: skip
    for wrong in (
        {"owner": "robot"},
        {"owner": "robot", "kind": "mood"},
        {"owner": "robot", "kind": "sag", "index": 0.5},
    ):
        with pytest.raises(uq.InputError, match=r"key of an error|known error"):
            ErrorKey.from_dict(wrong)


def test_an_own_error_is_its_own_whatever_it_is_called():
    """One that is called as an error of the arm is none of the arm."""
    poses = uq.simulate(20, noise=NOISE, seed=3)
    F = np.zeros((20, 6, 1))
    F[:, 3, 0] = np.linspace(-1, 1, 20)
    result = quietly(poses, noise=NOISE, shared=[uq.SharedError.columns("sag", F, 1e-4, "robot", unit="m")])
    assert "sag 0.1 mm" in result.accuracy.included and "robot kinematics" in result.accuracy.not_included
