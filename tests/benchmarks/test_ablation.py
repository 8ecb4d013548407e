"""The ablation: every setting is changed, differences are paired, and the table goes where it belongs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.ablation.effects import effects_of, t_interval
from benchmarks.ablation.rows import WHOLE, changes, choose_rows, other
from benchmarks.ablation.table import BEGIN, END, markdown, write_into
from benchmarks.ablation.trials import Trial
from benchmarks.choices import settings_with
from common.errors import InputError
from common.settings import PRESETS, FilterSettings, RefineSettings


def trial(recording: str, seed: int, row: str, percent: float) -> Trial:
    """What a row made of a recording, raw ten points less."""
    return Trial(recording, seed, row, percent, percent - 10.0, 100.0)


def test_every_setting_is_changed_alone() -> None:
    """One row for each refine and filter setting, and each is another run than the preset's."""
    fields = [*RefineSettings.__struct_fields__, *FilterSettings.__struct_fields__]
    assert [change.partition("=")[0] for change in changes()] == fields
    for change in changes():
        assert settings_with((change,)) != PRESETS["default"]
    assert choose_rows()[0].settings(0) == PRESETS["default"]


def test_a_change_is_the_papers_value_or_half_or_double() -> None:
    """Counts are halved, as more of them cost more; other numbers are doubled."""
    assert other("camera", "distance") == "distance"
    assert other(value := True, False) is not value
    assert other(20, 20) == 10
    assert other(0.1, 0.1) == 0.2


def test_differences_are_paired_by_recording() -> None:
    """Recordings that differ a lot from each other, and by two points from the unchanged: two, surely."""
    trials = [
        trial(f"a{n}", seed, row, 50.0 + 5.0 * n + seed + gain + 0.1 * n)
        for n in range(8)
        for seed in range(3)
        for row, gain in ((WHOLE, 0.0), ("x=1", 2.0 + 0.1 * (n % 2)))
    ]
    unchanged, changed = effects_of(trials, [WHOLE, "x=1"])
    assert unchanged.difference is None
    assert changed.difference is not None
    assert changed.difference.mean == pytest.approx(2.05)
    assert changed.difference.low < 2.05 < changed.difference.high < 2.2
    assert changed.difference.shows


def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    """Of many experiments of twenty recordings, 95 %."""
    rng = np.random.default_rng(0)
    found = [t_interval(1.0 + rng.normal(size=20)) for _ in range(1000)]
    assert np.mean([one.low <= 1.0 <= one.high for one in found]) == pytest.approx(0.95, abs=0.02)


def test_the_table_replaces_what_stands_between_the_marks(tmp_path: Path) -> None:
    """And nothing else; a document without marks is refused."""
    document = tmp_path / "page.md"
    document.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    lines = list(markdown(effects_of([trial("a1", 0, WHOLE, 90.0)], [WHOLE])))
    write_into(document, lines)
    assert document.read_text() == "\n".join(["before", BEGIN, *lines, END, "after", ""])
    assert "| preset default | 90.0 % |" in document.read_text()
    document.write_text("nothing")
    with pytest.raises(InputError, match="add both"):
        write_into(document, lines)
