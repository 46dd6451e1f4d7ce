"""Data and helpers of the tests of comparisons."""

import uq_handeye as uq


def compare(data, **options):
    """The published methods against 4dpa, which sees the same pairs as the others."""
    return uq.compare(data, **{"methods": list(uq.METHODS), "reference": "4dpa"} | options)
