"""The target languages one by one: C, C++, Octave, Julia, Rust, Fortran, JavaScript."""

from __future__ import annotations

import re

from sympy import Expr, Integer, Rational, Symbol
from sympy.printing.c import C99CodePrinter
from sympy.printing.fortran import FCodePrinter
from sympy.printing.jscode import JavascriptCodePrinter
from sympy.printing.julia import JuliaCodePrinter
from sympy.printing.octave import OctaveCodePrinter
from sympy.printing.rust import RustCodePrinter

from .elimination import Derived
from .language import STEM, Form, Language, decimal, reserving
from .matrices import ClosedForm


class _JuliaPrinter(JuliaCodePrinter):
    def _print_Rational(self, expr: Rational) -> str:
        return decimal(expr)


class _CPrinter(C99CodePrinter):
    def _print_Rational(self, expr: Rational) -> str:
        return decimal(expr)


class _JavaScriptPrinter(JavascriptCodePrinter):
    def _print_Rational(self, expr: Rational) -> str:
        return decimal(expr)


class _FortranPrinter(FCodePrinter):
    def _print_Rational(self, expr: Rational) -> str:
        return f"{decimal(expr)}_dp"

    def _wrap_fortran(self, lines: list[str]) -> list[str]:
        return lines  # `Language.wrapped` breaks lines, with the left side in view


class _RustPrinter(RustCodePrinter):
    """Rust multiplies floats by floats only, and warns of names in capitals."""

    def _print_Rational(self, expr: Rational) -> str:
        return decimal(expr)

    def _print_Integer(self, expr: Integer, _type: bool = False) -> str:
        return f"{int(expr)}.0"

    def _print_Symbol(self, expr: Symbol) -> str:
        return str(super()._print_Symbol(Symbol(expr.name.lower())))


class C(Language):
    """C99: flat row-major arrays, a header and a source."""

    name = "c"
    suffix = ".c"
    comment = "//"
    arrays = (
        "Matrices are arrays of double, row by row: entry (i, k) of an m x n matrix, from 0, is a[n*i + k]. `out` may "
        "be one of the arguments."
    )
    printer = reserving(_CPrinter(), "out I NULL")
    prefix = "handeye_"
    writes_zeros = True

    def entry(self, name: str, shape: tuple[int, ...], place: tuple[int, ...]) -> str:
        return f"{name}[{place[0] if len(place) == 1 else place[0] * shape[1] + place[1]}]"

    def define(self, pairs: list[tuple[str, str]]) -> str:
        return f"const double {', '.join(f'{name} = {value}' for name, value in pairs)};"

    def signature(self, form: ClosedForm) -> str:
        """The declaration without its semicolon."""
        arrays = [
            f"const double {self.argument(a)}[{a.shape[0] * (a.shape[1] if len(a.shape) == 2 else 1)}]"
            if a.shape
            else f"double {self.argument(a)}"
            for a in form.arguments
        ]
        return f"void {self.function_name(form)}({', '.join([*arrays, f'double out[{form.size}]'])})"

    def function(self, form: ClosedForm, derived: Derived) -> str:
        return "\n".join([f"{self.signature(form)}", "{", *self.body(form, derived), "}"]) + "\n"

    def files(self, forms: list[Form], version: str) -> dict[str, str]:
        guard = f"{STEM.upper()}_H"
        declarations = [f"{self.description(form)}{self.signature(form)};\n" for form, _ in forms]
        header = [
            f'{self.head(version)}\n#ifndef {guard}\n#define {guard}\n\n#ifdef __cplusplus\nextern "C" {{\n#endif\n',
            *declarations,
            "#ifdef __cplusplus\n}\n#endif\n\n#endif\n",
        ]
        source = [
            f'{self.head(version)}\n#include "{STEM}.h"\n',
            *(f"// {form.equation}; described in {STEM}.h.\n{self.function(form, derived)}" for form, derived in forms),
        ]
        return {f"{STEM}.h": "\n".join(header), f"{STEM}.c": "\n".join(source)}


class Cpp(C):
    """C++11: the functions of C in a namespace, in one header."""

    name = "cpp"
    suffix = ".hpp"
    printer = reserving(_CPrinter(), "out I NULL new this class")
    prefix = ""

    def signature(self, form: ClosedForm) -> str:
        return f"inline {super().signature(form)}"

    def files(self, forms: list[Form], version: str) -> dict[str, str]:
        guard = f"{STEM.upper()}_HPP"
        functions = [f"{self.description(form)}{self.function(form, derived)}" for form, derived in forms]
        head = f"{self.head(version)}\n#ifndef {guard}\n#define {guard}\n\nnamespace handeye {{\n"
        return {f"{STEM}.hpp": "\n".join([head, *functions, "}  // namespace handeye\n\n#endif\n"])}


