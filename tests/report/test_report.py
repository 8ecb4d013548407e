"""The page about a run: whole in itself, true to the run, and made to be read."""

from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from common.activation import activate
from coordinator.bodies.angles import angles_of
from coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from coordinator.bodies.urdf import read_urdf
from coordinator.cli import main
from coordinator.report import write_report
from coordinator.report.findings import Flag, find_banner, find_doubts, find_flags, find_leaps, list_ranges
from coordinator.results.track import Track
from tests.support.runs import swing, write_run

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
    whole = human()
    model = activate(whole, DEFAULT_ACTIVE, np.zeros(len(whole.dof_names)))
    write_run(folder, model, swing(model, 5), lost=(3,))
    (folder / "summary.json").write_text(json.dumps(SUMMARY))
    Image.new("RGB", (4, 4)).save(folder / "overlay.gif")
    return folder


def test_the_page_needs_nothing_else(run: Path) -> None:
    """`gepf report` leaves one file that loads only what it holds itself, and shows every angle."""
    assert main(["report", str(run)]) == 0
    text = (run / "report.html").read_text()
    page = Page(text)
    assert page.loaded
    assert all(address.startswith("data:") for address in page.loaded)
    model = activate(human(), DEFAULT_ACTIVE, np.zeros(len(human().dof_names)))
    names = [name.replace("_", " ") for name in angles_of(model).names]
    assert text.count("<svg") == len(("pelvis and trunk", "arms", "legs"))
    assert set(names) <= set(page.words)
    assert {"elbow flexion", "right: from … to (range)", "left: from … to (range)"} <= set(page.words)
    assert "refine.damping" in page.words


def test_text_from_outside_stays_text(run: Path) -> None:
    """A sequence's name that looks like HTML is shown, not obeyed."""
    main(["report", str(run)])
    text = (run / "report.html").read_text()
    assert "<b>&</b>" not in text
    assert "walk <b>&</b>" in Page(text).words


def test_the_lost_frame_is_named(run: Path) -> None:
    """Under 'where to look twice' stands the frame that is lost, by its own number."""
    main(["report", str(run)])
    words = Page((run / "report.html").read_text()).words
    assert any(word.strip().endswith("s (frame 103): lost") for word in words)


