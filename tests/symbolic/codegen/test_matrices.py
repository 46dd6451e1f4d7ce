"""Every matrix of the registry in every language gives the numbers of NumPy; the text is legal, and always the same."""

import importlib.util
import os
import re
import subprocess
import sys

import drivers
import numpy as np
import pytest
from fixtures.pages import ROOT
from support import random_transforms, rotation_vectors, rotations, transforms

import uq_handeye as uq
from uq_handeye.symbolic import codegen, language
from uq_handeye.symbolic.languages import LANGUAGES
from uq_handeye.symbolic.latex import latex_files
from uq_handeye.symbolic.matrices import FORMS

pytestmark = pytest.mark.toolchain


@pytest.fixture(scope="module")
def cases():
    """Poses: random, none, tiny angles, near and at half a turn, huge and tiny lengths, no translation."""
    rng = np.random.default_rng(5)
    axis = rotation_vectors(rng, (), 1.0, 1.0)
    angles = [1e-12, 1e-8, 1e-4, np.pi - 1e-9, np.pi]
    special = [transforms(rotations(a * axis), rng.normal(size=3)) for a in angles]
    T = np.stack([*random_transforms(rng, (3,)), np.eye(4), *special, *random_transforms(rng, (4,))])
    T[-4, :3, 3] *= 1e9
    T[-3, :3, 3] *= 1e-12
    T[-2, :3, 3] = 0.0
    return T


def outputs(folder):
    return np.fromfile(folder / "out.bin")


def set_up(folder, tmp_path, cases, name, text):
    for file in folder.iterdir():
        if file.is_file() and file.suffix in (".c", ".h", ".hpp", ".rs", ".mjs", ".m", ".jl", ".f90"):
            (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / name).write_text(text)
    drivers.all_inputs(cases).tofile(tmp_path / "in.bin")


@pytest.mark.parametrize("options", [["-O2"], drivers.SANITIZERS], ids=["plain", "sanitized"])
@pytest.mark.parametrize(
    ("name", "compilers", "standard"), [("c", ("gcc", "cc"), "-std=c99"), ("cpp", ("g++", "c++"), "-std=c++11")]
)
def test_c_and_cpp(generated, tmp_path, cases, name, compilers, standard, options):
    compiler = drivers.tool(*compilers)
    set_up(generated(name), tmp_path, cases, f"driver.{name}", drivers.c_like(name, len(cases)))
    sources = [f"driver.{name}"] + (["handeye_matrices.c"] if name == "c" else [])
    drivers.run(compiler, standard, *drivers.WARNINGS, *options, *sources, "-o", "driver", cwd=tmp_path)
    drivers.run("./driver", cwd=tmp_path)
    drivers.compare(outputs(tmp_path), cases)


def test_rust(generated, tmp_path, cases):
    compiler = drivers.tool("rustc")
    set_up(generated("rust"), tmp_path, cases, "driver.rs", drivers.rust(len(cases)))
    drivers.run(compiler, "-D", "warnings", "--edition", "2021", "driver.rs", "-o", "driver", cwd=tmp_path)
    drivers.run("./driver", cwd=tmp_path)
    drivers.compare(outputs(tmp_path), cases)


def test_javascript(generated, tmp_path, cases):
    node = drivers.tool("node", "nodejs")
    set_up(generated("javascript"), tmp_path, cases, "driver.mjs", drivers.javascript(len(cases)))
    drivers.run(node, "driver.mjs", cwd=tmp_path)
    drivers.compare(outputs(tmp_path), cases)


def test_fortran(generated, tmp_path, cases):
    compiler = drivers.tool("gfortran")
    set_up(generated("fortran"), tmp_path, cases, "driver.f90", drivers.fortran(len(cases)))
    options = ["-std=f2003", "-Wall", "-Wextra", "-Werror"]
    drivers.run(compiler, *options, "handeye_matrices.f90", "driver.f90", "-o", "driver", cwd=tmp_path)
    drivers.run("./driver", cwd=tmp_path)
    drivers.compare(outputs(tmp_path), cases)


