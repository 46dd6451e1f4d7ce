"""solve_4dpa and covariance_4dpa, compiled or imported as a stranger would, against `uq.solve` and `uq.propagate`."""

import re

import drivers
import mpmath as mp
import numpy as np
import pytest
from support import difference, draw, is_consistent, moved, noisy_motions, random_covariance
from whole_functions import CONDITION, DEGENERATE, GOOD, MESSAGES, STATUS, UNTOUCHED, Compiled, Imported

import uq_handeye as uq

pytestmark = pytest.mark.toolchain


@pytest.fixture(params=["c", "c sanitized", "cpp", "cpp sanitized", "python"])
def program(request, generated, tmp_path, monkeypatch):
    language, _, sanitized = request.param.partition(" ")
    if language == "python":
        return Imported(generated(language), monkeypatch)
    return Compiled(language, generated(language), tmp_path, drivers.SANITIZERS if sanitized else ["-O2"])


def test_the_same_as_in_the_package(program):
    answers = program(list(GOOD.values()))
    for (name, (A, B, S_A, S_B)), answer in zip(GOOD.items(), answers, strict=True):
        assert (answer.status, answer.status_of_S) == (0, 0), name
        X = uq.solve(A, B, method="4dpa")
        condition = CONDITION.get(name, 1.0)
        np.testing.assert_allclose(answer.X[:3, :3], X[:3, :3], rtol=0, atol=1e-14 * condition, err_msg=name)
        lengths = max(np.abs(T[..., :3, 3]).max() for T in (A, B, X))
        np.testing.assert_allclose(
            answer.X[:3, 3], X[:3, 3], rtol=1e-12, atol=1e-13 * condition * lengths, err_msg=name
        )
        assert answer.X[3].tolist() == [0, 0, 0, 1]
        S = uq.propagate(A, B, uq.PairNoise(A=S_A, B=S_B), X=X)
        sd = np.sqrt(np.diag(S))
        assert np.abs((answer.S - S) / sd / sd[:, None]).max() < 1e-12 * condition, name
        np.testing.assert_array_equal(answer.S, answer.S.T)