def test_no_run_is_one_line(tmp_path: Path, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a run, without its summary, and without a place to write: exit code 2 and one line each."""
    assert main(["report", str(tmp_path / "nowhere")]) == 2
    assert main(["report", str(run), "--out", str(tmp_path / "no" / "such" / "page.html")]) == 2
    (run / "summary.json").unlink()
    assert main(["report", str(run)]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 3
    assert "summary.json" in said[2]


def track_of(status: list[str]) -> Track:
    """A track of one angle and two hypotheses, a quarter of the weight 0.2 rad away over the half turn."""
    count = len(status)
    pose = np.full((count, 1), 3.1)
    return Track(
        frame=np.arange(10, 10 + count),
        time_s=np.arange(count) / 30.0,
        dof_names=("r_elbow_flexion",),
        pose=pose,
        joint_names=(),
        joint_positions=np.zeros((count, 0, 3)),
        hypothesis_pose=np.stack([pose, pose + 0.2 - 2.0 * np.pi], axis=1),
        hypothesis_weight=np.tile([0.75, 0.25], (count, 1)),
        status=np.array(status),
    )


def test_doubts_are_stretches() -> None:
    """Neighbouring frames of one status are one stretch; tracked ones are none."""
    track = track_of(["tracked", "lost", "lost", "ambiguous", "tracked", "lost"])
    assert [(d.status, d.first, d.last) for d in find_doubts(track)] == [
        ("lost", 11, 12),
        ("ambiguous", 13, 13),
        ("lost", 15, 15),
    ]
    assert [(d.first_s, d.last_s) for d in find_doubts(track)] == [
        (track.time_s[1], track.time_s[2]),
        (track.time_s[3], track.time_s[3]),
        (track.time_s[5], track.time_s[5]),
    ]


def test_flagged_joints_are_named_the_most_often_flagged_first() -> None:
    """With their share of the frames and the worst; joints that never are are not named."""
    chance = np.array([[0.01, 0.5, 0.01], [0.2, 0.7, 0.01], [np.nan, np.nan, np.nan], [0.01, 0.01, 0.01]])
    names = ("left_knee", "right_wrist", "head")
    track = replace(track_of(["tracked"] * 4), joint_names=names, joint_off_probability=chance)
    assert find_flags(track) == [Flag("right wrist", 0.5, 11, 0.7), Flag("left knee", 0.25, 11, 0.2)]
    assert find_flags(track_of(["tracked"])) == []


def elbow_track(degrees: list[float], status: list[str] | None = None, off: float = 8.0) -> Track:
    """A track of one elbow at 30 frames a second."""
    plain = track_of(status or ["tracked"] * len(degrees))
    angle = np.radians(np.array(degrees))[:, None]
    deviation_ = np.full_like(angle, np.radians(off))
    names = ("right_elbow_flexion",)
    return replace(plain, angle_names=names, angle=angle, angle_deviation=deviation_)


def test_leaps_that_no_person_makes_are_named() -> None:
    """41 degrees in a thirtieth of a second are a leap, 39 are none; who is lost leaps freely.

    An angle that is not known may leap by less than 60 degrees.
    """
    (leap,) = find_leaps(elbow_track([0.0, 39.0, 80.0]))
    assert (leap.angle, leap.frame, round(leap.change_deg)) == ("right_elbow_flexion", 12, 41)
    assert find_leaps(elbow_track([0.0, 55.0], off=50.0)) == []
    (hop,) = find_leaps(elbow_track([0.0, 90.0], off=50.0))
    assert (round(hop.change_deg), round(hop.deviation_deg)) == (90, 50)
    assert find_leaps(elbow_track([0.0, 90.0], ["lost", "tracked"])) == []
    assert find_leaps(track_of(["tracked"])) == []


@pytest.mark.parametrize(
    ("tracked", "complete", "says"),
    [
        (10, True, None),
        (10, False, "ended before its last frame"),
        (8, True, "Trust this run in parts: 80%"),
        (3, True, "Do not trust this run: 30%"),
    ],
)
def test_a_banner_says_whether_to_trust_a_run(tracked: int, complete: bool, says: str | None) -> None:
    """By the share of frames that are tracked; a run that ended early is said to be one."""
    track = track_of(["tracked"] * tracked + ["lost"] * (10 - tracked))
    banner = find_banner(track, {"complete": complete})
    assert (banner is None) == (says is None)
    assert says is None or (banner is not None and says in banner.text)


def test_ranges_are_those_of_the_known_frames() -> None:
    """From, to, when and how fast; what was reported while lost does not count."""
    (row,) = list_ranges(elbow_track([10.0, 40.0, 170.0, 20.0], ["tracked", "ambiguous", "lost", "tracked"]))
    assert (row.name, row.left, row.middle) == ("elbow flexion", None, None)
    reach = row.right
    assert reach is not None
    assert (round(reach.least), round(reach.greatest), round(reach.motion)) == (10, 40, 30)
    assert (reach.least_s, round(reach.greatest_s * 30.0), round(reach.fastest)) == (0.0, 1, 900)
    assert list_ranges(elbow_track([1.0], ["lost"])) == []


def test_a_robot_has_no_sides(tmp_path: Path) -> None:
    """Its joints stand in one column, and nobody says that its arms hang."""
    model = read_urdf(Path(__file__).parents[2] / "examples" / "arm7.urdf")
    write_run(tmp_path / "robot", model, swing(model, 3))
    (tmp_path / "robot" / "summary.json").write_text(json.dumps(SUMMARY))
    assert main(["report", str(tmp_path / "robot")]) == 0
    words = Page((tmp_path / "robot" / "report.html").read_text()).words
    assert "from … to (range)" in words
    assert not any(word.startswith("right") or "arms hanging" in word for word in words)


def test_a_page_of_one_of_several_says_who_it_is_and_leads_back(run: Path) -> None:
    """By the folder's name; a run alone has no such link."""
    write_report(run, run / "report.html", back="../report.html")
    text = (run / "report.html").read_text()
    assert "walk <b>&</b>: run" in Page(text).words
    assert '<a href="../report.html">All people</a>' in text
    write_report(run, run / "report.html")
    assert "All people" not in (run / "report.html").read_text()
