"""The two whole functions, solve_4dpa (T2) and covariance_4dpa (T3), from their templates.

`templates/*.in` holds their text; the registry's u, w, du_dxi and dw_dxi are printed into those of C. C++ is the
text of C in a namespace, in one header.
"""

from __future__ import annotations

import re
from importlib.resources import files
from string import Template

from .cache import derived
from .language import banner
from .languages import C
from .matrices import FORMS

# name -> (source, meaning)
FUNCTIONS = {
    "solve_4dpa": ("T2", "X of A_i X = X B_i from moments that are summed pair by pair"),
    "covariance_4dpa": ("T3", "the 6x6 covariance of that X to first order"),
}
_FILES = {
    ("python", "solve_4dpa"): ("solve_4dpa.py",),
    ("python", "covariance_4dpa"): ("solve_4dpa.py", "covariance_4dpa.py"),  # the latter imports the former
    ("octave", "solve_4dpa"): ("accumulate_4dpa.m", "solve_4dpa.m"),
    ("octave", "covariance_4dpa"): ("covariance_4dpa.m",),
}
WRITTEN_IN = ("c", "cpp", "octave", "python")
_COMMENTS = {".c": "//", ".h": "//", ".hpp": "//", ".m": "%", ".py": "#"}


class _At(Template):
    """``@name@`` in a template; nothing else is replaced."""

    delimiter = "@"
    pattern = r"(?P<named>(?<=@)(?!))|@(?P<braced>[a-z]\w*)@|(?P<escaped>(?!))|(?P<invalid>(?!))"


def function_files(language: str, name: str, version: str) -> dict[str, str]:
    """File name -> text of one whole function in a language of `WRITTEN_IN`."""
    if language == "cpp":
        return {f"{name}.hpp": _header_of_cpp(name, version)}
    names = _FILES.get((language, name), (f"{name}.h", f"{name}.c"))
    return {file: _filled(file, version) for file in names}


def _template(file: str) -> str:
    return (files(__package__) / "templates" / f"{file}.in").read_text(encoding="utf-8").replace("\r\n", "\n")


def _filled(file: str, version: str) -> str:
    mark = _COMMENTS[file[file.rindex(".") :]]
    equations = (
        'T2 and T3 are sections of the theory page of uq-handeye; (n) is an equation of Wu, Sun, Wang, Liu,\n"Hand-eye '
        'Calibration: 4D Procrustes Analysis Approach", 2019.\n'
    )
    parts = {"head": banner(mark, version, [equations])[:-1]}
    text = _template(file)
    for fragment in ("status_4dpa.h", "common_4dpa.c"):
        text = text.replace(f"@{fragment.split('_')[0]}@\n", _template(fragment) + "\n")
    for name in ("u", "w", "du_dxi", "dw_dxi"):
        if f"@{name}@" in text:
            parts[name] = _helper(name)
    return _At(text).substitute(parts)


def _helper(name: str) -> str:
    """A matrix of the registry as a function of this file only."""
    form = FORMS[name]
    language = C()
    text = language.function(form, derived(form))
    return text.replace(f"void {language.function_name(form)}", f"static void {name}_4dpa")


def _header_of_cpp(name: str, version: str) -> str:
    """Header and source of C as one header of C++."""
    header, source = _filled(f"{name}.h", version), _filled(f"{name}.c", version)
    guard = f"{name.upper()}_HPP"
    intro, rest = header.split("#ifndef", 1)
    declarations = rest.split('extern "C" {\n#endif\n', 1)[1].rsplit("#ifdef __cplusplus", 1)[0]
    definitions = source.split("#include <math.h>\n", 1)[1]
    body = f"{declarations.strip()}\n\n{definitions.strip()}\n"
    body = re.sub(r"\b(STATUS|COMMON)_4DPA\b", r"\1_4DPA_HPP", body)
    body = re.sub(
        r"^(?:static inline |static )?((?:const )?(?:int|void|double|char) \*?\w+_4dpa\()",
        r"inline \1",
        body,
        flags=re.M,
    )
    intro = intro.replace(" -std=c99 main.c", " main.cpp").replace("`cc ", "`c++ ")
    intro = re.sub(r" \w+_4dpa\.c\b", "", intro).replace(" -lm`", "`")
    intro = re.sub(r"\b(\w+_4dpa)\.h\b", r"\1.hpp", intro)
    intro = re.sub(
        r"^//     int main\(void\)\n", "//     using namespace handeye;\n//\n//     int main()\n", intro, flags=re.M
    )
    return (
        f"{intro}#ifndef {guard}\n#define {guard}\n\n#include <math.h>\n\nnamespace handeye {{\n\n{body}\n"
        "}  // namespace handeye\n\n#endif\n"
    )