class Octave(Language):
    """Octave and MATLAB: a file per function."""

    name = "octave"
    suffix = ".m"
    comment = "%"
    arrays = "Matrices are m x n arrays of double; a vector may be a row or a column, a result is a column."
    printer = reserving(OctaveCodePrinter({"contract": False}), "out end pi eps i j e Inf NaN ans")
    indent = "  "
    first = 1
    prefix = "handeye_"
    continued = " ..."

    def text(self, expression: Expr) -> str:
        return re.sub(r"\.([*/^])", r"\1", self.printer.doprint(expression))  # all names are numbers

    def function_name(self, form: ClosedForm) -> str:
        """Return the name with its case; W.m and w.m would be one file on some disks."""
        name = self.prefix + form.name
        return f"{name}_matrix" if Fortran().function_name(form).endswith("_matrix") else name

    def entry(self, name: str, shape: tuple[int, ...], place: tuple[int, ...]) -> str:
        return f"{name}({','.join(str(i + 1) for i in place)})"

    def define(self, pairs: list[tuple[str, str]]) -> str:
        return " ".join(f"{name} = {value};" for name, value in pairs)

    def function(self, form: ClosedForm, derived: Derived) -> str:
        names = ", ".join(map(self.argument, form.arguments))
        rows, columns = (*form.shape, 1)[:2]
        lines = [f"function out = {self.function_name(form)}({names})", f"  out = zeros({rows}, {columns});"]
        return "\n".join([*lines, *self.body(form, derived), "end"]) + "\n"

    def files(self, forms: list[Form], version: str) -> dict[str, str]:
        # the first comment is what `help` shows
        return {
            f"{self.function_name(form)}.m": f"{self.description(form)}\n{self.head(version)}\n"
            + self.function(form, derived)
            for form, derived in forms
        }


class Julia(Language):
    """Julia: a module of functions that give arrays."""

    name = "julia"
    suffix = ".jl"
    comment = "#"
    arrays = "Matrices are m x n arrays, vectors arrays of n numbers; results are Array{Float64}."
    printer = reserving(_JuliaPrinter({"contract": False}), "out end im pi")
    first = 1
    breaks_after = True

    def text(self, expression: Expr) -> str:
        return re.sub(r" ?\.?([*/^]) ", r"\1", self.printer.doprint(expression))  # all names are numbers

    def entry(self, name: str, shape: tuple[int, ...], place: tuple[int, ...]) -> str:
        return f"{name}[{', '.join(str(i + 1) for i in place)}]"

    def define(self, pairs: list[tuple[str, str]]) -> str:
        return "; ".join(f"{name} = {value}" for name, value in pairs)

    def assign(self, target: str, value: str) -> str:
        return f"{target} = {value}"

    def function(self, form: ClosedForm, derived: Derived) -> str:
        names = ", ".join(map(self.argument, form.arguments))
        lines = [f"function {self.function_name(form)}({names})"]
        lines.append(f"    out = zeros(Float64, {', '.join(map(str, form.shape))})")
        return "\n".join([*lines, *self.body(form, derived), "    return out", "end"]) + "\n"

    def files(self, forms: list[Form], version: str) -> dict[str, str]:
        functions = [f"{self.description(form)}{self.function(form, derived)}" for form, derived in forms]
        return {f"{STEM}.jl": "\n".join([f"{self.head(version)}\nmodule HandeyeMatrices\n", *functions, "end\n"])}


class Rust(Language):
    """Rust: free functions on arrays, without allocation."""

    name = "rust"
    suffix = ".rs"
    comment = "//"
    arrays = "Matrices are arrays of rows, [[f64; n]; m]. Names are in small letters: J_11 is j_11, W is w_matrix."
    printer = reserving(_RustPrinter(), "out f64 self")
    ignores_case = True

    def entry(self, name: str, shape: tuple[int, ...], place: tuple[int, ...]) -> str:
        return name + "".join(f"[{i}]" for i in place)

    def define(self, pairs: list[tuple[str, str]]) -> str:
        names, values = ([pair[k] for pair in pairs] for k in (0, 1))
        if len(pairs) == 1:
            return f"let {names[0]} = {values[0]};"
        return f"let ({', '.join(names)}) = ({', '.join(values)});"

    def function(self, form: ClosedForm, derived: Derived) -> str:
        def array(shape: tuple[int, ...]) -> str:
            text = "f64"
            for size in reversed(shape):
                text = f"[{text}; {size}]"
            return text

        inputs = ", ".join(f"{self.argument(a)}: {'&' if a.shape else ''}{array(a.shape)}" for a in form.arguments)
        zeros = array(form.shape).replace("f64", "0.0")
        lines = [f"pub fn {self.function_name(form)}({inputs}) -> {array(form.shape)} {{"]
        lines.append(f"    let mut out = {zeros};")
        return "\n".join([*lines, *self.body(form, derived), "    out", "}"]) + "\n"

    def files(self, forms: list[Form], version: str) -> dict[str, str]:
        functions = [
            f"{self.description(form).replace('// ', '/// ')}{self.function(form, derived)}" for form, derived in forms
        ]
        return {f"{STEM}.rs": "\n".join([self.head(version), *functions])}


