"""One BLAS thread per process, `support` made importable (--import-mode=importlib), one seeded generator per test."""

import gc
import os
import platform
import re
import struct
import sys
import zlib
from pathlib import Path

for variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):  # before NumPy is loaded
    os.environ.setdefault(variable, "1")
# One set of kernels on every x86-64 processor with AVX2: printed outputs are compared, and estimated sizes amplify the
# rounding in which the kernels differ.
if platform.machine() in ("x86_64", "AMD64"):
    os.environ.setdefault("OPENBLAS_CORETYPE", "Haswell")
HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
# Processes of the tests keep what they compile of the package: compiling is half the time of a short command.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Processes of the tests run this checkout, too, not one that the Python in use has installed.
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(HERE.parent), os.environ.get("PYTHONPATH"))))

import numpy as np  # noqa: E402
import pytest  # noqa: E402
import support  # noqa: E402
from support import SEED  # noqa: E402

from uq_handeye import findings  # noqa: E402

# Collection makes objects that all live until the end: looking for garbage among them is a third of its time.
gc.disable()

# Markers of the tests that plain `pytest` leaves out (pyproject.toml).
LEFT_OUT = "slow|statistical|docs|browser|toolchain|opencv4"
WHOLE_FILE = re.compile(rf"^pytestmark = .*\bmark\.({LEFT_OUT})\b", re.MULTILINE)


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """The suite runs in a process per processor, unless ``-n`` says otherwise; a part of it in one, and a file that is
    named runs whole, not only its fast tests.

    Each process takes neighbouring tests (``worksteal``), which share the fixtures of their module.
    """
    option = config.option
    support.DEMANDED = set(re.findall(LEFT_OUT, option.markexpr)) - set(re.findall(r"not (\w+)", option.markexpr))
    if hasattr(config, "workerinput"):  # a process of the run comes here, too
        return
    whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    if whole and getattr(option, "numprocesses", 0) is None:
        option.numprocesses, option.maxprocesses, option.dist = "logical", 8, "worksteal"
    if not whole and option.markexpr == support.fast(config) and all(".py" in argument for argument in config.args):
        option.markexpr = ""


def pytest_ignore_collect(collection_path, config):
    """Leave out files that have no test of the expression of ``-m``: to import them all takes half a minute."""
    expression = config.option.markexpr
    if not collection_path.name.startswith("test_"):
        return None
    if expression == support.fast(config):
        return True if WHOLE_FILE.search(collection_path.read_text(encoding="utf-8")) else None
    one_of = rf"({LEFT_OUT})( or ({LEFT_OUT}))*"
    if support.DEMANDED and re.fullmatch(rf"{one_of}|\({one_of}\)( and not ({LEFT_OUT}))*", expression):
        has = re.search(rf"\bmark\.({'|'.join(support.DEMANDED)})\b", collection_path.read_text(encoding="utf-8"))
        return None if has else True
    return None


def pytest_collection_finish():
    """Look for garbage among what the tests make, not among the tests themselves."""
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True)
def every_finding_has_its_words(request, monkeypatch):
    """Refuse findings of this version that have no words; only what is read from a file of another one may have
    none (`stored`).
    """
    if request.node.get_closest_marker("stored") is None:
        monkeypatch.setattr(findings, "_unworded", _refuse)


def _refuse(finding):
    pytest.fail(f"{finding.code!r} has no sentence for the values {dict(finding.values)}")


def _part_of_png(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


PIXEL = b"\x89PNG\r\n\x1a\n" + b"".join(
    _part_of_png(*part)
    for part in (
        (b"IHDR", struct.pack(">2I5B", 1, 1, 8, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(b"\0\xff")),
        (b"IEND", b""),
    )
)
EMPTY = {"svg": b'<svg viewBox="0 0 1 1"></svg>', "png": PIXEL}


@pytest.fixture
def without_rendering(monkeypatch):
    """Make every figure, but leave out what Matplotlib does with it, layout and rendering: most of the time of a
    report. For tests that do not look at the picture.
    """
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    def write(_, file, format=None, **__):
        if isinstance(file, str | os.PathLike):
            Path(file).write_bytes(EMPTY[format or Path(file).suffix[1:]])
        else:
            file.write(EMPTY[format])

    monkeypatch.setattr(Figure, "savefig", write)
    monkeypatch.setattr(Figure, "draw_without_rendering", lambda _: None)
    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", lambda *_: None)


@pytest.fixture
def rng(request):
    """A generator of the test's own: adding or reordering tests changes no other test's numbers."""
    return np.random.default_rng([SEED, zlib.crc32(request.node.nodeid.encode())])
