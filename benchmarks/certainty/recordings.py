"""Recordings to fit the tracker's certainty to, and to hold it against."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.recordings import Recording, choose, find_people
from coordinator.files import TRUTH_FILE
from coordinator.synthesis.sequence import PERSON, synthesise

RENDERED = ("skinned", "three_cameras", "rooms")
FRAMES = 50  # of each person
FIRST_OF_DEMO = 20  # seed, beyond those that the demo itself has


def find_hard(data: Path, subjects: Sequence[int]) -> list[Recording]:
    """The hard actions of subjects; InputError where there are none."""
    return choose(find_people(data, subjects), ["hard"])


def find_rendered(data: Path) -> list[Recording]:
    """Rendered people whose joints are known exactly."""
    folders = [folder for group in RENDERED for folder in sorted((data / group).glob("*"))]
    there = [folder for folder in folders if (folder / "truth.npz").exists()]
    return [Recording(folder.name, folder, folder / "truth.npz") for folder in there]


def render_demo(folder: Path, people: int) -> list[Recording]:
    """People who move fast at 10 frames a second, with exact truth, written to a folder."""
    recordings = []
    for seed in range(FIRST_OF_DEMO, FIRST_OF_DEMO + people):
        synthesise(PERSON, folder / str(seed), FRAMES, seed=seed, kinect=True)
        recordings.append(Recording(str(seed), folder / str(seed), folder / str(seed) / TRUTH_FILE))
    return recordings
