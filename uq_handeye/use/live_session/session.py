"""State of a session: the poses in its folder, those left out, and the calibration after each change.

The whole state is on disk before it is reported: poses in the files of the folder (those that arrive one by one in
``poses.jsonl``, a line each, matrices to the last bit), the poses left out in `CHOICE`, written whole. A session that
was killed continues with the same folder, and a second program that reads the files gets the same X.
"""

from __future__ import annotations

import json
import os
import threading
import warnings
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ...core.files.atomic import write_atomically, write_files
from ...core.files.json_files import json_text, parsed, signed_text
from ...core.geometry.checks import as_transforms
from ...core.limits import MIN_POSES
from ...errors import InputError, InputWarning, NotConvergedError
from ...model.poses.pose_pairs import PosePairs
from .folder import Folder, SeenBoard, State, settled
from .question import ONE_AT_A_TIME, Answer, Question
from .remedies import How, Remedy

# Poses that came one by one; poses left out, with the steps that can be undone.
OWN, CHOICE = "poses.jsonl", ".uq-handeye-session.json"
MAX_UNDO_STEPS = 100


@dataclass(frozen=True)
class Choice:
    """Poses left out, sorted, and the earlier choices, last one last."""

    left_out: tuple[int, ...] = ()
    earlier: tuple[tuple[int, ...], ...] = ()
    board: str | None = None  # of pictures that were uploaded: `Board.text`
    how: How = field(default_factory=dict)  # arguments of `read_poses` that were chosen on the page

    def changed(self, left_out: tuple[int, ...]) -> Choice:
        """Return the choice after one more step."""
        return replace(self, left_out=left_out, earlier=(*self.earlier, self.left_out)[-MAX_UNDO_STEPS:])


