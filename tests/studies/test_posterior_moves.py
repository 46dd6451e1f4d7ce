"""The study of the moves: ratios and verdicts follow the table."""

import pandas as pd
import pytest

from studies.posterior_moves import LONG_ENOUGH, MIX, MOVES, figures, findings, per_second, problems, sampled

pytestmark = pytest.mark.slow


def table(samples_of_mix, steps=1000):
    rows = [
        {
            "posterior": "60 pairs",
            "moves": name,
            "acceptance": 0.5,
            "autocorrelation_steps": 10.0,
            "steps": steps,
            "effective_samples": samples_of_mix if name == MIX else 2000.0 if name == "independence" else 1000.0,
            "sampling_ms": 100.0,
            "long_enough": steps >= LONG_ENOUGH * 10,
        }
        for name in MOVES
    ]
    return pd.DataFrame(rows)


def test_rates_are_multiples_of_the_stretch_move():
    found = table(5000.0).assign(ratio=per_second).set_index("moves")["ratio"]
    assert found["stretch"] == 1 and found[MIX] == pytest.approx(5) and found["independence"] == pytest.approx(2)


def test_findings_turn_with_the_table():
    fast, slow = (findings({"moves": table(samples)}) for samples in (5000.0, 500.0))
    assert "fastest in 1 of 1 posteriors" in fast and "at most 1.0 times slower" in fast
    assert "fastest in 0 of 1 posteriors (fastest: independence in 1)" in slow and "at most 4.0 times slower" in slow
    assert f"0 of 6 chains are shorter than {LONG_ENOUGH}" in fast
    short = findings({"moves": table(500.0, steps=100)})
    assert "6 of 6 chains are shorter" in short and short.count("(chain too short)") == 6
    assert set(figures({"moves": table(500.0, steps=100)})) == {"moves"}


def test_independent_draws_forget_at_once():
    density = problems()["60 pairs (70)"]
    found = sampled(density, MOVES["independence"], 100, 60)
    assert found["acceptance"] > 0.6 and found["autocorrelation_steps"] < 4 and found["steps"] == 60
