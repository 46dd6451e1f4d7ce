"""Options of the priors of X and W."""

from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import InputError
from .values import by_names

if TYPE_CHECKING:
    from ..model.rig.description import Rig


class PosePriors(NamedTuple):
    """Priors of X and W as they are given.

    Options (Prior knowledge):
      --prior-x FILE: Prior of X: YAML or JSON with pose and covariance, or the result.json of an earlier run.
      --prior-w FILE: Prior of the target pose W, likewise.
      --known TEXT: Measured coordinate of camera or target, e.g. 'target z = 120mm +- 1mm'. Repeatable.
    """

    prior_x: str | None = None
    prior_w: str | None = None
    known: list[str] | None = None

    def options(self) -> dict[str, Any]:
        """Return the priors of X and W as arguments of `calibrate`."""
        from ..model.errors.known_values import parse_known_values as known_values
        from ..read import read_prior

        found: dict[str, Any] = dict(known_values(*self.known)) if self.known else {}
        for path, name, of in ((self.prior_x, "prior_X", "X"), (self.prior_w, "prior_W", "W")):
            if path is None:
                continue
            if name in found:
                raise InputError(f"--prior-{of.lower()} and --known describe the same pose. Give one of them.")
            found[name] = read_prior(Path(path), of)
        return found

    def of_rig(self, rig: "Rig") -> "Rig":
        """Return a rig with these priors of its cameras and targets by name; one of all only where there is one."""
        from ..model.errors.known_values import parse_known_values as known_values
        from ..read import read_prior

        found: dict[str, Any] = {}
        sides = ((list(rig.cameras), self.prior_x, "X"), (list(rig.targets), self.prior_w, "W"))
        for names, text, of in sides:
            for name, file in by_names(text, names, f"--prior-{of.lower()}").items():
                if not name and len(names) > 1:
                    raise InputError(f"--prior-{of.lower()}: which of {', '.join(names)}? Write {names[0]}:{file}.")
                found[name or names[0]] = read_prior(Path(file), of)
        statements: dict[str, list[str]] = defaultdict(list)
        for text in self.known or ():
            name, _, rest = text.strip().partition(" ")
            statements[name].append(rest)
        for name, rests in statements.items():
            what, one = name, name
            for kind, listed in (("camera", list(rig.cameras)), ("target", list(rig.targets))):
                if name in listed:
                    what = kind
                elif name == kind:
                    if len(listed) > 1:
                        raise InputError(f"--known '{name} {rests[0]}': which of {', '.join(listed)}? Name it.")
                    one = listed[0]
            if one in found:
                raise InputError(f"--known and a prior describe the pose of {one!r}. Give one of them.")
            found[one] = next(iter(known_values(*(f"{what} {rest}" for rest in rests)).values()))
        if twice := [name for name in found if name in (rig.known or {})]:
            raise InputError(f"The pose of {twice[0]!r} is known in the rig file and among the options. Remove one.")
        return replace(rig, known={**(rig.known or {}), **found}) if found else rig


def pose_prior_of(priors: PosePriors) -> "dict[str, Any]":
    """Return the priors of X and W as arguments of `calibrate`."""
    return priors.options()
