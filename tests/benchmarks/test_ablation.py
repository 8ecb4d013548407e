"""The ablation: every setting is changed, differences are paired, and the table goes where it belongs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.ablation.effects import Difference, Effect, effects_of, t_interval
from benchmarks.ablation.measure import Choice, choose_jobs, finished, summarise, until
from benchmarks.ablation.rows import WHOLE, changes, choose_rows, other
from benchmarks.ablation.table import BEGIN, END, markdown, where_it_shows, write_into
from benchmarks.ablation.trials import Trial, try_all
from benchmarks.choices import settings_with
from benchmarks.command_line import DATA
from benchmarks.frame_rates.rows import Row
from benchmarks.frame_rates.scores import near_percent
from benchmarks.frame_rates.trials import track_thinned
from benchmarks.people import keep
from benchmarks.sequences import find_people
from benchmarks.tracking import prepare
from common.errors import InputError
from common.settings import PRESETS, FilterSettings, RefineSettings


def choice(out: Path, frames: int = 14, only: tuple[str, ...] | None = None) -> Choice:
    """A person's two recordings, twice."""
    return Choice(DATA, [1], [3, 22], only, 3, frames, 2, None, out, None)


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


def test_some_settings_can_be_chosen() -> None:
    """Beside the unchanged preset and the simplest things; one that there is not is refused by name."""
    names = [row.name for row in choose_rows(["explore"])]
    assert names == [WHOLE, "explore=false", "1 particle", "never moves"]
    with pytest.raises(InputError, match="no setting 'magic'; choose from icp_iterations"):
        choose_rows(["magic"])


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


def test_the_table_says_where_a_change_shows() -> None:
    """An interval that leaves zero out, of the shares with offsets removed, of the raw, of both or none."""
    yes, no = Difference(-2.0, -3.0, -1.0), Difference(-2.0, -5.0, 1.0)
    pairs = {
        "both": (yes, yes),
        "raw": (no, yes),
        "offsets removed": (yes, no),
        "no": (no, no),
        "": (None, None),
    }
    for said, (removed, raw) in pairs.items():
        assert where_it_shows(Effect("x=1", 90.0, 85.0, 100.0, removed, raw)) == said


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


def test_a_run_goes_on_where_it_was_broken_off(tmp_path: Path) -> None:
    """Trials of the same settings and frames are kept; a file of others is left alone."""
    out = tmp_path / "ablation.json"
    trials = [trial("a3_s1", 0, row.name, 90.0) for row in choose_rows()]
    assert finished(choice(out)) == []
    keep(summarise(choice(out), trials), out)
    assert finished(choice(out)) == trials
    for asked in (choice(out, frames=10), choice(out, only=("explore",))):
        with pytest.raises(InputError, match="trials of other settings"):
            finished(asked)
    out.write_text('{"effects": []}')
    with pytest.raises(InputError, match="give another file with --out"):
        finished(choice(out))


@pytest.mark.skipif(not (DATA / "utd_mhad").exists(), reason="the UTD-MHAD data are not there")
def test_every_recording_has_a_seed_before_any_has_two(tmp_path: Path) -> None:
    """So that a run that is broken off has them all; and none begins when the time is over."""
    jobs = choose_jobs(choice(tmp_path / "none"))
    assert [(seed, recording.name) for seed, recording in jobs] == [
        (0, "a3_s1"), (0, "a22_s1"), (1, "a3_s1"), (1, "a22_s1")
    ]  # fmt: skip
    assert list(until(None, jobs)) == jobs
    assert not list(until(0.0, jobs))


@pytest.mark.skipif(not (DATA / "utd_mhad").exists(), reason="the UTD-MHAD data are not there")
def test_a_shared_first_frame_changes_nothing() -> None:
    """Who goes on from the first frame of another tracker does as one that was alone."""
    (recording,) = (one for one in find_people(DATA / "utd_mhad") if one.name == "a3_s1")
    row, bodies = Row("few", ("points=400",), 2), prepare()
    alone = track_thinned(recording, 12, row.settings(1), bodies)
    both = try_all(recording, 1, (row, row), 12, 100, bodies)
    for one in both:
        assert one.percent == near_percent(alone.offset_removed)
        assert one.raw_percent == near_percent(alone.raw)
    assert both[0].percent > 50.0
