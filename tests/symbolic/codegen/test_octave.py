"""The whole functions of Octave: run where it is installed, read where it is not."""

import re

import drivers
import numpy as np
import pytest
from whole_functions import GOOD

import uq_handeye as uq
from uq_handeye.symbolic import codegen

pytestmark = pytest.mark.toolchain


def test_octave_whole_functions(generated, tmp_path):
    program = drivers.tool("octave-cli", "octave")
    for path in generated("octave").glob("*_4dpa.m"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    A, B, S_A, S_B = GOOD["N = 3"]
    for name, stack in (("A", A), ("B", B), ("S", np.stack([S_A, S_B]))):
        np.savetxt(tmp_path / name, np.concatenate(list(stack)), fmt="%.17g")
    (tmp_path / "driver.m").write_text(
        "A = permute(reshape(load('A').', 4, 4, []), [2, 1, 3]);\n"
        "B = permute(reshape(load('B').', 4, 4, []), [2, 1, 3]);\n"
        "S = permute(reshape(load('S').', 6, 6, []), [2, 1, 3]); m = [];\n"
        "for i = 1:size(A, 3), m = accumulate_4dpa(m, A(:, :, i), B(:, :, i)); end\n"
        "[X, status] = solve_4dpa(m); assert(isempty(status));\n"
        "[C, status] = covariance_4dpa(A, B, S(:, :, 1), S(:, :, 2), X); assert(isempty(status));\n"
        "printf('%.17g ', X.', C.');\n"
    )
    found = np.array(drivers.run(program, "--no-gui", "--norc", "driver.m", cwd=tmp_path).split(), dtype=float)
    X = uq.solve(A, B, method="4dpa")
    np.testing.assert_allclose(found[:16].reshape(4, 4), X, atol=1e-13)
    S = uq.propagate(A, B, uq.PairNoise(A=S_A, B=S_B), X=X)
    np.testing.assert_allclose(found[16:].reshape(6, 6), S, atol=1e-12 * np.diag(S).min())


def test_octave_names_and_formulas_are_those_of_python(generated):
    """No Octave here: at least brackets balance, blocks end, and every call goes to a function that there is."""
    known = {"isempty", "struct", "zeros", "isnumeric", "isequal", "size", "all", "abs", "error", "eye", "max", "det"}
    known |= {"svd", "diag", "sign", "sum", "trace", "cross", "eig", "sort", "min", "readings", "skew"}
    for path in generated("octave").glob("*_4dpa.m"):
        code = "\n".join(re.sub(r"(?<![\w)\].'])'[^'\n]*'|%.*", "0", line) for line in path.read_text().splitlines())
        assert all(code.count(a) == code.count(b) for a, b in ("()", "[]", "{}")), path.name
        assert len(re.findall(r"^ *(?:function|if|for)\b", code, re.MULTILINE)) == len(
            re.findall(r"^ *end$", code, re.MULTILINE)
        )
        variables = set(re.findall(r"(\w+)(?:\([^)\n]*\))? = ", code)) | set(re.findall(r"\[([\w, ]+)\] =", code))
        variables |= {name for group in re.findall(r"[(\[]([\w, ]+)[)\]]", code) for name in group.split(", ")}
        called = set(re.findall(r"\b([a-zA-Z]\w*)\(", code)) - variables - known - {path.stem, "pairs"}
        assert called == set(), path.name
    assert set(codegen.WRITTEN_IN) == {"c", "cpp", "octave", "python"}
