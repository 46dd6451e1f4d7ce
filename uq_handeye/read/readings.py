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
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array, inverse
from ..core.limits import MAJORITY, MIN_POSES_TO_DECIDE
from ..core.presentation.numbers import digits
from ..core.rounding import CHAIN_ROUNDING
from ..errors import InputError
from ..findings import Finding, warn
from ..fit.diagnostics.agreement import Agreement, agreement, angles_between, typical_difference
from ..fit.diagnostics.consistency import LARGE_ROTATION_RAD, MAX_MISFIT_SHARE
from ..fit.diagnostics.repeated_rows import SAME_NUMBER
from ..formats.contents import FRAMES, Reading, Side, doubtful, finished, rows_of_side
from ..formats.rotations import SEQUENCES, VECTORS, rotation_form

# A reading is taken if the rotations of every other fit worse by this factor, or are the same and the translations do.
DECISIVE_RATIO = 5.0
# Where robot and camera agree but for rotations of this size, other orders of the angles are tried, and one is named
# whose rotations fit better by this factor.
NOISY_ROTATION_RAD, FAR_BETTER_RATIO = np.radians(0.2), 8.0
# Two readings that differ in the scale by more than this factor (log) are of different units.
UNIT_LOG_RATIO = np.log(5.0)

Rows = NDArray[np.intp] | slice
# A reading of each side; None stands for one that is decided already.
ReadingPair: TypeAlias = tuple[Reading | None, ...]
# A pair of readings with the agreement of robot and camera.
Fit: TypeAlias = tuple[Agreement, ReadingPair]
# The readings that each side may have.
Readings: TypeAlias = tuple[ReadingPair, ...]


