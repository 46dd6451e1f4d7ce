"""Command ``codegen``: the closed forms as code in other languages."""

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...errors import InputError
from ..messages import LOG
from ..printing import emit
from ..values import one_of

# Names of symbolic.codegen.COMMENTS, repeated here so that help and completion load quickly.
LANGUAGE_NAMES = ("c", "cpp", "octave", "julia", "rust", "fortran", "javascript", "python", "latex")


def codegen_command(
    names: list[str] | None = None,
    language: str | None = None,
    matrix: list[str] | None = None,
    every: bool = False,
    list_names: bool = False,
    output: Path | None = None,
) -> None:
    """Generate the closed forms as code in other languages.

    Examples:
      # Names of all matrices and functions
      uq-handeye codegen --list
      uq-handeye codegen --language c --matrix solve_4dpa -o generated/

    The matrices of the paper and their derivatives are available in every
    language, the functions solve_4dpa and covariance_4dpa in c, cpp, octave and
    python.

    Arguments:
      names = NAME: Names of matrices and functions, as for --matrix.

    Options:
      * --language NAME <LANGUAGE_NAMES>: Language: {LANGUAGE_NAMES}.
      * --matrix NAME: Matrix or function of --list. Repeatable.
      * every = --all: All matrices and functions of the language.
      * list_names = --list: List the available functions and exit.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for the code. Default: standard output.
    """
    from ..._version import __version__
    from ...read import write_files

    if list_names:
        emit(_generator().listing())
        return
    if language is None:
        raise InputError(f"Expected --language, one of {', '.join(LANGUAGE_NAMES)}.")
    language = one_of(language, "--language", LANGUAGE_NAMES)
    given = [part.strip() for text in [*(matrix or []), *(names or [])] for part in text.split(",") if part.strip()]
    if every == bool(given):
        raise InputError("Expected either --matrix NAME or --all; see codegen --list for the names.")

    codegen = _generator()
    lacking = [] if language in codegen.WRITTEN_IN else list(codegen.FUNCTIONS)
    if every:
        given = [name for name in codegen.NAMES if name not in lacking]
        if lacking:
            LOG.info("%s are not written in %s, but in %s.", _listed(lacking), language, _listed(codegen.WRITTEN_IN))
    for name in given:
        if name not in codegen.NAMES:
            raise InputError(
                f"Expected --matrix to be a name of codegen --list, got {name!r}.{_near(name, codegen.NAMES)}"
            )
        if name in lacking:
            raise InputError(
                f"{name} is not written in {language}, but in {_listed(codegen.WRITTEN_IN)}; "
                f"{language} has the matrices."
            )
    texts = codegen.files(language, given, __version__)
    if output is None:
        emit(codegen.one_text(language, texts))
    else:
        write_files(output, texts)
        what = ", ".join(texts) if len(texts) <= 6 else f"{len(texts)} files"
        emit(f"Wrote {what} to {output}\n")


def _generator() -> Any:
    """Import the generator, which with SymPy takes half a second."""
    from ...symbolic import codegen

    return codegen


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _near(name: str, names: Sequence[str]) -> str:
    """Return up to three similar names, in any case."""
    small = {known.lower(): known for known in sorted(names)}
    same = [known for known in names if known.lower() == name.lower()]
    near = same or [small[found] for found in difflib.get_close_matches(name.lower(), small, n=3, cutoff=0.5)]
    return f" Did you mean {' or '.join(near)}?" if near else ""
