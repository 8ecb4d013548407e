"""A rig as a source: its file, and which frames belong together."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.rig import RigCamera, write_rig
from tests.support.recordings import write_open3d

IDENTITY = np.eye(4).tolist()


def write(folder: Path, offsets: dict[str, float], frames: int = 5) -> Path:
    """A rig of cameras with these time offsets, each with frames whose depth is 1000 + number."""
    for name in offsets:
        depth = np.full((frames, 6, 8), 1000, np.uint16) + np.arange(frames, dtype=np.uint16)[:, None, None]
        write_open3d(folder / name, depth, Intrinsics(8, 6, 10.0, 10.0, 3.5, 2.5))
    cameras = [RigCamera(name, name, IDENTITY, offset) for name, offset in offsets.items()]
    write_rig(folder / "rig.json", cameras)
    return folder / "rig.json"


@pytest.mark.parametrize(
    ("offset", "expected"), [(0.0, [0, 1, 2, 3, 4]), (0.05, [None, 0, 1, 2, 3]), (-0.03, [1, 2, 3, 4, None])]
)
def test_frames_that_are_nearest_in_time_belong_together(
    tmp_path: Path, offset: float, expected: list[int | None]
) -> None:
    """There is one for each of the first camera, at its time; a camera that has none yet shows nothing."""
    source = open_source(write(tmp_path, {"a": 0.25, "b": 0.25 + offset}))
    assert len(source) == 5
    found = []
    for number, frame in enumerate(source):
        assert frame.time_s == pytest.approx(0.25 + number / 30.0)
        first, other = frame.views
        assert first.time_s == frame.time_s
        found.append(int(other.depth[0, 0]) - 1000 if other.depth.any() else None)
        assert abs(other.time_s - frame.time_s) < 0.5 / 30.0 + 1e-3
    assert found == expected


def test_frames_after_the_end_of_the_first_camera_are_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A line says how to track them; not if recordings end almost together."""
    assert len(open_source(write(tmp_path / "one", {"a": 0.0, "b": 0.09}, frames=8))) == 8
    assert not caplog.messages
    assert len(open_source(write(tmp_path / "other", {"a": 0.0, "b": 0.2}, frames=8))) == 8
    assert "'a' ends 0.2 s before 'b'; to track the rest, list 'b' first" in caplog.text


def change(**fields: object) -> Callable[[dict[str, Any]], object]:
    """Replaces fields of camera b."""
    return lambda rig: rig["cameras"][1].update(fields)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda rig: rig.pop("cameras"), "cameras"),
        (lambda rig: rig["cameras"].clear(), "0 cameras"),
        (change(sequence="a"), "twice, as 'a' and 'b'"),
        (change(name="a"), "two cameras named 'a'"),
        (change(sequence="zenoh:b"), "'a' is a recording, but others are live"),
        (change(sequence="nothing"), "rig.json: 'b': no such file or folder"),
        (change(T_rig_camera=(2.0 * np.eye(4)).tolist()), "T_rig_camera of 'b' is not a rotation"),
        (change(T_rig_camera=np.diag([1.0, 1.0, -1.0, 1.0]).tolist()), "of 'b' is not a rotation"),
        (change(T_rig_camera=np.eye(3).tolist()), "length"),
        (change(T_rig_camera=[*IDENTITY[:2], [0.0, 0.0, 1.0, 3000.0], IDENTITY[3]]), "puts it 3000 m away"),
        (change(time_offset_s=1e9), "time_offset_s of 'b' is not in seconds"),
        (change(time_offset_s="soon"), "time_offset_s"),
        (change(time_offset_s=10.0), "'b' and 'a' were not recorded at the same time"),
        (change(name=""), "a camera has an empty name"),
        (change(sequence="inner.json"), "'b' is a rig itself"),
    ],
)
def test_a_bad_rig_is_refused(tmp_path: Path, damage: Callable[[dict[str, Any]], object], said: str) -> None:
    """One line says what is wrong, and where."""
    path = write(tmp_path, {"a": 0.0, "b": 0.0})
    rig = json.loads(path.read_text())
    path.with_name("inner.json").write_text(path.read_text())
    damage(rig)
    path.write_text(json.dumps(rig))
    with pytest.raises(InputError, match=said) as raised:
        open_source(path)
    assert "\n" not in str(raised.value)
