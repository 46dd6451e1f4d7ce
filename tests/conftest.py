"""`support` made importable (pytest runs with --import-mode=importlib), and one seeded generator per test."""

import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from support import SEED


@pytest.fixture
def rng(request):
    """A generator of the test's own: adding or reordering tests changes no other test's numbers."""
    return np.random.default_rng([SEED, zlib.crc32(request.node.nodeid.encode())])