class Chosen(NamedTuple):
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
    return chosen._replace(sides=[replace(side, readings=of) for side, of in zip(sides, readings, strict=True)])


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
        self._require_motion(open_readings)
        here, there = self._fits(open_readings), self._of_other_setup()._fits(open_readings)
        for fits in (here + there, here):  # `calibrate` names the setup where it is the other one
            fits = sorted(fits, key=lambda found: found[0][:2])
            if (best := self._decided(fits)) is not None:
                # Rotations about x, y, z renamed in a circle agree as well; only the translations tell.
                far = next(fit.distance for fit, pair in fits if pair == best) > MAX_MISFIT_SHARE * self._travel(best)
                if far and (error := self._unlisted(open_readings)) is not None:
                    raise error
                sides = [
                    side if reading is None else replace(side, readings=(reading,))
                    for side, reading in zip(self.sides, best, strict=True)
                ]
                notes = ["" if reading is None else _note(k, reading, best, fits) for k, reading in enumerate(best)]
                return Chosen(sides, (notes[0], notes[1]))
        raise self._undecided(open_readings)

    def _require_motion(self, open_readings: Readings) -> None:
        """Raise `InputError` where the poses of one side are all the same: they decide nothing."""
        for side, rows, readings in zip(self.sides, self.rows, open_readings, strict=True):
            numbers = np.column_stack([side.translation, side.rotation.reshape(len(side), -1)])[rows]
            if readings != (None,) and len(rows) > 1 and np.ptp(numbers, axis=0).max() < SAME_NUMBER:
                raise InputError(
                    f"{side.name}: all {len(rows)} poses are the same. Either nothing moved, or one pose was written "
                    "again and again. Move the robot between the poses, and check how the file was written."
                )

    def _fits(self, open_readings: Readings) -> list[Fit]:
        """Return the agreement of each pair of readings under which robot and camera rotate by the same angles."""
        if len(self.rows[0]) != len(self.rows[1]) or len(self.rows[0]) < 3:
            return []
        poses = [{one: self._side(k, one) for one in readings} for k, readings in enumerate(open_readings)]
        angles = [{one: angles_between(T[:, :3, :3]) for one, T in of.items()} for of in poses]
        found = []
        for pair in product(*open_readings):
            difference = typical_difference(*(of[one] for of, one in zip(angles, pair, strict=True)))
            if difference > 2.0 * LARGE_ROTATION_RAD:
                found.append((Agreement(difference, np.inf, np.inf, 1.0, 0.0), pair))
                continue
            G, C = (of[one] for of, one in zip(poses, pair, strict=True))
            fit = agreement(G if self.setup == "eye-in-hand" else inverse(G), C)
            if fit is not None:
                found.append((fit, pair))
        return found

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
        return all(fit is None or fit.angle > LARGE_ROTATION_RAD for fit in fits)

    def _of_other_setup(self) -> _Pair:
        return replace(self, setup="eye-to-hand" if self.setup == "eye-in-hand" else "eye-in-hand")

    def _decided(self, fits: list[Fit]) -> ReadingPair | None:
        """The readings that fit far better than all others, if any do.

        Two files in the same wrong order agree in rotation, so translations decide as well. The unit of a file changes
        nothing but the scale, which is then near 1 for one of the readings alone. The scale does not speak against a
        reading that fits far better: of a file in a unit that none of them has, it is off for the right one.
        """
        if len(self.rows[0]) < MIN_POSES_TO_DECIDE:
            return None
        travel = {pair: max(self._travel(pair), CHAIN_ROUNDING) for _, pair in fits}
        for fit, pair in fits:
            if fit.angle > LARGE_ROTATION_RAD or fit.share < MAJORITY:
                continue
            least, distance = max(fit.angle, CHAIN_ROUNDING), fit.distance / travel[pair]
            if all(
                other == pair
                or other_fit.angle > DECISIVE_RATIO * least
                or (
                    other_fit.distance / travel[other] > DECISIVE_RATIO * distance
                    and fit.angle < DECISIVE_RATIO * max(other_fit.angle, CHAIN_ROUNDING)
                )
                or (
                    abs(np.log(other_fit.scale)) > UNIT_LOG_RATIO + abs(np.log(fit.scale))
                    and distance < DECISIVE_RATIO * max(other_fit.distance / travel[other], CHAIN_ROUNDING)
                )
                or self._same(pair, other)
                for other_fit, other in fits
            ):
                return pair
        return None

    def _same(self, first: ReadingPair, second: ReadingPair) -> bool:
        """Return whether two pairs of readings give the same poses."""
        pairs = zip(self.poses(first), self.poses(second), strict=True)
        return all(np.abs(a - b).max() < CHAIN_ROUNDING for a, b in pairs)

    def fit(self, pair: ReadingPair) -> Agreement | None:
        """Return the agreement of robot and camera under a pair of readings; None: no X at all."""
        G, C = self.poses(pair)
        if len(G) < 3 or len(G) != len(C):
            return None
        return agreement(G if self.setup == "eye-in-hand" else inverse(G), C)

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
        return self._side(0, pair[0]), self._side(1, pair[1])

    def _side(self, k: int, reading: Reading | None) -> Array:
        """Return the poses of one side as matrices, under one reading."""
        side = self.sides[k] if reading is None else replace(self.sides[k], readings=(reading,))
        role = tuple(FRAMES)[k]
        return finished(side, role, self.units[k], self.forms[k], self.frames[k])[self.rows[k]]

    def _another_form(self) -> Finding | None:
        """Return a finding if angles or rotation vectors are of another order or unit by far."""
        angles = [side.rotation.ndim == 2 and side.rotation.shape[1] == 3 for side in self.sides]
        if not any(angles) or len(self.rows[0]) < MIN_POSES_TO_DECIDE:
            return None
        decided: ReadingPair = (None, None)
        now = self.fit(decided)
        fits_well: Agreement | None = None
        for fit in (now, self._of_other_setup().fit(decided)):
            if fit is not None and self._fits_well(fit, decided):
                if fit.angle < NOISY_ROTATION_RAD:
                    return None
                fits_well = fit
                break
        for k, role in enumerate(FRAMES):
            side = self.sides[k]
            found = self._form_that_fits(k, ((None,), (None,)))
            if found is None:
                continue
            if fits_well is None:
                better = now is None or now.distance > DECISIVE_RATIO * found[2].distance
            else:
                better = fits_well.angle > FAR_BETTER_RATIO * found[2].angle and fits_well.distance > found[2].distance
            if better:
                values = {
                    "name": PurePath(side.name).name,
                    "side": role,
                    "used": self.forms[k] or side.readings[0].rotation,
                    "form": found[0],
                    "rotation": None if now is None else now.angle,
                    "translation": None if now is None else now.distance,
                }
                return Finding("poses.another_rotation", "failure", values)
        return None

    def _form_that_fits(self, k: int, open_readings: Readings) -> tuple[str, str | None, Agreement] | None:
        """Return the form of the three numbers of one side that fits best, its length unit where that is open, and its
        agreement; None if none does. The setup may be the other.
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
                if fit is not None and trial._fits_well(fit, pair):
                    found.append((form, unit if len(units) > 1 else None, fit))
        return min(found, key=lambda one: one[2].distance, default=None)

    def _turns_alike(self, pair: ReadingPair) -> bool:
        """Return whether robot and camera rotate by the same angles from each pose to the next, whatever the setup."""
        G, C = (T[:, :3, :3] for T in self.poses(pair))
        if len(G) < 3 or len(G) != len(C):
            return False
        return bool(typical_difference(angles_between(G), angles_between(C)) < 2.0 * LARGE_ROTATION_RAD)

    def _fits_well(self, fit: Agreement, pair: ReadingPair) -> bool:
        """Return whether most poses agree in rotation and, with the scale free, in translation."""
        return bool(
            fit.angle <= LARGE_ROTATION_RAD
            and fit.share >= MAJORITY
            and fit.distance <= MAX_MISFIT_SHARE * self._travel(pair)
        )

    def _travel(self, pair: ReadingPair) -> float:
        """Return the standard deviation of the robot's position."""
        return float(np.linalg.norm(np.std(self.poses(pair)[0][:, :3, 3], axis=0)))


def _note(k: int, reading: Reading, taken: ReadingPair, fits: list[Fit]) -> str:
    """Return what was decided of one side, and which other reading comes nearest."""
    best = next(fit for fit, pair in fits if pair == taken)
    others = [(fit, pair[k]) for fit, pair in fits if pair[k] != reading and str(pair[k]) != str(reading)]
    said = f"rotations read as {reading}, with which robot and camera agree ({_size(best)})"
    if not others:
        return said
    nearest, other = min(others, key=lambda one: (one[0].angle > LARGE_ROTATION_RAD, one[0].distance, one[0].angle))
    return f"{said}; next best {other} ({_size(nearest)})"


def _size(fit: Agreement) -> str:
    """Return a misfit in words."""
    angle = f"{digits(np.degrees(fit.angle), 2)} deg"
    return angle if not np.isfinite(fit.distance) else f"{angle}, {digits(1e3 * fit.distance, 2)} mm"


def _other_forms(side: Side, form: str | None) -> list[str]:
    """All forms of three numbers but those in use; angles beyond a turn can only be degrees."""
    used = {reading.rotation for reading in side.readings} if form is None else {form}
    units = ("deg",) if np.abs(side.rotation).max() > 2.0 * np.pi else ("deg", "rad")
    forms = [f"{sequence}-{unit}" for unit in units for sequence in SEQUENCES]
    forms += [vector for vector in VECTORS if vector[-3:] in units]
    return [text for text in forms if text not in used and rotation_form(text).numbers == 3]