def test_octave(generated, tmp_path, cases):
    program = drivers.tool("octave-cli", "octave")
    set_up(generated("octave"), tmp_path, cases, "driver.m", drivers.octave(len(cases)))
    drivers.run(program, "--no-gui", "--norc", "driver.m", cwd=tmp_path)
    drivers.compare(outputs(tmp_path), cases)


def test_julia(generated, tmp_path, cases):
    program = drivers.tool("julia")
    set_up(generated("julia"), tmp_path, cases, "driver.jl", drivers.julia(len(cases)))
    drivers.run(program, "driver.jl", cwd=tmp_path)
    drivers.compare(outputs(tmp_path), cases)


@pytest.mark.parametrize("name", ["octave", "julia", "fortran"])
def test_languages_without_a_tool_are_read(generated, cases, name):
    """The statements of the text, read by a few rules as Python, give the numbers: no compiler is needed."""
    text = "\n".join(path.read_text() for path in sorted(generated(name).iterdir()) if "4dpa" not in path.name)
    functions = drivers.read_as_python(name, text)
    found = []
    for form in FORMS.values():
        function = functions.pop(LANGUAGES[name].function_name(form))
        found += [np.ravel(function(*row)) for row in zip(*drivers.arguments(form, cases), strict=True)]
    assert functions == {}
    drivers.compare(np.concatenate(found), cases)


