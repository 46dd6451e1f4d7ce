"""Types of the values of a JSON or YAML file: numbers, text, booleans, null, and lists and objects of these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

Json: TypeAlias = Mapping[str, "Json"] | Sequence["Json"] | str | float | None
JsonObject: TypeAlias = dict[str, Json]
