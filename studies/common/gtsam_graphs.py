"""GTSAM's factor graphs of the tests, for the studies that compare with them."""

from __future__ import annotations

import importlib
import sys
from functools import cache
from pathlib import Path
from typing import Any


@cache
def gtsam_graphs() -> Any:
    """The module ``tests/fixtures/gtsam_graphs.py``; GTSAM must be installed."""
    folder = str(Path(__file__).resolve().parents[2] / "tests")
    if folder not in sys.path:
        sys.path.insert(0, folder)
    return importlib.import_module("fixtures.gtsam_graphs")
