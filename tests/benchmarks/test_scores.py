"""Scores of benchmarks on known joints, and wrong options."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks import ablation, people, placement, rooms
from benchmarks.people import GROUPS, Row, Trial
from benchmarks.recordings import JOINTS, Recording
from benchmarks.running import Crash, run_forked, settings_with
from benchmarks.tracking import Outcome
from gepf.common.arrays import Array
from gepf.common.errors import InputError
from gepf.common.settings import RefineSettings
from gepf.coordinator.settings import PRESETS, FilterSettings

FRAMES = 30


def outcome(name: str, errors: Array, subject: int = 1) -> Outcome:
    """A recording that was tracked with these errors (F, J), all in one direction, metres."""
    recording = Recording(name, Path(name), Path(name), 3, subject)
    reference = np.random.default_rng(0).normal(size=(*errors.shape, 3))
    joints = reference + errors[..., None] * np.array([1.0, 0.0, 0.0])
    holds = np.ones(errors.shape, dtype=bool)
    status = {"tracked": len(errors), "lost": 0, "searching": 0, "absent": 0}
    return Outcome(recording, joints, reference, holds, np.full(len(errors), 0.05), 19.0, status, 1.75)


def trial(name: str, row: str = "row", seed: int = 0) -> Trial:
    """A trial of a recording with a row and a seed."""
    return Trial(Row(row), 3, seed, Recording(name, Path(name), Path(name), 3, 1))


def test_a_constant_offset_is_removed_and_nothing_else() -> None:
    """Raw errors are the offset of each joint; without it only a single jump remains, unchanged."""
    errors = np.full((FRAMES, 2), 0.2)
    errors[7, 1] = 0.5
    tracked = outcome("a3_s1", errors)
    assert tracked.distances(raw=True) == pytest.approx(errors)
    assert tracked.distances(raw=False) == pytest.approx(errors - 0.2)


def test_every_joint_counts_the_same_and_the_worst_recording_is_named() -> None:
    """A long recording weighs more than a short one; invalid references count only among all joints."""
    good, bad = outcome("a3_s1", np.full((30, 1), 0.02)), outcome("a3_s2", np.full((10, 1), 0.4), 2)
    spoilt = outcome("a3_s3", np.full((10, 1), 0.9), 3)
    spoilt.holds[:] = False
    outcomes = {trial("a"): good, trial("b"): bad, trial("c"): spoilt}
    (score,) = people.score_all(outcomes, GROUPS["data"])
    assert (score.raw_percent, score.all_raw_percent) == (75.0, 60.0)
    assert score.raw_cm == pytest.approx((30 * 2 + 10 * 40) / 40)
    assert score.percent == 100.0
    assert score.status["tracked"] == 50


def test_seeds_are_averaged_and_groups_are_kept_apart() -> None:
    """One score for each subject, the mean of two seeds, and the stature's spread between recordings."""
    off, right = np.tile([[0.0], [0.3]], (5, 1)), np.zeros((10, 1))
    outcomes = {
        trial("a3_s1", seed=0): outcome("a3_s1", right),
        trial("a3_s1", seed=1): outcome("a3_s1", off),
        trial("a4_s1", seed=0): replace(outcome("a4_s1", right), stature=1.77),
        trial("a4_s1", seed=1): replace(outcome("a4_s1", right), stature=1.77),
        trial("a3_s2", seed=0): outcome("a3_s2", right, 2),
    }
    first, second = people.score_all(outcomes, lambda recording: recording.name[-2:])
    assert first.by_seed[0] == 100.0
    assert first.raw_percent == 87.5  # of both seeds
    assert (first.stature_range_cm, second.stature_range_cm) == pytest.approx((2.0, 0.0))


def test_rows_and_settings_that_make_no_sense_are_refused() -> None:
    """One line for the user, before anything is tracked."""
    assert [row.name for row in people.choose_rows(["never moves"])] == ["never moves"]
    with pytest.raises(InputError, match="choose from never moves"):
        people.choose_rows(["sometimes moves"])
    for change in ("particles", "nonsense=1", "icp_iterations=many", "preset=none"):
        with pytest.raises(InputError):
            settings_with([change])


