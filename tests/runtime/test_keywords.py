"""Functions that take the fields of a dataclass: names that are shown, and names that are refused."""

import inspect

import pytest

import uq_handeye as uq

TAKEN = {
    "monte_carlo": {"trials", "digits", "workers", "executor", "directory", "resume", "progress"},
    "cross_check": {"workers", "executor", "directory", "resume", "progress"},
    "sample_posterior": {"file", "resume", "progress"},
    "simulate": {"X", "W", "distance", "tilt", "roll"},
}


@pytest.mark.parametrize("name", TAKEN)
def test_fields_are_keywords(name):
    function = getattr(uq, name)
    parameters = inspect.signature(function).parameters
    assert TAKEN[name] <= set(parameters)
    assert not any(one.kind is inspect.Parameter.VAR_KEYWORD for one in parameters.values())
    for keyword in TAKEN[name]:
        assert keyword in function.__doc__
    with pytest.raises(TypeError, match=rf"^{name}\(\) got an unexpected keyword argument 'wrong'$"):
        function(*() if name == "simulate" else (None,), wrong=1)
