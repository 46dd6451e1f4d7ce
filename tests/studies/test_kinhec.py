"""The study of KinHEC goes on where it was interrupted."""

from pathlib import Path

import pytest

from studies import kinhec


def test_an_interrupted_run_is_continued(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[str, int]] = []

    def sequence_of(track: str, number: int, full: bool) -> tuple[str, int]:
        if len(made) == 5:
            raise KeyboardInterrupt
        made.append((track, number))
        return track, number

    monkeypatch.setattr(kinhec, "sequence_of", sequence_of)
    monkeypatch.setattr(kinhec, "row_of", lambda of: {"track": of[0], "error_mm": float(of[1])})
    kept = tmp_path / "kept.jsonl"
    with pytest.raises(KeyboardInterrupt):
        kinhec.measure(False, kept)
    with kept.open("a", encoding="utf-8") as file:
        file.write('\n{"full": false, "num')  # killed while it wrote
    first = [*made]
    made.clear()
    monkeypatch.setattr(kinhec, "sequence_of", lambda track, number, full: made.append((track, number)) or made[-1])
    table = kinhec.measure(False, kept)["sequences"]
    everything = [(track, number) for track in kinhec.TRACKS for number in range(kinhec.QUICK_COUNT)]
    assert len(first) == 5 and sorted(first + made) == sorted(everything)
    assert [*zip(table.track, table.number, strict=True)] == everything
    made.clear()
    kinhec.measure(False, kept)
    assert not made
