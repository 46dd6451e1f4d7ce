"""One list of sections, of which outputs show some."""

import pytest

import uq_handeye as uq
from uq_handeye.calibration.report import rig_sections
from uq_handeye.calibration.report.text import LONG, NOTEBOOK, NOTEBOOK_FOLDED, calibration_parts
from uq_handeye.core.presentation.document import Paragraph, to_text
from uq_handeye.core.presentation.sections import Part, selected, text_of
from uq_handeye.report.rig_page import FOLDED


def listed():
    return (
        Part("one", "First", lambda: [Paragraph("a")]),
        Part("two", "Second", lambda: 1 / 0),
        Part("three", "Third", list),
        Part("four", "Fourth", lambda: [Paragraph("why it is missing", empty=True)]),
        Part("five", "Fifth", lambda: [Paragraph("b")]),
    )


def test_sections_come_in_the_order_of_the_list_and_only_those_selected_are_made():
    found = selected(listed(), ("five", "three", "four", "one"), wide=True)
    assert [(one.anchor, one.wide) for one in found] == [("one", True), ("four", True), ("five", True)]
    assert to_text(text_of(found, untitled=("one",))) == "a\n\nFifth:\nb\n"
    with pytest.raises(ZeroDivisionError):
        selected(listed(), ("two",))


@pytest.mark.slow
def test_outputs_name_sections_that_there_are():
    result = uq.calibrate(uq.simulate(n_poses=6, seed=1))
    named = {part.anchor for part in calibration_parts(result)}
    rare = {"cautions", "notes"}  # one section for each finding
    assert {*LONG, *NOTEBOOK, *NOTEBOOK_FOLDED} <= named | rare
    assert len(set(LONG)) == len(LONG)


def test_outputs_of_rigs_name_sections_that_there_are():
    anchors = [part.anchor for part in rig_sections.rig_parts(None)]
    assert len(set(anchors)) == len(anchors)
    pages = ("answer", "next", "poses", "pairs", "checks", "views", "noise", *FOLDED, "stated", "stated-pairs")
    assert set(anchors) == {*rig_sections.LONG, *pages}
