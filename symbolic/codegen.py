"""Code for people: matrices of the registry and the two whole functions in other languages, as files.

    from uq_handeye.symbolic.codegen import files
    files("c", ["J_11", "solve_4dpa"], version="0.1.0")     # file name -> text

Deterministic: the text depends on the names, their order in the registry, and the versions only.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

from .cache import derived
from .language import CONVENTIONS, STEM, Form, banner, joined
from .languages import LANGUAGES
from .latex import latex_files
from .matrices import FORMS
from .printing import ARGUMENTS_MODULE, numpy_function
from .whole_functions import FUNCTIONS, WRITTEN_IN, function_files

COMMENTS = {**{name: language.comment for name, language in LANGUAGES.items()}, "python": "#", "latex": "%"}
NAMES: tuple[str, ...] = (*FORMS, *FUNCTIONS)


def files(language: str, names: Iterable[str], version: str) -> dict[str, str]:
    """File name -> text of the matrices and functions ``names``, in the order of the registry, each once.

    Raises KeyError for a language or name that there is not, or a whole function the language has not.
    """
    wanted = set(names)
    if language not in COMMENTS or not wanted <= set(NAMES):
        raise KeyError(language if language not in COMMENTS else sorted(wanted - set(NAMES))[0])
    result: dict[str, str] = {}
    forms = [(form, derived(form)) for form in FORMS.values() if form.name in wanted]
    if forms:
        result |= _matrix_files(language, forms, version)
    for name in FUNCTIONS:
        if name in wanted:
            if language not in WRITTEN_IN:
                raise KeyError(name)
            result |= function_files(language, name, version)
    return result


def one_text(language: str, texts: dict[str, str]) -> str:
    """The files as one text, each behind its name if they are several."""
    return joined(texts, COMMENTS[language]) if len(texts) > 1 else "".join(texts.values())


def listing() -> str:
    """All names with source, shape and meaning, and in which languages the whole functions are."""
    width = max(map(len, NAMES))
    rows = [(form.name, form.equation, f"{'x'.join(map(str, form.shape))}: {form.meaning}.") for form in FORMS.values()]
    matrices = "".join(_row(width, *row) for row in rows)
    functions = "".join(_row(width, name, source, f"{meaning}.") for name, (source, meaning) in FUNCTIONS.items())
    languages = ", ".join(sorted(COMMENTS))
    return (
        f"Matrices, in {languages}:\n\n{matrices}\nWhole functions, in {', '.join(sorted(WRITTEN_IN))}:\n\n{functions}"
    )


def _row(width: int, name: str, source: str, text: str) -> str:
    lines = textwrap.wrap(
        f"{text} {source if source.startswith('(') else f'({source})'}", 100 - width - 4, break_on_hyphens=False
    )
    return "".join(f"  {name if not k else '':{width}}  {line}\n" for k, line in enumerate(lines))


def _matrix_files(language: str, forms: list[Form], version: str) -> dict[str, str]:
    if language == "latex":
        return latex_files(forms, version)
    if language == "python":
        arrays = "Every function takes arrays with leading batch axes, which broadcast. It needs NumPy alone.\n"
        functions = [numpy_function(form, found) for form, found in forms]
        # without the docstring of that module
        prepare = ARGUMENTS_MODULE.split('"""', 2)[2].lstrip()
        head = banner("#", version, [CONVENTIONS, arrays])
        doc = '"""Closed forms of uq-handeye as NumPy functions."""\n'
        return {f"{STEM}.py": "\n\n".join([f"{head}{doc}\n{prepare}", *functions])}
    return LANGUAGES[language].files(forms, version)
