"""Tables of the documentation that repeat what the code holds are those of the code."""

import re
import runpy

import pytest
from fixtures.pages import DOCS

SCRIPT = runpy.run_path(str(DOCS / "figures" / "tables.py"))


def test_every_table_is_on_one_page():
    names = [found[1] for page in SCRIPT["pages"]() for _, found in _marked(page)]
    assert sorted(names) == sorted(SCRIPT["TABLES"])


def _marked(page):
    return enumerate(re.finditer(r"<!-- table: (\w+) -->", page.read_text(encoding="utf-8")))


@pytest.mark.parametrize("page", SCRIPT["pages"](), ids=lambda page: page.stem)
def test_tables_are_those_of_the_code(page):
    text = page.read_text(encoding="utf-8")
    assert SCRIPT["made"](text) == text, "run: python docs/figures/tables.py"


def test_a_table_that_differs_is_seen(tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- table: levels -->\n| old |\n<!-- end of table -->\nafter\n", encoding="utf-8")
    main = SCRIPT["main"]
    monkeypatch.setitem(main.__globals__, "DOCS", tmp_path)
    assert main(["--check"]) == 1 and "old" in page.read_text(encoding="utf-8")
    assert main([]) == 0 and "| INTERVAL | 0.95 |" in page.read_text(encoding="utf-8")
    assert main(["--check"]) == 0
