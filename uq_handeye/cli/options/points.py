"""A point as the text of an option."""

import math

from ...errors import InputError


def coordinates(text: str, name: str) -> list[float]:
    """Return the three lengths (m) of an option such as ``0mm,0mm,300mm``."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 3:
        raise InputError(f"Expected {name} to be X,Y,Z such as 0mm,0mm,300mm, got {text!r}.")
    from ...formatting.units import parse_length

    values = []
    for part in parts:
        try:
            values.append(float(part))
        except ValueError:
            values.append(parse_length(part, name))
    if not (far := max(map(abs, values))) <= 10.0 or not all(map(math.isfinite, values)):
        raise InputError(f"{name} {text}: {far:g} m is too far. Write the unit, e.g. 0mm,0mm,300mm.")
    return values
