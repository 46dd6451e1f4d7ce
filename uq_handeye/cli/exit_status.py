"""Exit statuses of the program and their meaning; the page `exit status` of the documentation has this table."""

from __future__ import annotations

from enum import IntEnum


class ExitStatus(IntEnum):
    """Exit status of a command."""

    meaning: str

    def __new__(cls, value: int, meaning: str) -> ExitStatus:
        """Make a status of a number and its meaning."""
        status = int.__new__(cls, value)
        status._value_, status.meaning = value, meaning
        return status

    DONE = 0, "done"
    INTERNAL_ERROR = (
        1,
        "an internal error, one line on stderr (please report it; `--log-file FILE` has the details), or a run that "
        "lost its workers or its cluster",
    )
    BAD_INPUT = (
        2,
        "bad usage or bad input: one line on stderr, `uq-handeye: error: ...`, which says what was expected, what was "
        "given and what to do",
    )
    NOT_USABLE = (
        3,
        "the result is not usable (`NOT USABLE: ...`): the poses contradict it or do not determine it; files are "
        "written in any case; `check`: these poses cannot tell, or something moved among them; `certificate`: also "
        "where the uncertainty is not known",
    )
    CONTRADICTED = 4, "new measurements contradict the result (`check`, `verify`)"
    NOT_PASSED = 5, "`--tolerance` was given and the verdict is not PASS"
    IN_PART = (
        6,
        "X is known in part: the headline names the directions that the poses do not determine, the others are known "
        '(`"usable": false`, `"answered": "in part"` in JSON); `export` writes one of all X that fit, with a warning',
    )
    INTERRUPTED = 130, "Ctrl-C: one line on stderr; commands that save their work print the finished part"
