"""The paper's benchmark: its frames are those of `gepf synth`, its bound is right in a known case."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.paper.bound import information
from benchmarks.paper.runs import Footage
from benchmarks.paper.scores import limb_lost
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.results.evaluation import Errors
from gepf.coordinator.scene.noise import SensorNoise
from gepf.coordinator.sources import open_source
from gepf.coordinator.synthesis.rendering import DepthRenderer
from gepf.coordinator.synthesis.scenes import SCENES
from gepf.coordinator.synthesis.sequence import synthesise


def test_frames_are_those_of_synth(tmp_path: Path) -> None:
    """A frame in memory has the same depth as one read from a file, including noise."""
    noise, scene = SensorNoise(0.15, 0.01), SCENES["arm"]()
    synthesise("arm", tmp_path / "arm", 1, noise.depth, noise.lateral, seed=3)
    with DepthRenderer(scene.camera) as renderer:
        exact = renderer.depth(pose_vertices(scene.model, scene.poses[:1])[0], scene.model.triangles)
    frame = next(Footage(scene, exact[None]).frames(noise, 3, 1))
    assert np.array_equal(frame.views[0].depth, open_source(tmp_path / "arm").view(0).depth)


def test_the_bound_of_a_body_that_moves_along_the_axis_is_that_of_a_mean() -> None:
    """N pixels whose depth follows a value give information N / sigma^2; the outline adds a little."""
    scene, noise = SCENES["arm"](), SensorNoise(0.15, 0.03)
    with DepthRenderer(scene.camera) as renderer:
        measured, _, count = information(renderer, scene, ("root_tz",), noise, 0)
    assert count / 0.15**2 <= measured[0, 0] * 1.02
    assert measured[0, 0] < 1.2 * count / 0.15**2


def test_a_limb_is_lost_when_it_is_never_found_again() -> None:
    """An arm that is 70 cm off from frame 3 to the end, the mean joint near; not one that is back."""
    names = human().joint_names
    joint_m = np.full((6, len(names)), 0.02)
    arm = [names.index("right_elbow"), names.index("right_wrist")]
    joint_m[3:, arm] = 0.7
    errors = Errors(np.arange(6), ("angle",), np.zeros((6, 1)), np.zeros((6, 1)), joint_m)
    assert limb_lost(names, errors)
    joint_m[5, arm] = 0.05
    assert not limb_lost(names, errors)
