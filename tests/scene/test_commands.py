"""Rooms at the command line: the detected scene is shown, and the options work."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import pytest
from PIL import Image

from gepf.common.errors import InputError
from gepf.common.frame import Frame
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.cli import main
from gepf.coordinator.commands.info import describe_scene, find_people
from gepf.coordinator.commands.job import choose_scope
from gepf.coordinator.commands.options import TrackOptions
from gepf.coordinator.scene.scope import Scope
from gepf.coordinator.settings import SceneSettings
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.background import read_background
from gepf.coordinator.tracking.segmenter import ExpectedSurface, Segmenter
from tests.support.people import STANDING, shown
from tests.support.recordings import write_open3d
from tests.support.rooms import CABINET, CAMERA, HEIGHT, PERSON, Room, in_a_room

asked = partial(TrackOptions, sequences=[Path("recording")], out=Path("run"))


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """An empty room in two frames, and then a person in it, as recorders write it."""
    room = Room((CABINET,), noise=0.001)
    people = enumerate((None, None, PERSON, PERSON))
    depth = np.array([room.see(person, number).view.depth for number, person in people])
    return write_open3d(tmp_path / "room", depth, CAMERA)


def test_info_shows_floor_wall_and_who_comes(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Camera height and tilt, the wall, and the person who enters in the third frame; and a picture."""
    picture = tmp_path / "scene.png"
    assert main(["info", str(recording), "--json", "--picture", str(picture)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["floor"]["camera_height_m"] == pytest.approx(HEIGHT, abs=0.02)
    assert abs(facts["floor"]["pitch_deg"]) < 1.0
    assert facts["walls_m"] == [pytest.approx(3.6, abs=0.05)]
    assert facts["frame_looked_at"] == 2
    (found,) = facts["people"]
    assert found["distance_m"] == pytest.approx(2.5, abs=0.15)
    with Image.open(picture) as image:
        colours = np.asarray(image).astype(int)
    assert colours.shape == (CAMERA.height, CAMERA.width, 3)
    assert np.any((colours[..., 0] == 255) & (colours[..., 1] == 200))


def test_info_shows_who_comes_late(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A person who enters after 100 frames is seen, though not all frames are searched."""
    room = Room((CABINET,), noise=0.001)
    empty, entered = (room.see(person, 0).view.depth for person in (None, PERSON))
    recording = write_open3d(tmp_path / "room", np.array([empty] * 100 + [entered] * 30), CAMERA)
    assert main(["info", str(recording), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["frame_looked_at"] >= 100
    assert facts["people"][0]["may_be"] == "a person"


def test_what_is_to_be_said_of_a_recording_is_said_once(
    recording: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """Facts and scene are of one reading, so a missing frame is named once; times give a round rate."""
    (recording / "depth" / "000001.png").unlink()
    (recording / "timestamps.txt").write_text("1.0\n1.0666666\n1.1\n")
    assert main(["info", str(recording), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["frames"] == 3
    assert facts["fps"] == round(facts["fps"], 3)
    assert caplog.text.count("are missing") == 1


def test_lists_are_lines_of_words(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No brackets and quotes: camera, gravity, and one line for each candidate."""
    assert main(["info", str(recording)]) == 0
    said = capsys.readouterr().out
    assert not set("{}[]'") & set(said)
    assert "fx " in said
    (person,) = [line for line in said.splitlines() if "may_be" in line]
    assert person.startswith("people ")
    assert "may_be a person, " in person


def test_who_is_doubtful_is_said_to_be(recording: Path) -> None:
    """A candidate with a low score is listed as doubtful."""
    view, found = find_people(open_source(recording))
    people = describe_scene(view, [replace(found[0], score=0.0)])["people"]
    assert isinstance(people, list)
    assert [each["may_be"] for each in people] == ["a person or furniture"]


def test_an_empty_room_is_read_from_a_frame_a_picture_or_a_sequence(recording: Path) -> None:
    """All three give the same room; a number that is no frame is refused."""
    source = open_source(recording)
    first = source.view(0).metres()
    for asked in ("0", str(recording / "depth" / "000000.png")):
        np.testing.assert_array_equal(read_background(asked, source), first)
    whole = read_background(str(recording), source)
    assert np.median(np.abs(whole - first)) < 0.01
    with pytest.raises(InputError, match="--background 9 is not a frame; give 0 to 3"):
        read_background("9", source)


def test_all_that_decides_the_results_is_described() -> None:
    """Scopes that differ have different descriptions."""
    options = (
        asked(),
        asked(near=1.0),
        asked(far=3.0),
        asked(roi="1,2,30,40"),
        asked(person="nearest"),
        asked(person="4,5"),
    )
    scopes = [choose_scope(each) for each in options]
    scopes.append(Scope(background=np.ones((2, 2), np.float32)))
    described = {msgspec.json.encode(scope.describe()) for scope in scopes}
    assert len(described) == len(scopes)


def test_a_chair_in_the_empty_room_is_none_of_the_body() -> None:
    """A box that touches the person is segmented with it, unless the empty room is given."""
    (alone,) = shown("standing").frames[0].views
    (view,) = in_a_room(Frame.of(alone)).views
    model = human(1.82)
    pose = name_pose(model, STANDING)
    knee = joint_positions(model, pose[None])[0][model.joint_names.index("left_knee")]
    camera = view.intrinsics
    column = int(camera.cx + camera.fx * knee[0] / knee[2])
    row = int(camera.cy + camera.fy * knee[1] / knee[2])
    box = np.zeros(view.depth.shape, dtype=bool)
    box[row - 20 : row + 20, column - 12 : column + 40] = True
    box &= alone.depth == 0
    furnished = view.depth.copy()
    furnished[box] = int(1000 * knee[2])
    empty = view.metres()
    empty[alone.depth > 0] = 0.0
    empty[box] = knee[2]
    seen = Frame.of(replace(view, depth=furnished))
    counts = []
    surface = pose_vertices(model, pose[None])[0]
    for scope in (None, Scope(background=empty)):
        subject = (
            Segmenter(2000, SceneSettings(), scope).segment(seen, [ExpectedSurface(surface)]).subjects[0]
        )
        assert subject is not None
        counts.append(np.count_nonzero(subject.largest.image.depth))
    assert counts[0] > counts[1] + 0.3 * box.sum()
    assert counts[1] == pytest.approx(np.count_nonzero(alone.depth), rel=0.03)
