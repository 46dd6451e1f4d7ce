"""Cases that several tests of one study share."""

import importlib
from functools import cache


@cache
def quick_tables(name):
    """Return the tables of the quick size of ``studies.NAME``, measured once."""
    return importlib.import_module(f"studies.{name}").STUDY.measure(False)