def exact_covariance(A, B, S_A, S_B, X):
    """T3 in 200 digits, from its definition: central differences of f and h need no formula of a derivative."""
    with mp.workdps(200):  # some lengths are 1e60
        step = mp.mpf(10) ** -40

        def matrix(a):
            return mp.matrix(np.asarray(a).tolist())

        def cross(a, b):
            return mp.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])

        def read(T):
            R, t = T[:3, :3], T[:3, 3]
            return mp.matrix([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2, (t + R.T * t) / 2

        def shifted(T, k, by):
            """Rotated from the left about axis k to second order, or moved along axis k - 3."""
            T = T.copy()
            if k < 3:
                S = mp.zeros(3)
                S[(k + 2) % 3, (k + 1) % 3], S[(k + 1) % 3, (k + 2) % 3] = by, -by
                T[:3, :3] = T[:3, :3] + S * T[:3, :3] + S * S * T[:3, :3] / 2
            else:
                T[k - 3, 3] += by
            return T

        def terms(A, B, X):
            (u, w), (v, z) = read(A), read(B)
            p, q = X[:3, :3] * v, X[:3, :3] * z
            return [*cross(u, p), *(cross(u, cross(X[:3, 3], p)) + cross(w, p) + cross(u, q))]

        def derivative(of, which):
            columns = []
            for k in range(6):
                low, high = (
                    terms(*(shifted(T, k, by) if n == which else T for n, T in enumerate(of))) for by in (-step, step)
                )
                columns.append([(b - a) / (2 * step) for a, b in zip(low, high, strict=True)])
            return mp.matrix(columns).T

        X, by_X, S = matrix(X), mp.zeros(6), mp.zeros(6)
        for a, b, S_a, S_b in zip(A, B, *(np.broadcast_to(s, (len(A), 6, 6)) for s in (S_A, S_B)), strict=True):
            of = (matrix(a), matrix(b), X)
            for which, noise in enumerate((S_a, S_b)):
                F = derivative(of, which)
                S += F * matrix(noise) * F.T
            by_X += derivative(of, 2)
        # T3 takes M = tr(G) I - sym(G): at the least-squares X sum f is 0 and G symmetric but for rounding
        for i in range(2):
            block = by_X[3 * i : 3 * i + 3, 3 * i : 3 * i + 3]
            by_X[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = (block + block.T) / 2
        Q = by_X**-1
        return np.array((Q * S * Q.T).tolist(), dtype=float)


@pytest.mark.parametrize("language", ["c", "cpp", "python"])
def test_the_covariance_in_many_digits(language, generated, tmp_path, monkeypatch):
    """To 1e-12 at the X that the language found, however ill-conditioned X itself is."""
    if language == "python":
        program = Imported(generated(language), monkeypatch)
    else:
        program = Compiled(language, generated(language), tmp_path, ["-O2"])
    few = {name: tuple(part[:9] if len(part) > 6 else part for part in problem) for name, problem in GOOD.items()}
    for (name, problem), answer in zip(few.items(), program(list(few.values())), strict=True):
        S = exact_covariance(*problem, answer.X)
        sd = np.sqrt(np.diag(S))
        # near pi an entry of R, rounded, is eps / sin(angle) of the axis
        assert np.abs((answer.S - S) / sd / sd[:, None]).max() < (1e-11 if name == "near pi" else 1e-12), name


def test_the_rotation_is_one(program):
    for answer in program(list(GOOD.values())):
        R = answer.X[:3, :3]
        assert np.abs(R.T @ R - np.eye(3)).max() < 1e-14 and np.linalg.det(R) > 0.9


def test_the_covariance_is_that_of_the_estimates(program):
    """Independent of the package: the spread of X over drawn noise, by the language's own solver."""
    rng = np.random.default_rng(3)
    _, A, B = noisy_motions(rng, 20, sd=0.0)
    S_A, S_B = random_covariance(rng, sd=1e-4), random_covariance(rng, sd=1e-4)
    trials = 3000 if not isinstance(program, Imported) else 1000
    problems = [(moved(A, draw(rng, S_A, (20,))), moved(B, draw(rng, S_B, (20,))), S_A, S_B) for _ in range(trials)]
    first, *answers = program([(A, B, S_A, S_B), *problems])
    errors = difference(np.stack([answer.X for answer in answers]), first.X)
    assert is_consistent(errors, first.S) and not is_consistent(errors, 1.3 * first.S)


def raise_named(name, A, B):
    """The package's own error, with the name of a problem that it solves."""
    X = uq.solve(A, B, method="4dpa")
    raise AssertionError(f"{name} is determined: {X}")


def test_what_is_not_determined_is_said(program):
    S = 1e-6 * np.eye(6)
    answers = program([(A, B, S, S) for _, A, B in DEGENERATE.values()])
    for (name, (status, A, B)), answer in zip(DEGENERATE.items(), answers, strict=True):
        with pytest.raises(uq.DegenerateMotionError, match=MESSAGES[STATUS[status]]):
            raise_named(name, A, B)
        assert answer.status == STATUS[status], name
        assert (answer.X == UNTOUCHED).all() and (answer.S == UNTOUCHED).all()


def test_bad_input_is_refused(program):
    rng = np.random.default_rng(11)
    _, A, B = noisy_motions(rng, 5)
    S = 1e-6 * np.eye(6)

    def with_entry(T, place, value):
        T = np.array(T)
        T[place] = value
        return T

    swapped = A.copy()
    swapped[2, :3, :3] = A[2, :3, :3] @ np.diag([1, 1, -1])
    lopsided, impossible = np.array(S), np.array(S)
    lopsided[0, 1] = 1e-7
    impossible[0, 1] = impossible[1, 0] = 2e-6
    of_X = {
        "too few": [(A[:1], B[:1], S, S)],
        "not finite": [
            (with_entry(A, (3, 0, 0), np.nan), B, S, S),
            (A, with_entry(B, (3, 1, 3), np.inf), S, S),
            (A, with_entry(B, (0, 3, 3), -np.inf), S, S),
            (with_entry(A, (0, 0, 3), 1e76), B, S, S),
        ],
        "no pose": [
            (swapped, B, S, S),
            (A, with_entry(B, (1, 3, 0), 1.0), S, S),
            (A, with_entry(B, (1, 3, 3), 0.0), S, S),
            (with_entry(A, (4, 0, 0), A[4, 0, 0] + 0.01), B, S, S),
            (A, 0.0 * B, S, S),
        ],
    }
    for status, problems in of_X.items():
        for answer in program(problems):
            assert answer.status == STATUS[status]
            assert (answer.X == UNTOUCHED).all()
    of_S = {
        "not finite": [(A, B, with_entry(S, (0, 0), np.nan), S), (A, B, S, with_entry(S, (5, 5), np.inf))],
        "no covariance": [(A, B, -S, S), (A, B, S, lopsided), (A, B, impossible, S)],
    }
    for status, problems in of_S.items():
        for answer in program(problems):
            assert (answer.status, answer.status_of_S) == (0, STATUS[status])
            assert np.isfinite(answer.X).all() and (answer.S == UNTOUCHED).all()


# ------------------------------------------------------------------------------------------- as a stranger does


def example(path):
    """The program in the comments of a header."""
    lines = [line.removeprefix("//     ").removeprefix("//") for line in path.read_text().splitlines()]
    start = next(k for k, line in enumerate(lines) if line.startswith("#include <"))
    stop = next(k for k, line in enumerate(lines) if k > start and line == "}")
    return "\n".join(lines[start : stop + 1]) + "\n"


@pytest.mark.parametrize("name", ["solve_4dpa", "covariance_4dpa"])
def test_c_compiles_alone_in_an_empty_folder(generated, tmp_path, name):
    compiler = drivers.tool("cc", "gcc")
    for suffix in (".h", ".c"):
        (tmp_path / f"{name}{suffix}").write_bytes((generated("c") / f"{name}{suffix}").read_bytes())
    drivers.run(compiler, "-std=c99", "-O2", "-c", f"{name}.c", cwd=tmp_path)
    included = re.findall(r"^#include (.*)$", (tmp_path / f"{name}.c").read_text(), re.MULTILINE)
    assert included == [f'"{name}.h"', "<math.h>"]


@pytest.mark.parametrize("language", ["c", "cpp"])
def test_the_examples_in_the_headers_run(generated, tmp_path, language):
    compiler = drivers.tool(*{"c": ("cc", "gcc"), "cpp": ("c++", "g++")}[language])
    for path in generated(language).glob("*_4dpa.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    printed = []
    for name in ("solve_4dpa", "covariance_4dpa"):
        header = tmp_path / f"{name}.{'h' if language == 'c' else 'hpp'}"
        (tmp_path / f"main.{language}").write_text(example(header))
        (command,) = re.findall(r"`((?:cc|c\+\+) .*?)`", header.read_text())
        arguments = [word.replace("main.cpp", "main.cpp") for word in command.split()[1:]]
        drivers.run(compiler, *drivers.WARNINGS, *arguments, "-o", "main", cwd=tmp_path)
        printed.append(drivers.run("./main", cwd=tmp_path))
    assert printed[0] == "0.1 0.2 0.3\n"
    sd = ["0.000707", "0.000500", "0.000707"]
    assert printed[1].split() == [word for unit in ("rad", "m") for value in sd for word in (value, unit)]


def test_c_says_what_is_wrong(generated, tmp_path):
    compiler = drivers.tool("cc", "gcc")
    for path in generated("c").glob("solve_4dpa.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "solve_4dpa.h"\n'
        "int main(void) { int i; for (i = 0; i < 10; i++) puts(message_4dpa(i)); return 0; }\n"
    )
    drivers.run(compiler, "-std=c99", *drivers.WARNINGS, "main.c", "-o", "main", cwd=tmp_path)
    lines = drivers.run("./main", cwd=tmp_path).splitlines()
    assert len(set(lines)) == 10 and lines[0] == "ok" and lines[-1] == "unknown status"


def test_what_is_refused_leaves_the_sums_as_they_were(generated, tmp_path):
    """A controller may drop a bad pair and go on."""
    compiler = drivers.tool("cc", "gcc")
    for path in generated("c").glob("*_4dpa.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    text = example(tmp_path / "covariance_4dpa.h")
    bad = "double bad[16] = {0}, worse[36] = {-1};"
    text = text.replace("        int i, status", f"        {bad}\n        int i, status").replace(
        "    int i, status", f"    {bad}\n    int i, status", 1
    )
    text = text.replace(
        "        status = accumulate_4dpa(&moments, A[i], B[i]);",
        "        if (accumulate_4dpa(&moments, A[i], bad) != NOT_A_POSE_4DPA) return 2;\n"
        "        status = accumulate_4dpa(&moments, A[i], B[i]);",
    )
    text = text.replace(
        "        status = accumulate_covariance_4dpa(&sums, A[i], B[i], Sigma_A, Sigma_B);",
        "        if (accumulate_covariance_4dpa(&sums, A[i], B[i], Sigma_A, worse) != NOT_A_COVARIANCE_4DPA)\n"
        "            return 3;\n"
        "        status = accumulate_covariance_4dpa(&sums, A[i], B[i], Sigma_A, Sigma_B);",
    )
    assert text.count("return 2") == text.count("return 3") == 1
    (tmp_path / "main.c").write_text(text)
    drivers.run(compiler, "-std=c99", "main.c", "solve_4dpa.c", "covariance_4dpa.c", "-o", "main", "-lm", cwd=tmp_path)
    assert drivers.run("./main", cwd=tmp_path).split()[:4] == ["0.000707", "rad", "0.000500", "rad"]


FUZZ = """#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "covariance_4dpa.h"
#include "solve_4dpa.h"

static double any(void)
{
    const double m = rand() / (double)RAND_MAX * 2 - 1;
    switch (rand() % 8) {
    case 0: return 0;
    case 1: return ldexp(m, rand() % 2000 - 1000);
    case 2: return rand() % 3 - 1;
    case 3: return rand() % 500 ? m : NAN;
    case 4: return rand() % 500 ? m : -INFINITY;
    default: return m;
    }
}

int main(void)
{
    long answers[9] = {0};
    int i, j, k, trial, status;
    for (trial = 0; trial < 200000; trial++) {
        moments_4dpa moments;
        covariance_sums_4dpa sums;
        double X[16], S[36];
        const double scale = trial % 3 ? 1 : ldexp(1, rand() % 600 - 300);
        for (i = 0; i < 9; i++) {
            moments.H[i] = trial % 4 || i < 3 ? any() * scale : moments.H[i % 3] * i;
            moments.K[i] = any();
            sums.G[i] = trial % 4 ? any() * scale : i % 4 == 0;
            sums.h_theta[i] = any();
        }
        for (i = 0; i < 36; i++) sums.S[i] = any();
        moments.pairs = sums.pairs = rand() % 100;
        status = solve_4dpa(&moments, X);
        answers[status]++;
        for (i = 0; i < 16 && status == OK_4DPA; i++) if (!isfinite(X[i])) return 2;
        for (i = 0; i < 3 && status == OK_4DPA; i++)
            for (k = 0; k < 3; k++) {
                double product = i == k ? -1 : 0;
                for (j = 0; j < 3; j++) product += X[4 * i + j] * X[4 * k + j];
                if (fabs(product) > 1e-14) return 3;
            }
        status = covariance_4dpa(&sums, S);
        answers[status]++;
        for (i = 0; i < 36 && status == OK_4DPA; i++) if (!isfinite(S[i])) return 4;
    }
    for (i = 0; i < 9; i++) printf("%ld ", answers[i]);
    return 0;
}
"""


def test_whatever_the_sums_hold_the_answer_is_finite_or_a_status(generated, tmp_path):
    """Sums that no pairs make: any sizes, NaN, infinity, rank 1; under the sanitizers, division by zero among them."""
    compiler = drivers.tool("gcc")
    for path in generated("c").glob("*_4dpa.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "main.c").write_text(FUZZ)
    options = ["-std=c99", "-O1", *drivers.SANITIZERS, "-fsanitize=float-divide-by-zero"]
    drivers.run(compiler, *options, "main.c", "solve_4dpa.c", "covariance_4dpa.c", "-o", "main", "-lm", cwd=tmp_path)
    answers = [int(n) for n in drivers.run("./main", cwd=tmp_path).split()]
    assert all(
        answers[STATUS[name]] > 0 for name in ("ok", "too few", "no rotation", "parallel", "not finite", "other X")
    )
