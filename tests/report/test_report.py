"""The page about a run: self-contained, correct, readable."""

from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gepf.common.activation import activate
from gepf.coordinator.bodies.families import angles_of
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.urdf import read_urdf
from gepf.coordinator.cli import main
from gepf.coordinator.pictures.plots import angle_curves
from gepf.coordinator.report.page import find_doubts, list_ranges
from gepf.coordinator.results.track import Track
from tests.support.bodies import person
from tests.support.runs import make_track, swing, write_run

SUMMARY = {
    "sequence": "walk <b>&</b>",
    "settings": {"seed": 3, "refine": {"damping": 0.1}},
    "time_per_stage": {"refine": 2.0, "merge": 0.5},
    "frame_rate": 12.3,
    "versions": {"gepf": "0.1.0"},
}


class Page(HTMLParser):
    """What a browser would load, and the text between tags."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what the tag makes a browser load."""
        self.loaded += [
            value or "" for name, value in attrs if name == "src" or (tag == "link" and name == "href")
        ]

    def handle_data(self, data: str) -> None:
        """Note the text."""
        self.words.append(data.strip())


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of five frames, the fourth lost, with a small picture."""
    folder = tmp_path / "run"
    write_run(folder, person(), swing(person(), 5), lost=(3,))
    (folder / "summary.json").write_text(json.dumps(SUMMARY))
    Image.new("RGB", (4, 4)).save(folder / "sheet.png")
    return folder


def test_the_page_needs_nothing_else(run: Path) -> None:
    """One file that loads only what it holds itself, and shows every angle and the lost frame.

    A sequence's name that looks like HTML is shown, not obeyed.
    """
    assert main(["report", str(run)]) == 0
    text = (run / "report.html").read_text()
    page = Page(text)
    assert page.loaded
    assert all(address.startswith("data:") for address in page.loaded)
    assert text.count("<svg") == len(("trunk", "limbs"))
    assert {name.replace("_", " ") for name in angles_of(person()).names} <= set(page.words)
    assert {"right elbow flexion", "left elbow flexion", "from … to"} <= set(page.words)
    assert {"refine.damping", "walk <b>&</b>"} <= set(page.words)
    assert "<b>&</b>" not in text
    assert any(word.strip().endswith("s (frame 103): lost") for word in page.words)


def track_of(status: list[str]) -> Track:
    """A track of one elbow, 30 frames a second, from frame 10 on."""
    body = activate(human(), ["r_elbow_flexion"], np.zeros(len(human().dof_names)))
    count = np.arange(len(status))
    track = make_track(body, np.zeros((len(status), 1)), status=np.array(status))
    return replace(track, frame=10 + count, time_s=count / 30.0)


def test_doubts_are_stretches_of_frames_and_then_joints() -> None:
    """Neighbours of one status are one, tracked ones none; the joint most often flagged is the first."""
    track = track_of(["tracked", "lost", "lost", "ambiguous", "tracked", "lost"])
    frames = [
        ("lost", "0.03 to 0.07 s (frames 11 to 12): lost"),
        ("ambiguous", "0.10 s (frame 13): ambiguous"),
        ("lost", "0.17 s (frame 15): lost"),
    ]
    assert list(find_doubts(track)) == frames
    chance = np.full((6, 3), 0.01)
    chance[:3, 1], chance[1, 0], chance[5] = (0.5, 0.7, 0.5), 0.2, np.nan
    names = ("left_knee", "right_wrist", "head")
    joints = list(find_doubts(replace(track, joint_names=names, joint_off_probability=chance)))[3:]
    said = "may be more than 15 cm off in {} of the frames, most likely in frame 11 ({})"
    assert joints == [
        ("ambiguous", "right wrist " + said.format("50%", "70%")),
        ("ambiguous", "left knee " + said.format("17%", "20%")),
    ]


def elbow_track(degrees: list[float], status: list[str] | None = None, off: float = 8.0) -> Track:
    """A track of one elbow at 30 frames a second."""
    plain = track_of(status or ["tracked"] * len(degrees))
    angle = np.radians(np.array(degrees))[:, None]
    deviation_ = np.full_like(angle, np.radians(off))
    names = ("right_elbow_flexion",)
    return replace(plain, angle_names=names, angle=angle, angle_deviation=deviation_)


def test_ranges_are_those_of_the_known_frames() -> None:
    """Smallest, largest and fastest value; lost frames do not count."""
    track = elbow_track([10.0, 40.0, 170.0, 20.0], ["tracked", "ambiguous", "lost", "tracked"])
    (row,) = list_ranges(track, angle_curves(track, track.angle_names))
    assert row == ("right elbow flexion", "10° … 40°", "30°", "900°/s", "8°")
    lost = elbow_track([1.0], ["lost"])
    assert list(list_ranges(lost, angle_curves(lost, lost.angle_names))) == []


def test_a_robot_has_no_sides(tmp_path: Path) -> None:
    """Its joints are one group, without notes about hanging arms."""
    model = read_urdf(Path(__file__).parents[2] / "examples" / "arm7.urdf")
    write_run(tmp_path / "robot", model, swing(model, 3))
    (tmp_path / "robot" / "summary.json").write_text(json.dumps(SUMMARY))
    assert main(["report", str(tmp_path / "robot")]) == 0
    words = Page((tmp_path / "robot" / "report.html").read_text()).words
    assert {"from … to", "joints"} <= set(words)
    assert not any(word.startswith("right") or "arms hanging" in word for word in words)