def fail_or_double(job: int) -> int:
    """Double a job; 0 raises."""
    return 2 * (job // job) * job


def die(job: int) -> int:
    """End the process at once."""
    os.kill(os.getpid(), signal.SIGKILL)
    return job


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_a_crash_is_reported_and_the_others_go_on() -> None:
    """A job that raises has its traceback, the others have results; a killed process is reported."""
    found = dict(run_forked(fail_or_double, [1, 0, 2, 3], processes=2))
    assert [found[job] for job in (1, 2, 3)] == [2, 4, 6]
    raised = found[0]
    assert isinstance(raised, Crash)
    assert "ZeroDivisionError" in raised.error
    (killed,) = dict(run_forked(die, [1], processes=1)).values()
    assert isinstance(killed, Crash)
    assert "BrokenProcessPool" in killed.error


@pytest.mark.parametrize("benchmark", [people, ablation, placement])
def test_without_data_a_benchmark_says_so(
    benchmark: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 and one line that names the option, no table."""
    assert benchmark.main(["--data", str(tmp_path)]) == 2  # type: ignore[attr-defined]
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "--data" in err


def test_every_setting_is_changed_alone() -> None:
    """One row for each refine and filter setting, and each differs from the preset."""
    fields = [*RefineSettings.__struct_fields__, *FilterSettings.__struct_fields__]
    fields.remove("exploration")  # a stage of its own
    unchanged, *changed = ablation.choose_rows()[:-2]
    assert [row.name.partition("=")[0] for row in changed] == fields
    assert unchanged.settings(0) == PRESETS["default"]
    assert all(row.settings(0) != PRESETS["default"] for row in changed)
    with pytest.raises(InputError, match="no setting 'magic'"):
        ablation.choose_rows(["magic"])


def test_differences_are_paired_by_recording() -> None:
    """Recordings that differ strongly, each by ten points from the unchanged: ten, significant."""
    outcomes = {}
    for n in range(8):
        for name, off in ((ablation.UNCHANGED.name, 5 * n), ("x=1", 5 * n + 10)):
            errors = np.where(np.arange(100) < 55 - off, 0.0, 0.3)[:, None]
            outcomes[trial(f"a{n}", name)] = outcome(f"a{n}_s1", errors)
    unchanged, changed = ablation.effects_of(outcomes)
    assert unchanged.difference is None
    assert changed.raw_difference is not None
    assert changed.raw_difference.mean == pytest.approx(-10.0)
    assert changed.raw_difference.shows
    assert any("| `x=1` |" in line for line in ablation.markdown([unchanged, changed]))


def test_a_linear_map_finds_where_a_reference_has_its_joints() -> None:
    """A shoulder moved by a tenth of the way to its elbow, on frames not used for the fit."""
    rng, count = np.random.default_rng(0), 400
    rest = rng.normal(size=(len(JOINTS), 3))
    posed = rest + 0.2 * rng.normal(size=(count, *rest.shape))
    joints = np.einsum("fij,fkj->fki", Rotation.random(count, random_state=0).as_matrix(), posed)
    reference = joints.copy()
    shoulder, elbow = JOINTS.index("left_shoulder"), JOINTS.index("left_elbow")
    reference[:, shoulder] += 0.1 * (joints[:, elbow] - joints[:, shoulder])
    known = replace(outcome("a3_s1", np.zeros((count, 13))), joints=joints[:300], reference=reference[:300])
    off = {
        name: np.linalg.norm(mapped(joints[300:]) - reference[300:], axis=-1).mean()
        for name, mapped in placement.learn([known]).items()
    }
    assert off["linear map"] < 0.2 * off["constant offsets"] < 0.2 * off["as tracked"]


def test_a_room_is_scored_beside_the_recording_without_it() -> None:
    """By all joints, and by the frames in which the tracker reports no known pose."""
    alone, inside = outcome("a3_s1", np.zeros((10, 1))), outcome("a3_s1", np.tile([[0.0], [0.3]], (5, 1)))
    inside.status.update(tracked=7, lost=2, absent=1)
    score = rooms.score("plain", alone, inside)
    assert (score.recording, score.alone_percent, score.unknown) == ("a3_s1", 100.0, 3)
    assert score.points < 0.0
    with pytest.raises(InputError, match="no room 'cellar'"):
        rooms.choose_jobs(Path(), None, ["cellar"])
