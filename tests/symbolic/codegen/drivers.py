"""Programs around the generated matrices: they read the inputs of all calls as doubles, and write all results.

One program per language calls every function of the registry a number of times; `in.bin` holds the arguments in the
order of the calls, `out.bin` the results, row by row.
"""

import re
import shutil
import subprocess

import numpy as np
from support import missing

from uq_handeye.symbolic import functions
from uq_handeye.symbolic.languages import LANGUAGES
from uq_handeye.symbolic.matrices import FORMS

WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
NOT_DEMANDED = ("rustc", "node", "julia")  # tried where they are installed
SANITIZERS = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def tool(*names):
    """Return the path of the first of the programs that this machine has."""
    found = next((path for name in names if (path := shutil.which(name))), None)
    if found is None:
        missing("toolchain" if names[0] not in NOT_DEMANDED else "", f"no {' or '.join(names)} on this machine")
    return found


def run(*command, cwd):
    """Standard output of a command that must succeed."""
    done = subprocess.run(list(map(str, command)), cwd=cwd, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


# ------------------------------------------------------------------------------------------------------ inputs


def size(shape):
    return int(np.prod(shape, dtype=int))


def arguments(form, cases):
    """Values of each argument, (cases, *shape): the poses are `cases`, everything else is made from their numbers."""
    rng = np.random.default_rng(len(form.name) + 7 * size(form.shape))
    values = []
    for argument in form.arguments:
        if argument.name == "T":
            values.append(cases)
        elif not argument.shape:
            values.append(10.0 ** rng.uniform(-2, 6, len(cases)))
        else:
            numbers = rng.normal(size=(len(cases), *argument.shape))
            numbers[1], numbers[2], numbers[3] = 0.0, np.round(numbers[2]), 1e-12 * numbers[3]
            values.append(numbers * (10.0 ** rng.uniform(-6, 6, len(cases))).reshape(-1, *[1] * len(argument.shape)))
    return values


def expected(form, values):
    return np.array([getattr(functions, form.name)(*row) for row in zip(*values, strict=True)])


def all_inputs(cases):
    """All arguments of all calls, one after the other."""
    parts = []
    for form in FORMS.values():
        for row in zip(*arguments(form, cases), strict=True):
            parts += [np.ravel(value) for value in row]
    return np.concatenate(parts)


def compare(outputs, cases):
    """Every entry of every result, to 1e-12 of its own size (and rounding of the largest)."""
    start = 0
    for form in FORMS.values():
        reference = expected(form, arguments(form, cases))
        found = outputs[start : start + reference.size].reshape(reference.shape)
        start += reference.size
        for one, right in zip(found, reference, strict=True):
            np.testing.assert_allclose(one, right, rtol=1e-12, atol=1e-15 * np.abs(right).max(), err_msg=form.name)
    assert start == len(outputs)


# ---------------------------------------------------------------------------------------------------- programs


def c_like(language, count):
    spelled = LANGUAGES[language]
    prefix = "handeye::" if language == "cpp" else ""
    include = "handeye_matrices.hpp" if language == "cpp" else "handeye_matrices.h"
    lines = ["#include <stdio.h>", f'#include "{include}"', "static double in[128], out[512];", "int main(void) {"]
    lines.append('  int i; FILE *from = fopen("in.bin", "rb"), *to = fopen("out.bin", "wb");')
    for form in FORMS.values():
        total = sum(size(a.shape) for a in form.arguments)
        offsets = np.cumsum([0, *(size(a.shape) for a in form.arguments)])
        given = [f"in + {o}" if a.shape else f"in[{o}]" for a, o in zip(form.arguments, offsets, strict=False)]
        lines += [
            f"  for (i = 0; i < {count}; i++) {{",
            f"    if (fread(in, 8, {total}, from) != {total}) return 1;",
            f"    {prefix}{spelled.function_name(form)}({', '.join(given)}, out);",
            f"    fwrite(out, 8, {form.size}, to);",
            "  }",
        ]
    return "\n".join([*lines, "  fclose(from); return fclose(to);", "}"]) + "\n"


def rust(count):
    lines = [
        "mod handeye_matrices;",
        "struct Numbers { at: usize, all: Vec<u8> }",
        "impl Numbers {",
        "  fn one(&mut self) -> f64 { let k = self.at; self.at += 8;",
        "    f64::from_le_bytes(self.all[k..k + 8].try_into().unwrap()) }",
        "  fn vector<const N: usize>(&mut self) -> [f64; N] { std::array::from_fn(|_| self.one()) }",
        "  fn matrix<const N: usize, const M: usize>(&mut self) -> [[f64; N]; M] {",
        "    std::array::from_fn(|_| self.vector()) }",
        "}",
        "fn main() {",
        '  let mut from = Numbers { at: 0, all: std::fs::read("in.bin").unwrap() };',
        "  let mut to: Vec<f64> = Vec::new();",
    ]
    for form in FORMS.values():
        reads, names = [], []
        for k, argument in enumerate(form.arguments):
            kind = ("one()", "vector()", "matrix()")[len(argument.shape)]
            reads.append(f"let a{k} = from.{kind};")
            names.append(f"&a{k}" if argument.shape else f"a{k}")
        call = f"handeye_matrices::{LANGUAGES['rust'].function_name(form)}({', '.join(names)})"
        push = "for row in out { to.extend(row); }" if len(form.shape) == 2 else "to.extend(out);"
        lines.append(f"  for _ in 0..{count} {{ {' '.join(reads)} let out = {call}; {push} }}")
    lines.append("  let bytes: Vec<u8> = to.iter().flat_map(|x| x.to_le_bytes()).collect();")
    return "\n".join([*lines, '  std::fs::write("out.bin", bytes).unwrap();', "}"]) + "\n"


def javascript(count):
    lines = [
        "import * as fs from 'node:fs';",
        "import * as m from './handeye_matrices.mjs';",
        "const raw = fs.readFileSync('in.bin');",
        "const all = new Float64Array(raw.buffer.slice(raw.byteOffset, raw.byteOffset + raw.length));",
        "let at = 0; const to = [];",
        "const read = (shape) => shape.length === 0 ? all[at++] :",
        "  Array.from({ length: shape[0] }, () => read(shape.slice(1)));",
    ]
    for form in FORMS.values():
        shapes = ", ".join(f"read([{', '.join(map(str, a.shape))}])" for a in form.arguments)
        lines.append(f"for (let i = 0; i < {count}; i++) to.push(...m.{form.name}({shapes}).flat());")
    return "\n".join([*lines, "fs.writeFileSync('out.bin', Buffer.from(new Float64Array(to).buffer));"]) + "\n"


def octave(count):
    lines = ["from = fopen('in.bin'); to = fopen('out.bin', 'w');"]
    for form in FORMS.values():
        names = ", ".join(f"a{k}" for k in range(len(form.arguments)))
        lines.append(f"for i = 1:{count}")
        for k, argument in enumerate(form.arguments):
            rows, columns = (*argument.shape, 1, 1)[:2]
            lines.append(f"  a{k} = reshape(fread(from, {rows * columns}, 'double'), {columns}, {rows}).';")
        call = f"{LANGUAGES['octave'].function_name(form)}({names})"
        lines += [f"  out = {call}.'; fwrite(to, out(:), 'double');", "end"]
    return "\n".join([*lines, "fclose(to);"]) + "\n"


def julia(count):
    lines = ['include("handeye_matrices.jl")', 'from = open("in.bin"); to = open("out.bin", "w")']
    for form in FORMS.values():
        reads = []
        for argument in form.arguments:
            if len(argument.shape) == 2:
                rows, columns = argument.shape
                reads.append(f"permutedims(read!(from, zeros({columns}, {rows})))")
            else:
                reads.append(f"read!(from, zeros({argument.shape[0]}))" if argument.shape else "read(from, Float64)")
        out = "permutedims(out)" if len(form.shape) == 2 else "out"
        lines.append(
            f"for i in 1:{count}; out = HandeyeMatrices.{form.name}({', '.join(reads)}); write(to, {out}); end"
        )
    return "\n".join([*lines, "close(to)"]) + "\n"


def fortran(count):
    lines = [
        "program driver",
        "  use handeye_matrices",
        "  implicit none",
        "  integer, parameter :: dp = kind(1.0d0)",
        "  integer :: i",
        "  real(dp) :: m0(4,4), m1(4,4), v4(4), v8(8), s",
        "  open(10, file='in.bin', access='stream', form='unformatted', status='old')",
        "  open(11, file='out.bin', access='stream', form='unformatted', status='replace')",
    ]
    for form in FORMS.values():
        names = []
        lines.append(f"  do i = 1, {count}")
        for k, argument in enumerate(form.arguments):
            name = {(4, 4): f"m{k}", (4,): "v4", (8,): "v8", (): "s"}[argument.shape]
            lines.append(f"    read(10) {name}")
            names.append(f"transpose({name})" if len(argument.shape) == 2 else name)
        call = f"{LANGUAGES['fortran'].function_name(form)}({', '.join(names)})"
        lines += [f"    write(11) {f'transpose({call})' if len(form.shape) == 2 else call}", "  end do"]
    return "\n".join([*lines, "  close(11)", "end program driver"]) + "\n"


# -------------------------------------------------------------- what no tool of this machine runs, read by Python


def read_as_python(language, text):
    """Functions of Octave, Julia or Fortran text, by name, as Python functions of arrays.

    A small part of each language: definitions ``name = expression``, several on a line, entries ``a(i,k)`` or
    ``a[i, k]`` from 1, continued lines.
    """
    mark = {"octave": "%", "julia": "#", "fortran": "!"}[language]
    lines = [line.split(mark)[0].rstrip() for line in text.splitlines()]
    text = "\n".join(line for line in lines if line)
    text = re.sub({"octave": r" \.\.\.\n\s*", "fortran": r" &\n\s*", "julia": r"(?<=[-+,])\n\s+"}[language], " ", text)
    head = {
        "octave": r"^function out = (\w+)\((.*?)\)\n(.*?)^end$",
        "julia": r"^function (\w+)\((.*?)\)\n(.*?)^end$",
        "fortran": r"^  pure function (\w+)\((.*?)\) result\(out\)\n(.*?)^  end function",
    }[language]
    functions = {}
    for name, parameters, body in re.findall(head, text, re.DOTALL | re.MULTILINE):
        shape, code, declared = None, [], set()
        for line in re.split(r"[;\n]", body):
            line = line.strip()
            if found := re.match(r"out = zeros\((?:Float64, )?([\d, ]+)\)|real\(dp\) :: out\(([\d,]+)\)", line):
                shape = tuple(int(n) for n in (found[1] or found[2]).split(","))
            elif line.startswith("real(dp)"):
                declared |= set(re.findall(r"\w+", line.split("::")[1]))
            elif line and line not in ("return out", "out = 0.0_dp"):
                assert re.fullmatch(r"\w+(?:[\[(][\d, ]+[\])])? = [\w\s.()\[\],*/^+-]+", line), line
                assert language != "fortran" or line[:3] == "out" or line.split()[0] in declared, line
                line = re.sub(r"(?<![\w.])(\d+)d0|(\d)_dp", r"\1\2", line).replace("^", "**")
                code.append(re.sub(r"(\b[a-zA-Z]\w*)[\[(]([\d, ]+)[\])]", _from_zero, line))
        assert shape is not None
        functions[name] = _function(parameters.replace(" ", "").split(","), shape, "\n".join(code))
    return functions


def _from_zero(match):
    return f"{match[1]}[{', '.join(str(int(k) - 1) for k in match[2].split(','))}]"


def _function(parameters, shape, code):
    compiled = compile(code, "generated", "exec")

    def call(*values):
        out = np.zeros(shape)
        exec(compiled, {"out": out, **dict(zip(parameters, values, strict=True))})
        return out

    return call
