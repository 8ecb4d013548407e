"""The rooms benchmark: which rooms there are, how a cut is scored, and a line where data is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.rooms.__main__ import SHARED, main
from benchmarks.rooms.composing import KINDS, choose_jobs
from benchmarks.rooms.scores import RoomScore
from benchmarks.rooms.watching import WatchedIsolation
from common.errors import InputError
from tests.support.rooms import Room

PEOPLE = SHARED / "data" / "utd_mhad"
needs_people = pytest.mark.skipif(not PEOPLE.is_dir(), reason="UTD-MHAD is not beside the checkout")


@needs_people
def test_everybody_is_put_into_the_rooms_that_are_asked_for() -> None:
    """27 actions of two people plain and cluttered, ten with a table and a visitor, five before a wall."""
    jobs = choose_jobs(PEOPLE.parent, None, None)
    count = {kind: sum(kind in job.kinds for job in jobs) for kind in KINDS}
    assert count == {"plain": 54, "cluttered": 54, "table": 10, "visitor": 10, "wall": 5}
    assert [job.kinds for job in choose_jobs(PEOPLE.parent, ["a3_s1"], ["wall", "plain"])] == [
        ("plain", "wall")
    ]
    with pytest.raises(InputError, match="no room 'cellar'"):
        choose_jobs(PEOPLE.parent, None, ["cellar"])


def test_missing_data_is_said_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, and how to mend it."""
    assert main(["--shared", str(tmp_path)]) == 2
    assert "--shared" in capsys.readouterr().err


def test_a_cut_is_scored_by_its_pixels() -> None:
    """Where nothing is cut out the recall sinks; where the mask is another's, precision does."""
    room = Room()
    person = room.see((0.0, 2.4), 0)
    masks = np.stack([person.mask, person.mask, np.zeros_like(person.mask)])
    isolation = WatchedIsolation(1_000, masks)
    assert isolation.mask_recall == 0.0
    isolation.cut(person.frame, None)
    assert isolation.mask_recall == pytest.approx(0.5, abs=0.03)
    assert isolation.mask_precision > 0.97
    isolation.cut(room.see((0.0, 2.4), 2).frame, None)
    assert isolation.mask_precision == pytest.approx(0.5, abs=0.05)
    assert len(isolation.seconds) == 2


def test_rooms_are_in_order_by_kind_subject_and_action() -> None:
    """Not by the letters of their names."""

    def score(name: str, kind: str) -> RoomScore:
        return RoomScore(name, kind, 1, 10, 90.0, 88.0, 80.0, None, {"tracked": 9, "lost": 1}, 1, 1, 1, 1, 1)

    rooms = [
        score("a10_s1", "plain"),
        score("a9_s1", "plain"),
        score("a1_s3", "plain"),
        score("a2_s1", "wall"),
    ]
    order = sorted(rooms, key=lambda one: one.key)
    assert [one.sequence for one in order] == ["a9_s1", "a10_s1", "a1_s3", "a2_s1"]
    assert (rooms[0].points, rooms[0].unknown) == (-2.0, 1)
