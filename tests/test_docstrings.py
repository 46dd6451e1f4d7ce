"""Docstrings and messages in plain terms: how a docstring begins, and words that do not occur."""

import ast
import functools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ["uq_handeye", "symbolic", "studies", "tests", "docs"]

# Words that begin a fragment, which says neither what a function does nor what it returns.
FRAGMENTS = re.compile(r"(Of|At|By|With|And|So|What|Whether|From|Where|How|As|In|That|Why|Which|Who)\b")
# A verb that says what a function does is an imperative.
THIRD_PERSON = re.compile(r"(Adds|Computes|Gives|Makes|Puts|Raises|Returns|Says|Shows|Takes|Tells|Writes)\b")
# Terms with a better one in the field.
ODD = re.compile(
    r"\b(tell|told) apart\b|\bworked out\b|\banew\b|\bin the mean\b|\bweighted down\b|\bgross errors?\b"
    r"|\b(noise|components) (did|do|does) not stand still\b|\buntil (it|they) stands? still\b"
    r"|\bcovariances? (is|are) true\b|\btrue covariance\b(?! of)|\bwrong poses\b",
    re.IGNORECASE,
)
STATUS = "not told apart"  # of a noise component in result files; people read "not identifiable"


@functools.cache
def texts(package):
    """Return place, whether it is a docstring, and text of every string in a package."""
    found = []
    for file in sorted((ROOT / package).rglob("*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
        docstrings = {
            id(node.body[0].value)
            for node in ast.walk(tree)
            if isinstance(node, documented) and ast.get_docstring(node) and isinstance(node.body[0], ast.Expr)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append((f"{file.relative_to(ROOT)}:{node.lineno}", id(node) in docstrings, node.value))
    return found


@pytest.mark.docs
@pytest.mark.parametrize("package", PACKAGES)
def test_docstrings_open_with_an_imperative_or_a_noun_phrase(package):
    openings = [(at, text.strip().partition("\n")[0]) for at, is_docstring, text in texts(package) if is_docstring]
    assert len(openings) > 20
    found = [f"{at}: {line}" for at, line in openings if FRAGMENTS.match(line) or THIRD_PERSON.match(line)]
    assert found == []


@pytest.mark.docs
@pytest.mark.parametrize("package", ["uq_handeye", "symbolic"])
def test_texts_use_the_terms_of_the_field(package):
    found = [
        f"{at}: {text[:100]}"
        for at, _, text in texts(package)
        if ODD.search(re.sub(rf'^{STATUS}$|"{STATUS}"', "", text))
    ]
    assert found == []


def test_a_fragment_and_an_odd_term_are_seen():
    for line in ("Of the parameters.", "Whether it is flat.", "What was chosen."):
        assert FRAGMENTS.match(line)
    assert not FRAGMENTS.match("Inverse of T.") and not FRAGMENTS.match("Write it.")
    assert THIRD_PERSON.match("Returns it.") and ODD.search("It is worked out.") and ODD.search("cannot be told apart")
