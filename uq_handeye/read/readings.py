"""Choice of the reading of rotations where a file allows several: the one with which robot and camera agree.

Both sides see the same motions. So with the right reading one X explains the poses, and with a wrong one the target
seems to move by many degrees. A reading is taken only if it fits far better than every other. The same comparison names
the correct order of Euler angles where the one in use does not fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from pathlib import PurePath
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array, inverse
from ..core.numbers.limits import MAX_LISTED, MIN_POSES_TO_DECIDE
from ..core.numbers.rounding import CHAIN_ROUNDING
from ..errors import InputError
from ..findings import Finding, warn
from ..fit.input_checks.consistency import LARGE_ROTATION_RAD, MAX_MISFIT_SHARE, consistency
from ..formats.contents import FRAMES, Reading, Side, doubtful, finished, rows_of_side
from ..formats.rotations import SEQUENCES, VECTORS, rotation_form
from ..model.poses.residuals import rotation_angles

# A reading is taken if the rotations of every other fit worse by this factor, or are the same and the translations do.
DECISIVE_RATIO = 5.0

Rows = NDArray[np.intp] | slice
# RMS rotation (rad) and translation (m) of the target about its mean, and |t_X| (m).
Misfit: TypeAlias = tuple[float, float, float]
# A reading of each side; None stands for one that is decided already.
ReadingPair: TypeAlias = tuple[Reading | None, ...]
# The readings that each side may have.
Readings: TypeAlias = tuple[ReadingPair, ...]


@dataclass(frozen=True)
class Chosen:
    """Both sides with one reading each, notes on them, and findings."""

    sides: list[Side]
    notes: tuple[str, str]
    findings: tuple[Finding, ...] = ()


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
        Several readings between which the poses do not decide; if another form fits by far, the error names it.

    Warns
    -----
    InputWarning
        The rotations of one side do not agree with those of the other, and would in another order of the angles.
    """
    of = [np.arange(len(side))[one] for side, one in zip(sides, rows, strict=True)]
    pair = _Pair(tuple(sides), tuple(units), tuple(forms), tuple(frames), (of[0], of[1]), setup)
    # The readings of each side that are open.
    choices = [_open(side, form) for side, form in zip(sides, forms, strict=True)]
    chosen = pair.thinned().of_choices(tuple(first for first, _ in choices), tuple(every for _, every in choices))
    warn(chosen.findings, 3)
    readings = (side.readings for side in chosen.sides)  # of some of the poses
    return replace(chosen, sides=[replace(side, readings=of) for side, of in zip(sides, readings, strict=True)])


def _open(side: Side, form: str | None) -> tuple[tuple[Reading | None, ...], tuple[Reading | None, ...]]:
    """Return the readings between which the poses have to decide, and the same with those that are tried last."""
    readings, others = (
        tuple(one for one in found if form in (None, one.rotation)) for found in (side.readings, side.others)
    )
    first: tuple[Reading | None, ...] = readings if form is None and len(readings) > 1 else (None,)
    return first, (*(readings or (None,)), *others) if others else first


def reading_of_robot(
    side: Side, camera: Array, rows: NDArray[np.intp], units: str | None, form: str | None, frame: str, setup: str
) -> Chosen:
    """Return the robot's side with one reading, by known poses of the camera (n, 4, 4), and notes and findings."""
    seen = Side("the camera", camera[:, :3, 3], camera[:, :3, :3])
    return chosen_readings(
        (side, seen), (units, "m"), (form, None), (frame, FRAMES["camera"][0]), (rows, slice(None)), setup
    )


