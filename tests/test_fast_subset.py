"""Plain `pytest` uses each public function, runs each command, and tests each package.

What a test uses is read from its code, and from that of its fixtures and of the helpers of the tests that it calls.
"""

import dis
import types
from pathlib import Path

import pytest
import support

import uq_handeye as uq
from uq_handeye.cli import app
from uq_handeye.fit.graph.request import COVARIANCES

# Tests of the consistency of each kind of covariance of X: of many draws, its mean or the errors that it predicts.
CONSISTENT = {
    "model": "validation/monte_carlo/test_monte_carlo.py::test_every_kind_of_method_on_poses",
    "sandwich": "empirical_covariance/test_resampling.py::test_with_the_true_noise_model_the_sandwich_is_unbiased",
    "bootstrap": "empirical_covariance/test_resampling.py::test_bootstrap_has_the_size_of_the_sampling_covariance",
}
TESTS = Path(__file__).parent
# The study tests are slow by nature; what is tested here is below them.
NOT_OF_THE_PACKAGE = {"studies", "golden"}


@pytest.fixture(scope="module")
def selected(request):
    """The tests of this run, if it is that of the fast subset."""
    option = request.config.option
    if option.markexpr != support.fast(request.config) or option.keyword:
        pytest.skip("speaks of the fast subset alone")
    return request.session.items


def codes(code):
    """A code object and those of the functions within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from codes(constant)


def strings(value):
    """All strings within a value of tuples, lists, sets and dictionaries."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        yield from strings([*value.keys(), *value.values()])
    elif isinstance(value, tuple | list | set | frozenset):
        for part in value:
            yield from strings(part)


def use(function, names, words, seen):
    """Add the public names and the strings that a function uses, and the functions of the tests that it calls."""
    function = getattr(function, "__wrapped__", function)
    code = getattr(function, "__code__", None)
    if code is None or code in seen:
        return
    seen.add(code)
    known = function.__globals__
    for part in codes(code):
        words.update(strings(part.co_consts))
        base = None
        for step in dis.get_instructions(part):
            value = known.get(step.argval) if step.opname.startswith("LOAD_GLOBAL") else None
            if step.opname in ("LOAD_ATTR", "LOAD_METHOD") and isinstance(base, types.ModuleType):
                if base is uq:
                    names.add(step.argval)
                elif Path(getattr(base, "__file__", None) or "/").is_relative_to(TESTS):
                    value = getattr(base, step.argval, None)
            if isinstance(value, types.FunctionType):
                names.add(value.__name__)
                if Path(value.__code__.co_filename).is_relative_to(TESTS):
                    use(value, names, words, seen)
            elif not isinstance(value, types.ModuleType):
                words.update(strings(value))
            base = value


@pytest.fixture(scope="module")
def used(selected):
    """Public names and strings that the tests of this run use."""
    names, words, seen = set(), set(), set()
    for item in selected:
        use(
            (getattr(item.function, "hypothesis", None) and item.function.hypothesis.inner_test) or item.function,
            names,
            words,
            seen,
        )
        for definitions in item._fixtureinfo.name2fixturedefs.values():
            use(definitions[-1].func, names, words, seen)
        if hasattr(item, "callspec"):
            words.update(strings(list(item.callspec.params.values())))
            for value in item.callspec.params.values():
                use(value, names, words, seen)
    return names, words


def test_each_public_function_is_used(used):
    functions = {name for name in uq.__all__ if isinstance(getattr(uq, name), types.FunctionType)}
    assert functions - used[0] == set()


def test_each_command_is_run(used):
    commands = {name for group in app.COMMANDS.values() for name in group}
    assert commands - used[1] == set()


def test_each_package_is_tested(selected):
    folders = {path.parent.relative_to(TESTS).as_posix() for path in TESTS.rglob("test_*.py")}
    tested = {item.path.parent.relative_to(TESTS).as_posix() for item in selected}
    assert {folder for folder in folders - tested if folder.partition("/")[0] not in NOT_OF_THE_PACKAGE} == set()


def test_each_kind_of_covariance_has_a_test_of_its_consistency(selected):
    assert set(CONSISTENT) == set(COVARIANCES)
    chosen = {item.nodeid.partition("[")[0].removeprefix("tests/") for item in selected}
    assert set(CONSISTENT.values()) <= chosen
