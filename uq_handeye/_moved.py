"""Earlier places of packages, which keep working with a warning: ``uq_handeye.io`` is now ``uq_handeye.read``."""

from __future__ import annotations

import sys
import warnings
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

# The folder of packages that each now stands in.
_FOLDERS = {
    "core": "runtime geometry files formatting presentation",
    "formats": "export",
    "model": "noise poses kinematics shared_errors posterior camera points",
    "methods": "_closed_form procrustes estimators propagation",
    "fit": "likelihood one_model diagnostics input_checks empirical_covariance",
    "read": "synchronisation rosbag",
    "trials": "simulation validation",
    "calibration": "prediction evidence statement",
    "report": "certificate comparison",
    "use": "planning maintenance verification live_session",
}
PLACES = {name: f"{folder}.{name}" for folder, names in _FOLDERS.items() for name in names.split()} | {"io": "read"}


class Finder:
    """Imports a module by its earlier name as the same module, not as a second one."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        package, _, inner = name.partition(".")
        first, dot, rest = inner.partition(".")
        if package != __package__ or first not in PLACES:
            return None
        loader: Any = self
        return ModuleSpec(name, loader, origin=f"{package}.{PLACES[first]}{dot}{rest}")

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        warnings.warn(f"{spec.name} is now {spec.origin}.", DeprecationWarning, stacklevel=2)
        module = import_module(str(spec.origin))
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        if module.__spec__ is not None:
            module.__spec__ = module.__spec__.loader_state  # that of its own name


def install() -> None:
    """Let the earlier names be imported."""
    sys.meta_path.insert(0, Finder())  # before the files that a moved package is found to have
