"""A method is the same through the library as through the command line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import gepf
from gepf.coordinator.cli import main
from gepf.coordinator.filters.methods import METHODS
from gepf.coordinator.results.track import read_track
from tests.support.small_sequence import MOVING, write_small_sequence
from tests.support.stand_ins import Direct

FRAMES = 2
POINTS = 200


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of the arm."""
    folder = tmp_path_factory.mktemp("arm") / "seq"
    write_small_sequence(folder, FRAMES)
    return folder


def follow(recording: Path, settings: gepf.Settings) -> list[gepf.Estimate]:
    """Estimates of the library in this process."""
    source = gepf.open_source(recording)
    tracker = gepf.Tracker(settings=settings, start=source.init, active=tuple(MOVING.split(",")))
    return list(tracker.follow(source))


def as_bytes(estimates: list[gepf.Estimate]) -> list[bytes]:
    """Poses and hypotheses of every frame."""
    return [part.tobytes() for e in estimates for part in (e.pose, e.hypothesis_pose, e.hypothesis_weight)]


@pytest.mark.parametrize("method", METHODS)
def test_a_method_is_the_same_whoever_asks_for_it(method: str, recording: Path, tmp_path: Path) -> None:
    """`gepf track --method` and the library: the same bytes, by the same settings."""
    options = ("--method", method, "--points", str(POINTS), "--dof", MOVING, "--no-pictures", "--quiet")
    assert main(["track", str(recording), "--out", str(tmp_path / "run"), *options], Direct().connect) == 0
    track = read_track(tmp_path / "run")
    found = follow(recording, gepf.settings_for(method, points=POINTS))
    assert len(found) == FRAMES
    for f, estimate in enumerate(found):
        count = len(estimate.hypothesis_weight)
        assert estimate.pose.tobytes() == track.pose[f].tobytes()
        assert estimate.hypothesis_pose.tobytes() == track.hypothesis_pose[f, :count].tobytes()
        assert estimate.hypothesis_weight.tobytes() == track.hypothesis_weight[f, :count].tobytes()
        assert not np.nan_to_num(track.hypothesis_weight[f, count:]).any()


@pytest.mark.parametrize("method", METHODS)
def test_what_makes_a_method_holds_whatever_the_settings_say(method: str, recording: Path) -> None:
    """A preset under another method's name: the baselines do not descend, gradient follows one particle."""
    preset = msgspec.structs.replace(gepf.preset("default"), points=POINTS)
    renamed = follow(recording, msgspec.structs.replace(preset, method=method))
    particles = 1 if METHODS[method].lone else preset.filter.particles
    assert as_bytes(renamed) == as_bytes(
        follow(recording, gepf.settings_for(method, "default", particles, POINTS))
    )
    refined = {estimate.particles for estimate in renamed}
    assert max(refined) <= particles
    assert refined == {particles} or method == "gepf"  # it uses as many as a frame needs


def test_numbers_of_a_method_are_its_own_unless_asked_for() -> None:
    """Particles, iterations and points by method; what the user asks for is kept."""
    of = {method: gepf.settings_for(method) for method in METHODS}
    numbers = {m: (s.filter.particles, s.refine.icp_iterations, s.points) for m, s in of.items()}
    assert numbers == {
        "gepf": (20, gepf.preset("default").refine.icp_iterations, 3_000),
        "gradient": (1, 6, 10_000),
        "condensation": (1_000, 0, 3_000),
        "annealed": (100, 0, 3_000),
    }
    asked = gepf.settings_for("gradient", "paper", particles=1, points=500)
    assert (asked.method, asked.preset, asked.filter.particles, asked.points) == ("gradient", "paper", 1, 500)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"points": 0}, "points=0 is too small; give 1 or more"),
        ({"filter": msgspec.structs.replace(gepf.preset("default").filter, particles=0)}, "particles=0"),
        ({"refine": msgspec.structs.replace(gepf.preset("default").refine, descent="magic")}, "choose from "),
    ],
)
def test_settings_that_make_no_sense_are_refused(change: dict[str, Any], says: str) -> None:
    """Also those that were made without `settings_for`, and before any worker is looked for."""
    settings = msgspec.structs.replace(gepf.preset("default"), **change)
    with pytest.raises(gepf.InputError, match=says):
        gepf.Tracker(settings=settings, workers="nowhere")


@pytest.mark.parametrize("tracker", [gepf.Tracker, gepf.PeopleTracker])
def test_settings_are_not_a_dictionary(tracker: Callable[..., object]) -> None:
    """The message shows how a preset is changed."""
    with pytest.raises(gepf.InputError, match=r"settings is a dict, not a preset; give .*structs\.replace"):
        tracker(settings={"seed": 1})