class Fortran(Language):
    """Fortran 2003, free form: a module of pure functions."""

    name = "fortran"
    suffix = ".f90"
    comment = "!"
    arrays = (
        "Matrices are arrays of rank 2, real(dp), indexed (row, column) from 1. Capitals do not count in Fortran: the\n"
        "8x8 matrix W is handeye_w_matrix, the vector w handeye_w."
    )
    printer = reserving(_FortranPrinter({"source_format": "free", "standard": 2003}), "dp out result")
    indent = "    "
    first = 1
    prefix = "handeye_"
    ignores_case = True
    continued = " &"

    def text(self, expression: Expr) -> str:
        return super().text(expression).lower()

    def entry(self, name: str, shape: tuple[int, ...], place: tuple[int, ...]) -> str:
        return f"{name}({','.join(str(i + 1) for i in place)})"

    def define(self, pairs: list[tuple[str, str]]) -> str:
        return "; ".join(f"{name} = {value}" for name, value in pairs)

    def assign(self, target: str, value: str) -> str:
        return f"{target} = {value}"

    def function(self, form: ClosedForm, derived: Derived) -> str:
        def array(name: str, shape: tuple[int, ...]) -> str:
            return f"{name}({','.join(map(str, shape))})" if shape else name

        used, name = self.used(derived), self.function_name(form)
        local = [self.text(s) for a in form.arguments for s, place in a.symbols if s in used and place]
        local += [self.text(symbol) for symbol, _ in derived.temporaries]
        lines = [f"  pure function {name}({', '.join(map(self.argument, form.arguments))}) result(out)"]
        lines += [f"    real(dp), intent(in) :: {array(self.argument(a), a.shape)}" for a in form.arguments]
        lines.append(f"    real(dp) :: {array('out', form.shape)}")
        lines += self.wrapped([f"real(dp) :: {', '.join(local)}"])
        lines.append("    out = 0.0_dp")
        return "\n".join([*lines, *self.body(form, derived), f"  end function {name}"]) + "\n"

    def files(self, forms: list[Form], version: str) -> dict[str, str]:
        functions = [f"{self.description(form)}{self.function(form, derived)}" for form, derived in forms]
        public = "".join(f"  public :: {self.function_name(form)}\n" for form, _ in forms)
        head = (
            f"{self.head(version)}\nmodule {STEM}\n  implicit none\n  private\n{public}"
            "  integer, parameter :: dp = kind(1.0d0)\n\ncontains\n"
        )
        return {f"{STEM}.f90": "\n".join([head, *functions, f"end module {STEM}\n"])}


class JavaScript(Language):
    """JavaScript: an ES module."""

    name = "javascript"
    suffix = ".mjs"
    comment = "//"
    arrays = "Matrices are arrays of rows, vectors arrays of numbers."
    printer = reserving(_JavaScriptPrinter(), "out await static let yield enum")
    indent = "  "

    def entry(self, name: str, shape: tuple[int, ...], place: tuple[int, ...]) -> str:
        return name + "".join(f"[{i}]" for i in place)

    def define(self, pairs: list[tuple[str, str]]) -> str:
        return f"const {', '.join(f'{name} = {value}' for name, value in pairs)};"

    def function(self, form: ClosedForm, derived: Derived) -> str:
        zeros = f"new Array({form.shape[-1]}).fill(0)"
        if len(form.shape) == 2:
            zeros = f"Array.from({{ length: {form.shape[0]} }}, () => {zeros})"
        names = ", ".join(map(self.argument, form.arguments))
        lines = [f"export function {self.function_name(form)}({names}) {{", f"  const out = {zeros};"]
        return "\n".join([*lines, *self.body(form, derived), "  return out;", "}"]) + "\n"

    def files(self, forms: list[Form], version: str) -> dict[str, str]:
        functions = [f"{self.description(form)}{self.function(form, derived)}" for form, derived in forms]
        return {f"{STEM}.mjs": "\n".join([self.head(version), *functions])}


LANGUAGES: dict[str, Language] = {
    language.name: language for language in (C(), Cpp(), Octave(), Julia(), Rust(), Fortran(), JavaScript())
}