@dataclass(frozen=True)
class _Pair:
    sides: tuple[Side, ...]
    units: tuple[str | None, ...]
    forms: tuple[str | None, ...]
    frames: tuple[str, ...]
    rows: tuple[NDArray[np.intp], NDArray[np.intp]]
    setup: str

    def of_choices(self, first: Readings, every: Readings) -> Chosen:
        """Return the sides with one of the ``first`` readings, or of ``every`` one where none of the first agrees.

        Where a form is given, and nothing else is open, ``every`` reading of this form is compared at once.
        """
        if first != every and all(readings == (None,) for readings in first):  # the form is given, its place is not
            with suppress(InputError):
                return self.chosen(every)
        try:
            return self.chosen(first)
        except InputError:
            if first == every:
                raise
            with suppress(InputError):
                return self.chosen(every)
            raise

    def chosen(self, open_readings: Readings) -> Chosen:
        if all(readings == (None,) for readings in open_readings):
            found = self._another_form()
            return Chosen(list(self.sides), ("", ""), () if found is None else (found,))
        fits = []
        for pair_of_setup in (self, self._of_other_setup()):  # `calibrate` names the setup where it is the other one
            tried = [(pair_of_setup.fit(pair), pair) for pair in product(*open_readings)]
            fits = [(fit, pair) for fit, pair in tried if fit is not None]
            fits.sort(key=lambda found: found[0][:2])
            if fits and (best := self._decided(fits)) is not None:
                # Rotations about x, y, z renamed in a circle agree as well; only the translations tell.
                far = next(fit[1] for fit, pair in fits if pair == best) > MAX_MISFIT_SHARE * self._travel(best)
                if far and (error := self._unlisted(open_readings)) is not None:
                    raise error
                sides = [
                    side if reading is None else replace(side, readings=(reading,))
                    for side, reading in zip(self.sides, best, strict=True)
                ]
                notes = ["" if reading is None else self._note(k, reading, fits) for k, reading in enumerate(best)]
                return Chosen(sides, (notes[0], notes[1]))
        raise self._undecided(open_readings)

    def _undecided(self, open_readings: Readings) -> InputError:
        """Return the error that no reading is taken, with the form by which robot and camera would agree if one is."""
        k = next(k for k, readings in enumerate(open_readings) if readings != (None,))
        side, role = self.sides[k], tuple(FRAMES)[k]
        n, m = map(len, self.rows)
        if n != m:
            files = " and ".join(
                f"{count} poses in {side.name}" for count, side in zip((n, m), self.sides, strict=True)
            )
            return doubtful(side, role, f", and {files} do not decide: one row per moment is expected in each file")
        if n < MIN_POSES_TO_DECIDE or not all(map(self._disagrees, product(*open_readings))):
            return doubtful(side, role, ", and the poses do not decide")
        why = ", and with none of these robot and camera agree (do the rows of the two files belong together?)"
        return self._unlisted(open_readings) or doubtful(side, role, why)

    def _unlisted(self, open_readings: Readings) -> InputError | None:
        """Return the error that no reading of a file fits but another form does, if one does."""
        k = next(k for k, readings in enumerate(open_readings) if readings != (None,))
        names = ", ".join(map(str, self.sides[k].readings))
        for other, role in enumerate(FRAMES):
            if found := self._form_that_fits(other, open_readings):
                form, unit, _ = found
                units = "" if unit is None else f" --units {role}={unit}"
                whose = "" if other == k else f"of {self.sides[other].name} "
                return InputError(
                    f"{self.sides[k].name}: the rotations may be {names}, and with none of these robot and camera "
                    f"agree; with rotations {whose}as {form} they agree. Give --rotation "
                    f"{role}={form}{units} (docs/how-to/controller.md)."
                )
        return None

    def _disagrees(self, pair: ReadingPair) -> bool:
        """Return whether the rotations of robot and camera disagree, in both setups."""
        fits = (self.fit(pair), self._of_other_setup().fit(pair))
        return all(fit is None or fit[0] > LARGE_ROTATION_RAD for fit in fits)

    def _of_other_setup(self) -> _Pair:
        return replace(self, setup="eye-to-hand" if self.setup == "eye-in-hand" else "eye-in-hand")

    def _decided(self, fits: list[tuple[Misfit, ReadingPair]]) -> ReadingPair | None:
        """The readings that fit far better than all others, if any do.

        Two files in the same wrong order agree in rotation, so translations decide as well.
        """
        if len(self.rows[0]) < MIN_POSES_TO_DECIDE:
            return None
        for (angle, distance, _), pair in fits:
            if angle > LARGE_ROTATION_RAD:
                continue
            least = max(angle, CHAIN_ROUNDING)
            if all(
                other_angle > DECISIVE_RATIO * least
                or (
                    other_distance > DECISIVE_RATIO * distance
                    and angle < DECISIVE_RATIO * max(other_angle, CHAIN_ROUNDING)
                )
                or self._same(pair, other)
                for (other_angle, other_distance, _), other in fits
            ):
                return pair
        return None

    def _same(self, first: ReadingPair, second: ReadingPair) -> bool:
        """Return whether two pairs of readings give the same poses."""
        pairs = zip(self.poses(first), self.poses(second), strict=True)
        return all(np.abs(a - b).max() < CHAIN_ROUNDING for a, b in pairs)

    def _note(self, k: int, reading: Reading, fits: list[tuple[Misfit, ReadingPair]]) -> str:
        worse = [f"{pair[k]}" for _, pair in fits if pair[k] != reading]
        names = list(dict.fromkeys(worse))
        more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
        others = ", ".join(names[:MAX_LISTED]) + more
        return f"rotations read as {reading}, with which robot and camera agree; with {others} they do not"

    def fit(self, pair: ReadingPair) -> Misfit | None:
        """Return the RMS rotation and translation of the target about its mean, and |t_X|; None: no X at all."""
        G, C = self.poses(pair)
        if len(G) < 3 or len(G) != len(C):
            return None
        return consistency(G if self.setup == "eye-in-hand" else inverse(G), C)

    def thinned(self, most: int = 200) -> _Pair:
        """Return about ``most`` of many poses, evenly: one reading holds for all poses of a file."""
        n, m = map(len, self.rows)
        if n != m or n < 2 * most:
            return self
        sides = tuple(
            replace(rows_of_side(side, of[:: n // most]), timestamps=None, numbers=())
            for side, of in zip(self.sides, self.rows, strict=True)
        )
        every = np.arange(len(sides[0]))
        return replace(self, sides=sides, rows=(every, every))

    def poses(self, pair: ReadingPair) -> tuple[Array, Array]:
        """Return both sides as matrices, under the readings of a pair."""
        G, C = (
            finished(side if reading is None else replace(side, readings=(reading,)), role, unit, form, frame)[rows]
            for side, reading, role, unit, form, frame, rows in zip(
                self.sides, pair, FRAMES, self.units, self.forms, self.frames, self.rows, strict=True
            )
        )
        return G, C

    def _another_form(self) -> Finding | None:
        """Return a finding if angles or rotation vectors are of another order or unit by far."""
        angles = [side.rotation.ndim == 2 and side.rotation.shape[1] == 3 for side in self.sides]
        if not any(angles) or len(self.rows[0]) < MIN_POSES_TO_DECIDE:
            return None
        decided: ReadingPair = (None, None)
        now = self.fit(decided)
        for fit in (now, self._of_other_setup().fit(decided)):
            if fit is not None and fit[0] <= LARGE_ROTATION_RAD and fit[1] <= MAX_MISFIT_SHARE * self._travel(decided):
                return None
        for k, role in enumerate(FRAMES):
            side = self.sides[k]
            found = self._form_that_fits(k, ((None,), (None,)))
            if found is not None and (now is None or now[1] > DECISIVE_RATIO * found[2]):
                values = {
                    "name": PurePath(side.name).name,
                    "side": role,
                    "used": self.forms[k] or side.readings[0].rotation,
                    "form": found[0],
                    "rotation": None if now is None else now[0],
                    "translation": None if now is None else now[1],
                }
                return Finding("poses.another_rotation", "failure", values)
        return None

    def _form_that_fits(self, k: int, open_readings: Readings) -> tuple[str, str | None, float] | None:
        """Return the form of the three numbers of one side that fits best, its length unit where that is open, and the
        distance; None if none does. The setup may be the other.
        """
        side = self.sides[k]
        if side.rotation.ndim != 2 or side.rotation.shape[1] != 3:
            return None
        found = []
        units = {reading.units for reading in side.readings} if self.units[k] is None else {self.units[k]}
        for form, unit, other in product(_other_forms(side, self.forms[k]), units, open_readings[1 - k]):
            forms, both = list(self.forms), list(self.units)
            forms[k], both[k] = form, unit
            trial = replace(self, forms=tuple(forms), units=tuple(both))
            pair = (None, other) if k == 0 else (other, None)
            if not trial._turns_alike(pair):
                continue
            for setup in (trial, trial._of_other_setup()):
                fit = setup.fit(pair)
                # Rotations about x, y, z renamed in a circle fit as well; only the translations tell.
                if fit is not None and fit[0] < LARGE_ROTATION_RAD and fit[1] < MAX_MISFIT_SHARE * trial._travel(pair):
                    found.append((form, unit if len(units) > 1 else None, fit[1]))
        return min(found, key=lambda one: one[2], default=None)

    def _turns_alike(self, pair: ReadingPair) -> bool:
        """Return whether robot and camera rotate by the same angles from each pose to the next, whatever the setup."""
        G, C = (T[:, :3, :3] for T in self.poses(pair))
        if len(G) < 3 or len(G) != len(C):
            return False
        difference = rotation_angles(G[:-1].mT @ G[1:]) - rotation_angles(C[:-1].mT @ C[1:])
        return bool(np.sqrt(np.mean(difference**2)) < 2.0 * LARGE_ROTATION_RAD)

    def _travel(self, pair: ReadingPair) -> float:
        """Return the standard deviation of the robot's position."""
        return float(np.linalg.norm(np.std(self.poses(pair)[0][:, :3, 3], axis=0)))


def _other_forms(side: Side, form: str | None) -> list[str]:
    """All forms of three numbers but those in use; angles beyond a turn can only be degrees."""
    used = {reading.rotation for reading in side.readings} if form is None else {form}
    units = ("deg",) if np.abs(side.rotation).max() > 2.0 * np.pi else ("deg", "rad")
    forms = [f"{sequence}-{unit}" for unit in units for sequence in SEQUENCES]
    forms += [vector for vector in VECTORS if vector[-3:] in units]
    return [text for text in forms if text not in used and rotation_form(text).numbers == 3]
