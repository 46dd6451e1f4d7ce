"""Documents as text: wrapped to a width, with the roles that a terminal shows in colour."""

import pytest

from uq_handeye.core.presentation.document import (
    Answer,
    Caution,
    Checks,
    Heading,
    Paragraph,
    Points,
    Table,
    to_text,
)

LONG = "Rotation about gripper z is 2.1 times less certain than about its best direction (0.059 against 0.028 deg)."
CHECKS = Checks(
    [("ok", "pairing", "rows fit"), ("caution", "noise level", "1.5 times the noise given"), ("not run", "halves", "")]
)


@pytest.mark.parametrize("width", [40, 80, 118])
def test_text_is_wrapped_to_the_width(width):
    table = Table(LONG, ["", "cell"], [["a", (LONG, 1)]])
    text = to_text([Answer(LONG), Paragraph(LONG), Caution(LONG), Points([LONG]), table], width)
    assert max(map(len, text.splitlines())) <= width
    assert " ".join(text.split()).count(LONG) == 6


def test_checks_stand_in_columns():
    assert to_text([CHECKS]) == (
        "ok       pairing      rows fit\ncaution  noise level  1.5 times the noise given\nnot run  halves\n"
    )


def test_a_style_is_given_the_roles_and_changes_no_layout():
    document = [
        [Heading("X"), Answer("Known to 1 mm.", "caution"), Answer("NOT USABLE", "failed")],
        Caution("A doubt."),
        CHECKS,
    ]
    seen = []

    def style(text, role):
        seen.append((text, role))
        return f"<{text}>"

    text = to_text(document, 80, style)
    assert text.replace("<", "").replace(">", "") == to_text(document, 80)
    assert seen[:5] == [
        ("X", "heading"),
        ("Known to 1 mm.", "answer"),
        ("NOT USABLE", "failed"),
        ("<NOT USABLE>", "answer"),
        ("CAUTION:", "caution"),
    ]
    assert [role for _, role in seen[5:]] == ["ok", "caution", "not run"]
    assert "<caution>  noise level" in text
