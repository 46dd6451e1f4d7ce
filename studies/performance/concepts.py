"""Counts of what a reader of the package must hold, beside those of an earlier commit.

    python -m studies.performance.concepts [COMMIT]

Counted in uq_handeye/ and symbolic/ (generated closed forms apart), now and at the commit (default: the one before
issue 42): classes, those that are a NamedTuple apart; numeric constants of modules, and the numbers that moved from
there to defaults of arguments, to entries of dictionaries and into constant expressions (growth since the commit);
`Any`, `object` and `type: ignore`; names of constants with several values; files with a constant below their first
definition; options of `calibrate`; size of the changelog.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from studies.performance.against_commit import BEFORE, FROM_TREE

PACKAGES = ("uq_handeye/", "symbolic/")
OPTIONS = """
import typer.main
from uq_handeye.cli.app import app
print(sum(value.param_type_name == "option" for value in typer.main.get_command(app).commands["calibrate"].params))
"""


def sources(root: Path, commit: str | None) -> Iterator[tuple[str, str]]:
    """Yield name and text of each Python file, of the work tree or of a commit."""
    listed = ["ls-files"] if commit is None else ["ls-tree", "-r", "--name-only", commit]
    for name in git(root, *listed).splitlines():
        if name.startswith(PACKAGES) and name.endswith(".py") and "_closed_form" not in name:
            if commit is not None:
                yield name, git(root, "show", f"{commit}:{name}")
            elif (root / name).exists():
                yield name, (root / name).read_text()


def git(root: Path, *arguments: str) -> str:
    """Return what a command of Git prints."""
    return subprocess.run(["git", "-C", root, *arguments], capture_output=True, text=True, check=True).stdout


def is_number(node: ast.AST) -> bool:
    """Return whether an expression is a number, with or without a sign."""
    value = node.operand if isinstance(node, ast.UnaryOp) else node
    return isinstance(value, ast.Constant) and type(value.value) in (int, float)


def assigned(statement: ast.stmt) -> Iterator[tuple[str, ast.expr]]:
    """Yield names and values of an assignment; those of a tuple one by one."""
    if isinstance(statement, ast.AnnAssign) and statement.value is not None:
        yield ast.unparse(statement.target), statement.value
    elif isinstance(statement, ast.Assign):
        for target in statement.targets:
            if isinstance(target, ast.Tuple) and isinstance(statement.value, ast.Tuple):
                yield from zip(map(ast.unparse, target.elts), statement.value.elts, strict=True)
            else:
                yield ast.unparse(target), statement.value


def count(root: Path, commit: str | None) -> dict[str, int]:
    """Return the counts of the work tree, or of a commit, by what they are of."""
    found: dict[str, int] = defaultdict(int)
    values: dict[str, set[str]] = defaultdict(set)
    for _, text in sources(root, commit):
        tree = ast.parse(text)
        for word in ("Any", "object"):
            found[f"`{word}`"] += len(re.findall(rf"\b{word}\b", text))
        found["`type: ignore`"] += text.count("type: ignore")
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                is_tuple = any("NamedTuple" in ast.unparse(base) for base in node.bases)
                found["classes, NamedTuple" if is_tuple else "classes, other"] += 1
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                defaults = [*node.args.defaults, *node.args.kw_defaults]
                found["numbers: defaults of arguments"] += sum(one is not None and is_number(one) for one in defaults)
        late = defined = False
        for statement in tree.body:
            defined |= isinstance(statement, ast.FunctionDef | ast.ClassDef)
            for name, value in assigned(statement):
                numbers = sum(map(is_number, value.elts if isinstance(value, ast.Tuple) else [value]))
                found["numeric constants of modules"] += numbers
                late |= defined and numbers > 0
                inside = list(ast.walk(value))
                entries = [entry for one in inside if isinstance(one, ast.Dict) for entry in one.values]
                found["numbers: entries of dictionaries"] += sum(map(is_number, entries))
                found["numbers: constant expressions"] += not numbers and not entries and any(map(is_number, inside))
                if numbers and name.isupper():
                    values[name].add(ast.unparse(value))
        found["files with constants below a definition"] += late
    found["classes in sum"] = found["classes, other"] + found["classes, NamedTuple"]
    found["names of constants with several values"] = sum(len(several) > 1 for several in values.values())
    changelog = (root / "CHANGELOG.md").read_text() if commit is None else git(root, "show", f"{commit}:CHANGELOG.md")
    found["size of the changelog (bytes)"] = len(changelog.encode())
    return found


def options(root: Path) -> int:
    """Return the number of options of `calibrate`."""
    program = [sys.executable, "-c", FROM_TREE + OPTIONS, str(root)]
    return int(subprocess.run(program, capture_output=True, text=True, check=True).stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("commit", nargs="?", default=BEFORE)
    commit = parser.parse_args().commit
    root = Path(__file__).resolve().parents[2]
    before, now = count(root, commit), count(root, None)
    for what in sorted(now):
        print(f"{what:45} {before[what]:7d} {now[what]:7d}")
    moved = sum(max(now[what] - before[what], 0) for what in now if what.startswith("numbers: "))
    print(f"{'numeric constants, with those that only moved':45} {before['numeric constants of modules']:7d} ", end="")
    print(f"{now['numeric constants of modules'] + moved:7d}")
    print(f"{'options of calibrate':45} {'':7} {options(root):7d}")


if __name__ == "__main__":
    main()
