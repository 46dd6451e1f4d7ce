"""One BLAS thread per process, `support` made importable (--import-mode=importlib), one seeded generator per test."""

import os
import sys
import zlib
from pathlib import Path

for variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):  # before NumPy is loaded
    os.environ.setdefault(variable, "1")
sys.path.insert(0, str(Path(__file__).parent))

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from support import SEED  # noqa: E402

from uq_handeye import findings  # noqa: E402


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """The whole suite runs in a process per processor, unless ``-n`` says otherwise; a part of it in one.

    Each process takes neighbouring tests (``worksteal``), which share the fixtures of their module.
    """
    option = config.option
    whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS and not hasattr(config, "workerinput")
    if whole and getattr(option, "numprocesses", 0) is None:  # a process of the run comes here, too
        option.numprocesses, option.maxprocesses, option.dist = "logical", 8, "worksteal"


@pytest.fixture(autouse=True)
def every_finding_has_its_words(request, monkeypatch):
    """Refuse findings of this version that have no words; only what is read from a file of another one may have
    none (`stored`).
    """
    if request.node.get_closest_marker("stored") is None:
        monkeypatch.setattr(findings, "_unworded", _refuse)


def _refuse(finding):
    pytest.fail(f"{finding.code!r} has no sentence for the values {dict(finding.values)}")


@pytest.fixture
def rng(request):
    """A generator of the test's own: adding or reordering tests changes no other test's numbers."""
    return np.random.default_rng([SEED, zlib.crc32(request.node.nodeid.encode())])
