"""Types of what a JSON or YAML file holds: numbers, text, true and false, nothing, lists and objects of these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

Json: TypeAlias = Mapping[str, "Json"] | Sequence["Json"] | str | float | None
JsonObject: TypeAlias = dict[str, Json]
