"""Choice of the reading of rotations where a file leaves several: the one with which robot and camera agree.

Both sides see the same motions. So with the right reading one X explains the poses, and with a wrong one the target
seems to move by many degrees. A reading is taken only if it fits far better than every other. The same comparison names
the order of Euler angles that is meant where the one in use does not fit.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputWarning
from ..formats.contents import FRAMES, Reading, Side, doubtful, finished
from ..formats.rotation_form import SEQUENCES, VECTORS, rotation_form
from ..geometry.se3 import Array, inverse
from ..poses.consistency import LARGE_ROTATION, consistency

# A reading is taken if the rotations of every other fit worse by this factor, or are the same and the translations do.
DECIDED = 5.0
# Rotations (rad) that are the same, whatever they are called.
SAME = 1e-9
# Translations of the target (share of the travel of the robot) below which a reading fits.
FITS = 0.2
# Fewest poses that decide.
FEWEST = 4
# Poses that are looked at.
MOST = 200

Rows = NDArray[np.intp] | slice


@dataclass(frozen=True)
class Chosen:
    """Both sides with one reading each, and what is to be said of them; empty: nothing."""

    sides: list[Side]
    notes: tuple[str, str]


def chosen_readings(
    sides: Sequence[Side],
    units: Sequence[str | None],
    forms: Sequence[str | None],
    frames: Sequence[str],
    rows: tuple[Rows, Rows],
    setup: str,
) -> Chosen:
    """Return the sides with one reading each.

    Parameters
    ----------
    sides : robot and camera
    units, forms, frames : as `finished` takes them, of both
    rows : the poses of each that belong together
    setup : "eye-in-hand" or "eye-to-hand"

    Raises
    ------
    InputError
        Several readings between which the poses do not decide.

    Warns
    -----
    InputWarning
        The rotations of one side do not agree with those of the other, and would in another order of the angles.
    """
    pair = _Pair(tuple(sides), tuple(units), tuple(forms), tuple(frames), rows, setup)
    return pair.chosen(tuple(_of_file(side, form) for side, form in zip(sides, forms, strict=True)))


def reading_beside(
    side: Side,
    camera: Array,
    rows: NDArray[np.intp],
    units: str | None,
    form: str | None,
    frame: str,
    setup: str,
) -> tuple[Side, str]:
    """Return the robot's side with one reading, beside known poses of the camera (n, 4, 4), and what is to be said."""
    seen = Side("the camera", camera[:, :3, 3], camera[:, :3, :3])
    chosen = chosen_readings(
        (side, seen), (units, "m"), (form, None), (frame, FRAMES["camera"][0]), (rows, slice(None)), setup
    )
    return chosen.sides[0], chosen.notes[0]


def _of_file(side: Side, form: str | None) -> tuple[Reading | None, ...]:
    """The readings that are open; None stands for what is decided already."""
    return side.readings if form is None and len(side.readings) > 1 else (None,)


