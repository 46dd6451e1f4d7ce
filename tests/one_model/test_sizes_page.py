"""The page of the model has the sizes that are used."""

from pathlib import Path

import pytest

from uq_handeye.model.shared_errors.sizes import SIZES

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "one_model.md"


@pytest.mark.parametrize("name", SIZES)
def test_every_size_is_on_the_page(name):
    size = SIZES[name]
    row = next(line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| {name} |"))
    assert f"{size.median:g}" in row and ("known" if size.is_known else f"factor {size.factor:g}") in row