def test_python(generated, cases):
    path = generated("python") / "handeye_matrices.py"
    assert set(re.findall(r"^(?:import|from) (\w+)", path.read_text(), re.MULTILINE)) == {"typing", "numpy"}
    spec = importlib.util.spec_from_file_location("handeye_matrices", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = [
        np.ravel(getattr(module, form.name)(*row))
        for form in FORMS.values()
        for row in zip(*drivers.arguments(form, cases), strict=True)
    ]
    drivers.compare(np.concatenate(found), cases)


def test_latex_compiles(generated, tmp_path):
    program = drivers.tool("pdflatex", "lualatex", "xelatex")
    (tmp_path / "a.tex").write_bytes((generated("latex") / "handeye_matrices.tex").read_bytes())
    drivers.run(program, "-interaction=nonstopmode", "-halt-on-error", "a.tex", cwd=tmp_path)


def test_latex_is_balanced_and_its_formulas_parse(generated):
    """Braces, environments and `&`; every entry is read by Matplotlib, which knows the mathematics of LaTeX."""
    from matplotlib.mathtext import MathTextParser

    text = (generated("latex") / "handeye_matrices.tex").read_text()
    body = "\n".join(line for line in text.splitlines() if not line.startswith("%"))
    plain = body.replace(r"\{", "").replace(r"\}", "")
    assert plain.count("{") == plain.count("}")
    opened = []
    for what, name in re.findall(r"\\(begin|end)\{([\w*]+)\}", body):
        if what == "begin":
            opened.append(name)
        else:
            assert opened.pop() == name
    assert opened == [] and body.count(r"\subsection*") == len(FORMS)
    parser = MathTextParser("path")
    formulas = set()
    for display in re.findall(
        r"\\begin\{(?:align|equation)\*\}\n(.*?)\n\\end\{(?:align|equation)\*\}", body, re.DOTALL
    ):
        for line in re.sub(r"\\(begin|end)\{pmatrix\}", r"\\\\", display).split(r"\\"):
            formulas |= {part.strip().removeprefix("=").strip() for part in line.replace(r"\quad", "").split("&")}
    known = [f for f in formulas if f and r"\bigl" not in f]
    assert len(known) > 400
    for formula in known:
        parser.parse(f"${formula.removesuffix('=')}$")


def test_latex_holds_the_matrices():
    """The printed formulas of J_11 and K, set into numbers again."""
    for name in ("J_11", "w", "P_1"):
        form = FORMS[name]
        (text,) = latex_files([(form, codegen.derived(form))], "1").values()
        ((inside,),) = [re.findall(r"\\begin\{pmatrix\}\n(.*?)\n\\end\{pmatrix\}", text, re.DOTALL)]
        rng = np.random.default_rng(1)
        values = [rng.normal(size=a.shape) for a in form.arguments]
        numbers = {
            str(symbol): value[place]
            for a, value in zip(form.arguments, values, strict=True)
            for symbol, place in a.symbols
        }
        found = []
        for entry in re.split(r"&|\\\\", inside):
            code = re.sub(r"\\frac\{(.*?)\}\{(\d)\}(?= |$)", r"(\1)/\2", entry.strip())
            code = re.sub(r"([a-z])_\{(\d+)\}", r"\1\2", code)
            code = re.sub(r"(?<=\d) (?=[a-z])", " * ", code)
            found.append(eval(code, {}, numbers))
        np.testing.assert_allclose(np.reshape(found, form.shape), drivers.expected(form, [v[None] for v in values])[0])


# ---------------------------------------------------------------------------------------------------- the text


@pytest.mark.parametrize("name", sorted(LANGUAGES))
def test_names_are_legal_and_different(name):
    spelled = LANGUAGES[name]
    fold = str.lower if name in ("fortran", "octave", "rust") else str
    functions = [fold(spelled.function_name(form)) for form in FORMS.values()]
    assert len(set(functions)) == len(functions)
    word_fold = str.lower if name == "fortran" else str
    reserved = {word_fold(word) for word in spelled.printer.reserved_words}
    for form in FORMS.values():
        found = codegen.derived(form)
        used = spelled.used(found)
        local = [spelled.text(s) for a in form.arguments for s, place in a.symbols if s in used and place]
        local += [spelled.text(symbol) for symbol, _ in found.temporaries]
        local += [spelled.argument(a) for a in form.arguments] + ["out", spelled.function_name(form)]
        assert len({word_fold(word) for word in local}) == len(local), form.name
        assert not reserved & {word_fold(word) for word in local if word != "out"}, form.name
        assert all(re.fullmatch(r"[A-Za-z]\w*", word) and len(word) < 64 for word in local)
        if name == "rust":
            assert all(word == word.lower() for word in local)


def test_headers(generated):
    licence = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert licence == language.LICENCE
    for name, mark in codegen.COMMENTS.items():
        for path in generated(name).iterdir():
            if not path.is_file():
                continue
            text = path.read_bytes().decode("ascii")
            comments = "\n".join(line.removeprefix(mark).strip() for line in text.splitlines())
            assert "\n".join(line.strip() for line in licence.splitlines()).strip() in comments, path.name
            assert f"of uq-handeye {uq.__version__} with SymPy" in text and "Wu, Sun, Wang, Liu" in text
            assert "\r" not in text and text.endswith("\n") and "@" not in re.sub(r"\w* @ \w*|@dataclass", "", text)
            longest = max(map(len, text.splitlines()))
            assert longest <= 125 or name in ("python", "latex"), (path.name, longest)
            if name != "python" and "4dpa" not in path.name:
                assert "rad" in text and "xi = (theta, tau)" in text


def test_the_text_is_always_the_same(tmp_path):
    """Another process, another hash seed, a cold cache, the names in another order."""
    code = (
        "import sys; from uq_handeye.symbolic import codegen\n"
        "for language in codegen.COMMENTS:\n"
        "    for name, text in codegen.files(language, sys.argv[1:], '1.0').items(): print(name, text)"
    )
    names = ["F11", "J_12", "dF2_dxi", "W", "w"]
    printed = [
        subprocess.run(
            [sys.executable, "-c", code, *order],
            env=os.environ | {"PYTHONHASHSEED": seed, "UQ_HANDEYE_CACHE": str(tmp_path / seed)},
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        ).stdout
        for seed, order in (("1", names), ("2", names[::-1]))
    ]
    assert printed[0] == printed[1] and len(printed[0]) > 10_000


def test_unknown_names():
    for what in (("basic", ["J_11"]), ("c", ["J_51"]), ("rust", ["solve_4dpa"])):
        with pytest.raises(KeyError):
            codegen.files(*what, version="1")