@dataclass(frozen=True)
class _Pair:
    sides: tuple[Side, ...]
    units: tuple[str | None, ...]
    forms: tuple[str | None, ...]
    frames: tuple[str, ...]
    rows: tuple[Rows, Rows]
    setup: str

    def chosen(self, open_readings: tuple[tuple[Reading | None, ...], ...]) -> Chosen:
        if all(readings == (None,) for readings in open_readings):
            self._warn_of_another()
            return Chosen(list(self.sides), ("", ""))
        tried = [(self.fit(pair), pair) for pair in product(*open_readings)]
        fits = [(fit, pair) for fit, pair in tried if fit is not None]
        fits.sort(key=lambda found: found[0][:2])
        if fits and (best := self._decided(fits)) is not None:
            sides = [
                side if reading is None else replace(side, readings=(reading,))
                for side, reading in zip(self.sides, best, strict=True)
            ]
            notes = ["" if reading is None else self._note(k, reading, fits) for k, reading in enumerate(best)]
            return Chosen(sides, (notes[0], notes[1]))
        for k, role in enumerate(FRAMES):
            if open_readings[k] != (None,):
                raise doubtful(self.sides[k], role, ", and the poses do not decide")
        raise AssertionError

    def _decided(self, fits: list[tuple[Any, tuple[Reading | None, ...]]]) -> tuple[Reading | None, ...] | None:
        """The readings that fit far better than all others, if any do.

        Two files in the same wrong order agree in rotation, so translations decide as well.
        """
        if self._n() < FEWEST:
            return None
        for (angle, distance, _), pair in fits:
            if angle > LARGE_ROTATION:
                continue
            least = max(angle, SAME)
            if all(
                other_angle > DECIDED * least
                or (other_distance > DECIDED * distance and angle < DECIDED * max(other_angle, SAME))
                or self._same(pair, other)
                for (other_angle, other_distance, _), other in fits
            ):
                return pair
        return None

    def _same(self, first: tuple[Reading | None, ...], second: tuple[Reading | None, ...]) -> bool:
        """Return whether two pairs of readings give the same poses."""
        pairs = zip(self.poses(first), self.poses(second), strict=True)
        return all(np.abs(a - b).max() < SAME for a, b in pairs)

    def _note(self, k: int, reading: Reading, fits: list[tuple[Any, tuple[Reading | None, ...]]]) -> str:
        worse = [f"{pair[k]}" for _, pair in fits if pair[k] != reading]
        others = ", ".join(dict.fromkeys(worse))
        return f"rotations read as {reading}, with which robot and camera agree; with {others} they do not"

    def fit(self, pair: tuple[Reading | None, ...]) -> tuple[float, float, float] | None:
        """Return the RMS rotation and translation of the target about its mean, and |t_X|; None: no X at all."""
        G, C = self.poses(pair)
        if len(G) < 3 or len(G) != len(C):
            return None
        step = max(1, len(G) // MOST)
        G = G if self.setup == "eye-in-hand" else inverse(G)
        return consistency(G[::step], C[::step])

    def poses(self, pair: tuple[Reading | None, ...]) -> tuple[Array, Array]:
        """Return both sides as matrices, under the readings of a pair."""
        G, C = (
            finished(side if reading is None else replace(side, readings=(reading,)), role, unit, form, frame)[rows]
            for side, reading, role, unit, form, frame, rows in zip(
                self.sides, pair, FRAMES, self.units, self.forms, self.frames, self.rows, strict=True
            )
        )
        return G, C

    def _n(self) -> int:
        rows = self.rows[0]
        return len(self.sides[0]) if isinstance(rows, slice) else len(rows)

    def _warn_of_another(self) -> None:
        """Warn of angles or rotation vectors whose order or unit is another one by far."""
        angles = [side.rotation.ndim == 2 and side.rotation.shape[1] == 3 for side in self.sides]
        if not any(angles) or self._n() < FEWEST:
            return
        now = self.fit((None, None))
        travel = float(np.linalg.norm(np.std(self.poses((None, None))[0][:, :3, 3], axis=0)))
        if now is not None and now[0] <= LARGE_ROTATION and now[1] <= FITS * travel:
            return
        for k, role in enumerate(FRAMES):
            side = self.sides[k]
            if not angles[k]:
                continue
            found = []
            for form in _other_forms(side, self.forms[k]):
                forms = (form, self.forms[1]) if k == 0 else (self.forms[0], form)
                fit = replace(self, forms=forms).fit((None, None))
                if fit is not None and fit[0] < LARGE_ROTATION:
                    found.append((fit[1], fit[0], form))
            if not found:
                continue
            # Rotations about x, y, z renamed in a circle fit as well; only the translations tell.
            distance, _, form = min(found)
            if distance < FITS * travel and (now is None or now[1] > DECIDED * distance):
                used = self.forms[k] or side.readings[0].rotation
                amount = "" if now is None else f" by {np.degrees(now[0]):.2g} degrees and {1e3 * now[1]:.3g} mm RMS"
                warnings.warn(
                    f"{side.name}: with rotations read as {used} robot and camera disagree{amount}; as {form} they "
                    f"agree. Give --{role}-rotation {form} (rotation={form!r}) if that is what the file holds.",
                    InputWarning,
                    stacklevel=5,
                )
                return


def _other_forms(side: Side, form: str | None) -> list[str]:
    """All forms of three numbers but the one in use; angles beyond a turn can only be degrees."""
    used = form or side.readings[0].rotation
    units = ("deg",) if np.abs(side.rotation).max() > 2.0 * np.pi else ("deg", "rad")
    forms = [f"{sequence}-{unit}" for unit in units for sequence in SEQUENCES]
    forms += [vector for vector in VECTORS if vector[-3:] in units]
    return [text for text in forms if text != used and rotation_form(text).numbers == 3]
