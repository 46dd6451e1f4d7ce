"""The command codegen: what it lists, writes and prints, and what it says of names that there are not."""

import subprocess
import sys

import pytest
from fixtures.commands import run, run_process

import uq_handeye as uq
from uq_handeye.cli.commands import codegen as cli_codegen
from uq_handeye.symbolic import codegen
from uq_handeye.symbolic.matrices import FORMS


def test_the_names_written_down_twice_agree():
    assert sorted(cli_codegen.LANGUAGE_NAMES) == sorted(codegen.COMMENTS)
    assert set(codegen.WRITTEN_IN) <= set(cli_codegen.LANGUAGE_NAMES)


def test_list():
    done = run("codegen", "--list")
    assert (done.returncode, done.stderr) == (0, "")
    names = [line.split()[0] for line in done.stdout.splitlines() if line.startswith("  ") and line[2] != " "]
    assert names == [*FORMS, "solve_4dpa", "covariance_4dpa"]
    assert max(map(len, done.stdout.splitlines())) <= 100
    assert "Whole functions, in c, cpp, octave, python:" in done.stdout
    assert all(name in done.stdout.splitlines()[0] for name in cli_codegen.LANGUAGE_NAMES)


@pytest.mark.slow
def test_files(tmp_path):
    out = tmp_path / "deep" / "generated"
    done = run("codegen", "--language", "c", "--matrix", "J_11", "--matrix", "u,solve_4dpa", "dw_dxi", "-o", out)
    assert (done.returncode, done.stderr) == (0, "")
    names = ["handeye_matrices.h", "handeye_matrices.c", "solve_4dpa.h", "solve_4dpa.c"]
    assert done.stdout == f"Wrote {', '.join(names)} to {out}\n"
    assert sorted(path.name for path in out.iterdir()) == sorted(names)
    texts = codegen.files("c", ["J_11", "u", "dw_dxi", "solve_4dpa"], uq.__version__)
    for name in names:
        assert (out / name).read_bytes() == texts[name].encode()
    header = (out / "handeye_matrices.h").read_text()
    assert (
        header.count("\nvoid ") == 3
        and "void handeye_J_11(const double E[16], const double Z[16], double out[16]);" in header
    )


@pytest.mark.slow
@pytest.mark.parametrize("language", cli_codegen.LANGUAGE_NAMES)
def test_all(language, tmp_path, generated):
    done = run("codegen", "--language", language, "--all", "-o", tmp_path / "out")
    assert done.returncode == 0
    found = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    wanted = {path.name: path.read_bytes() for path in generated(language).iterdir() if path.is_file()}
    assert found == wanted
    said = "solve_4dpa and covariance_4dpa are not written in" in done.stderr
    assert said == (language not in codegen.WRITTEN_IN)


def test_standard_output():
    one = run("codegen", "--language", "javascript", "--matrix", "w")
    assert one.stdout == "".join(codegen.files("javascript", ["w"], uq.__version__).values())
    two = run("codegen", "--language", "C", "--matrix", "w")
    assert "// ==== handeye_matrices.h ====\n" in two.stdout and "// ==== handeye_matrices.c ====\n" in two.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--matrix", "J_11"], "Expected --language, one of c, cpp"),
        (["--language", "basic", "--all"], "Expected --language to be one of c, cpp"),
        (["--language", "c++", "--all"], "latex, got 'c++'."),
        (["--language", "c"], "Expected either --matrix NAME or --all"),
        (["--language", "rustt", "--all"], "got 'rustt'. Did you mean rust?"),
        (["--language", "c", "--all", "--matrix", "w"], "Expected either --matrix NAME or --all"),
        (["--language", "c", "--matrix", ","], "Expected either --matrix NAME or --all"),
        (["--language", "c", "--matrix", "j_11"], "got 'j_11'. Did you mean J_11?"),
        (["--language", "c", "--matrix", "k"], "got 'k'. Did you mean K?"),
        (["--language", "c", "--matrix", "J_51"], "Did you mean J_"),
        (["--language", "c", "--matrix", "solve4dpa"], "Did you mean solve_4dpa"),
        (["--language", "c", "--matrix", "zzzzzz"], "got 'zzzzzz'."),
        (["--language", "rust", "--matrix", "solve_4dpa"], "not written in rust, but in c, cpp, octave and python"),
        (["--language", "c", "--all", "-o", "pyproject.toml"], "expected a folder, got a file"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_is_wrong_is_one_line(arguments, said, tmp_path):
    (tmp_path / "pyproject.toml").touch()
    done = run("codegen", *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr and done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["pyproject.toml"]


def test_help_is_quick():
    """SymPy is loaded by the work alone."""
    done = run("codegen", "--help")
    assert "uq-handeye codegen --language c" in done.stdout
    code = (
        "import sys\nfrom uq_handeye.cli.app import main\n"
        "try: main(['codegen', '--help'])\nexcept SystemExit: print('sympy' in sys.modules)"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert loaded.stdout.splitlines()[-1] == "False"


@pytest.mark.slow
def test_in_a_process_of_its_own(tmp_path):
    done = run_process("codegen", "--language", "latex", "--matrix", "K", cwd=tmp_path, UQ_HANDEYE_CACHE=str(tmp_path))
    assert done.returncode == 0 and done.stdout.endswith("\\end{document}\n") and done.stderr == ""