class Session:
    """Poses of one folder and the calibration by them; safe to use from several threads.

    Parameters
    ----------
    folder : Folder
        Made if missing.
    question : Question
        What is asked after each change.
    deliver : callable or None
        Writes result and report of the last answer, and returns their folder.
    """

    def __init__(
        self, folder: Folder, question: Question | None = None, deliver: Callable[[Answer], Path] | None = None
    ) -> None:
        self.folder, self.question, self._deliver = folder, question or Question(), deliver
        self.listeners: list[Callable[[Session], None]] = []
        self.answer = Answer(0, ())
        self.notes: deque[str] = deque(maxlen=3)  # what could not be used
        self.problem = ""  # why the files cannot be read, in one line
        self.computing = False  # the answer is not yet that of the poses and choices
        self._sizes: dict[tuple[int, tuple[int, ...]], float] = {}  # m, by poses and those left out
        self._lock = threading.RLock()
        self._asked: tuple[State, tuple[int, ...], str] | None = None
        self._how = self.folder.how  # without those chosen on the page
        self._mend()
        self.choice = _read_choice(folder.path / CHOICE)
        self.folder = replace(self.folder, how={**self._how, **self.choice.how})
        if self.choice.board is not None:
            self._look_for(self.choice.board)

    # ----------------------------------------------------------------------------------------------------- poses

    def add(self, robot: ArrayLike, camera: ArrayLike, time: float | None = None, *, ask: bool = True) -> Answer:
        """Keep a pair of poses (4, 4), in m, and return the answer that includes it.

        ``robot`` is base_T_gripper and ``camera`` camera_T_target; ``time`` in s. With ``ask=False`` the answer is left
        to a later call. Raises `InputError` for other shapes, or where another program writes the pose files.
        """
        pair = [as_transforms(T, name, stack=False) for T, name in ((robot, "robot"), (camera, "camera"))]
        if any(T.shape != (4, 4) for T in pair):
            raise InputError(f"Expected one pose (4, 4) each, got {pair[0].shape} and {pair[1].shape}.")
        if time is not None and not np.isfinite(time):
            raise InputError(f"Expected `time` to be a number of seconds, got {time!r}.")
        self.require_own()
        line: dict[str, float | list[list[float]]] = {} if time is None else {"timestamp": time}
        line |= {"robot": pair[0].tolist(), "camera": pair[1].tolist()}
        with self._lock:
            file = os.open(self.folder.path / OWN, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
            try:
                os.write(file, (json.dumps(line) + "\n").encode())
                os.fsync(file)
            finally:
                os.close(file)
            return self.update() if ask else self.answer

    def require_own(self) -> None:
        """Raise `InputError` where another program writes the pose files."""
        others = [path.name for path in self.folder.pose_files() if path.name != OWN]
        if others:
            raise InputError(
                f"{self.folder.path} holds {others[0]} of another program, so no pose is added here. Let that program "
                "add it, or start with an empty folder."
            )

    def leave_out(self, *poses: int) -> Answer:
        """Leave poses out, by their numbers from 0."""
        return self._choose(lambda chosen: chosen | set(poses), poses)

    def take_back(self, *poses: int) -> Answer:
        """Take poses back that were left out."""
        return self._choose(lambda chosen: chosen - set(poses), poses)

    def drop_last(self) -> Answer:
        """Leave out the last pose that is not left out."""
        kept = [k for k in range(self.answer.n) if k not in self.choice.left_out]
        if not kept:
            raise InputError("There is no pose to leave out.")
        return self.leave_out(kept[-1])

    def undo(self) -> Answer:
        """Take the last step of leaving out or taking back again."""
        with self._lock:
            if not self.choice.earlier:
                raise InputError("There is no step to undo.")
            self._keep(replace(self.choice, left_out=self.choice.earlier[-1], earlier=self.choice.earlier[:-1]))
            return self.update()

    def remedy(self, chosen: Remedy) -> Answer:
        """Read the files as a remedy says, leave out its poses, and return the answer."""
        with self._lock:
            if chosen.how:
                how = {**self.choice.how, **chosen.how}
                for name, value in chosen.how.items():
                    if isinstance(value, tuple) and (before := self.folder.how.get(name)) is not None:
                        how[name] = tuple(new or old for new, old in zip(value, before, strict=True))
                self._keep(replace(self.choice, how=how))
                self.folder = replace(self.folder, how={**self._how, **how})
            return self.leave_out(*chosen.left_out)

    def read_as_before(self) -> Answer:
        """Read the files as they were read before all remedies."""
        with self._lock:
            self._keep(replace(self.choice, how={}))
            self.folder = replace(self.folder, how=self._how)
            return self.update()

    def look_for(self, board: str) -> None:
        """Take the pictures in the folder as those of a board, `Board.text`; raises `InputError` for other text."""
        with self._lock:
            self._look_for(board)
            self._keep(replace(self.choice, board=board))

    def _look_for(self, board: str) -> None:
        seen = SeenBoard(str(self.folder.path), board)
        seen.read_board()
        self.folder = replace(self.folder, seen=seen)

    def _choose(self, change: Callable[[set[int]], set[int]], poses: tuple[int, ...]) -> Answer:
        with self._lock:
            wrong = [k for k in poses if not 0 <= k < self.answer.n]
            if wrong:
                raise InputError(f"Expected poses between 0 and {self.answer.n - 1}, got {wrong[0]}.")
            left_out = tuple(sorted(change(set(self.choice.left_out))))
            if left_out != self.choice.left_out:
                self._keep(self.choice.changed(left_out))
            return self.update()

    def _keep(self, choice: Choice) -> None:
        board = {} if choice.board is None else {"board": choice.board}
        how = {"how": dict(choice.how)} if choice.how else {}
        tree = {"left_out": list(choice.left_out), "earlier": [list(one) for one in choice.earlier], **board, **how}
        write_atomically(self.folder.path / CHOICE, json_text(tree))
        self.choice = choice

    # ---------------------------------------------------------------------------------------------------- answers

    def update(self) -> Answer:
        """Read the files and answer, if they or the choice are not those of the last answer."""
        with self._lock:
            asked = (self.folder.state(), self.choice.left_out, json_text(dict(self.choice.how)))
            if asked == self._asked:
                return self.answer
            self.computing = True
            self._tell()  # the answer that is shown is no longer that of these poses
            try:
                n, poses = self._read()
            except (InputError, NotConvergedError) as error:  # half written, or wrong
                self.problem = " ".join(str(error).split())
                self._asked = asked
            else:
                left_out = tuple(k for k in self.choice.left_out if k < n)
                self.answer = self.question.ask(n, poses, left_out)
                self.problem, self._asked = "", asked
                if self.answer.size is not None:
                    self._sizes[n, left_out] = self.answer.size
            finally:
                self.computing = False
            self._tell()
            return self.answer

    def _read(self) -> tuple[int, PosePairs | None]:
        """Read the files; what a reader warns of, such as a picture that it rejects, is noted."""
        with ONE_AT_A_TIME, warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", InputWarning)
            n, poses = self.folder.read()
        texts = (" ".join(str(one.message).split()) for one in said if issubclass(one.category, InputWarning))
        self.notes.extend(text for text in texts if text not in self.notes)
        return (n if poses is None else poses.n), poses  # without pictures that were rejected

    @property
    def curve(self) -> list[tuple[int, float]]:
        """Numbers of poses, and the standard uncertainty (m) of a point at the distance of the target."""
        out = self.answer.left_out
        known = (key for key in self._sizes if key[1] == _below(out, key[0]) and np.isfinite(self._sizes[key]))
        return sorted((n, self._sizes[n, chosen]) for n, chosen in known)

    def brought(self) -> tuple[float, float] | None:
        """Return the standard uncertainty (m) before the last pose and with it; None where one is not known."""
        n, out = self.answer.n, self.answer.left_out
        before, after = self._sizes.get((n - 1, _below(out, n - 1))), self._sizes.get((n, out))
        return None if before is None or after is None else (before, after)

    def fill(self) -> bool:
        """Compute one point of the curve that is missing, and return whether there was one."""
        answer = self.answer
        if answer.poses is None or answer.size is None:
            return False
        counts = np.unique(np.geomspace(MIN_POSES, answer.n, 12).round().astype(int)).tolist()
        for n in [answer.n - 1, *reversed(counts)]:
            key = (n, _below(answer.left_out, n))
            if n >= MIN_POSES and key not in self._sizes:
                part = self.question.ask(n, answer.poses.rows(np.arange(n)), key[1], plan=False)
                self._sizes[key] = float("nan") if part.size is None else part.size
                self._tell()
                return True
        return False

    def run(self, stop: threading.Event) -> None:
        """Follow the folder until `stop` is set."""

        def pause(seconds: float) -> bool:
            while not stop.is_set() and self.fill():
                pass
            return stop.wait(seconds)

        for _ in settled(self.folder.state, pause):
            self.update()

    def finish(self) -> Path:
        """Write result and report of the last answer, and return their folder."""
        with self._lock, ONE_AT_A_TIME:
            self.update()
            if self.answer.result is None:
                raise InputError(f"There is no X yet. {' '.join(self.answer.lines)}".strip())
            if self._deliver is not None:
                return self._deliver(self.answer)
            return deliver(self.answer, self.folder.path / "result")

    def note(self, problem: str) -> None:
        """Record input that could not be used; it is shown with the answers."""
        self.notes.append(" ".join(problem.split()))
        self._tell()

    def _tell(self) -> None:
        for listener in self.listeners:
            listener(self)

    def _mend(self) -> None:
        """Make the folder, and cut off a last line that a killed program left unfinished."""
        path = self.folder.path
        path.mkdir(parents=True, exist_ok=True)
        own = path / OWN
        if own.exists():
            data = own.read_bytes()
            if data and not data.endswith(b"\n"):
                write_atomically(own, data[: data.rfind(b"\n") + 1])


def deliver(answer: Answer, folder: Path) -> Path:
    """Write result.json and report.html."""
    result = answer.result
    assert result is not None
    more = {} if answer.verdict is None else {"verdict": answer.verdict.to_dict()}
    write_files(folder, {"result.json": signed_text(result.to_dict() | more)})
    result.report(folder / "report.html", comparison=False, verdict=answer.verdict)
    return folder


def _below(left_out: tuple[int, ...], n: int) -> tuple[int, ...]:
    return tuple(k for k in left_out if k < n)


def _read_choice(path: Path) -> Choice:
    """Return what was left out before; raises `InputError` for a file of another form."""
    if not path.exists():
        return Choice()
    tree = parsed(path)
    try:
        earlier = tuple(tuple(int(k) for k in one) for one in tree["earlier"])
        board = None if tree.get("board") is None else str(tree["board"])
        how = {str(name): tuple(of) if isinstance(of, list) else of for name, of in dict(tree.get("how", {})).items()}
        return Choice(tuple(sorted(int(k) for k in tree["left_out"])), earlier, board, how)
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is not the file of a session. Remove it: no pose is then left out.") from error
