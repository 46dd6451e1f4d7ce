"""Options of the priors of X and W."""

from pathlib import Path
from typing import Any

from ..errors import InputError


def pose_prior_of(
    prior_x: Path | None = None, prior_w: Path | None = None, known: list[str] | None = None
) -> "dict[str, Any]":
    """Return the priors of X and W as arguments of `calibrate`.

    Options (Prior knowledge):
      --prior-x FILE: Prior of X: YAML or JSON with pose and covariance, or the result.json of an earlier run.
      --prior-w FILE: Prior of the target pose W, likewise.
      --known TEXT: Measured coordinate of camera or target, e.g. 'target z = 120mm +- 1mm'. Repeatable.
    """
    from ..model.noise.known_values import parse_known_values as known_values
    from ..read import read_prior

    found: dict[str, Any] = dict(known_values(*known)) if known else {}
    for path, name, of in ((prior_x, "prior_X", "X"), (prior_w, "prior_W", "W")):
        if path is None:
            continue
        if name in found:
            raise InputError(f"--prior-{of.lower()} and --known describe the same pose. Give one of them.")
        found[name] = read_prior(path, of)
    return found
