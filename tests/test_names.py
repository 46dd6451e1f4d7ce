"""The public names: loaded when first asked for, whatever was imported before them."""

import pkgutil
import subprocess
import sys

import pytest

import uq_handeye as uq


def test_every_name_is_there():
    for name in uq.__all__:
        assert getattr(uq, name) is not None
    assert set(uq.__all__) <= set(dir(uq))


def test_only_public_names_are_listed():
    """Neither the modules that were loaded on the way, nor what the package itself imports."""
    import uq_handeye.calibration.calibrate  # noqa: F401

    assert {name for name in dir(uq) if not name.startswith("__")} == set(uq.__all__)
    for name in ("Any", "TYPE_CHECKING"):
        with pytest.raises(AttributeError):
            getattr(uq, name)


def test_no_name_is_that_of_a_module():
    """Importing the module would put it in the place of the function."""
    assert not {module.name for module in pkgutil.iter_modules(uq.__path__)} & set(uq.__all__)


def test_what_is_no_name_is_an_error():
    program = "import uq_handeye as uq\ntry:\n    uq.calibrat\nexcept AttributeError as error:\n    print(error)"
    done = subprocess.run([sys.executable, "-c", program], text=True, capture_output=True, check=True)
    assert done.stdout.strip() == "module 'uq_handeye' has no attribute 'calibrat'"


def test_importing_the_package_loads_nothing_slow():
    slow = {"numpy", "scipy", "sympy", "emcee", "matplotlib", "pandas", "jinja2", "yaml"}
    program = f"import sys, uq_handeye; print(sorted({slow} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], text=True, capture_output=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.slow
def test_modules_are_found_without_being_imported():
    done = subprocess.run(
        [sys.executable, "-c", "import uq_handeye as uq; print(uq.read.read_pose_file.__name__)"],
        text=True,
        capture_output=True,
        check=True,
    )
    assert done.stdout.strip() == "read_pose_file"
