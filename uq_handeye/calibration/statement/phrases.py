"""Each finding in a short phrase, the check that it belongs to, and how far it may put X off.

A phrase has at most about 55 characters and no full stop; ``str(finding)`` is the whole sentence. The effect is by how
many of its stated standard deviations X may be off, or how many times too small these may be, as far as the finding
says: 1 where the covariance contains it, infinite where X cannot be used. It only orders findings.
"""

from __future__ import annotations

import math

from ...findings import Finding, record_of


def check_of(finding: Finding) -> str:
    """Return the name of the check that a finding belongs to."""
    return record_of(finding).check


def phrase(finding: Finding) -> str:
    """Return the finding in a short phrase; its code in words where there is none."""
    return record_of(finding).phrase_of(finding) or finding.code.rpartition(".")[2].replace("_", " ")


def effect(finding: Finding) -> float:
    """Return by how many of its standard deviations X may be off, as far as the finding says."""
    return math.inf if finding.severity == "failure" else record_of(finding).effect_of(finding)


def rejects(finding: Finding) -> bool:
    """Return whether a finding says that the covariance of X is too small: a test that failed."""
    if finding.severity == "note":
        return False
    return finding.severity == "failure" or (record_of(finding).rejects and effect(finding) > 1.1)
