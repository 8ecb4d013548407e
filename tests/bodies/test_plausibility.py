"""What cannot be a person, although the template fits it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gepf.common.frame import EMPTY, HIDDEN, SUBJECT, Frame
from gepf.coordinator.bodies.human.plausibility import (
    reject_parts,
    reject_planes,
    reject_points,
    reject_position,
)
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.tracking.observation import isolate, observed_points
from tests.support.people import CAMERA, STANDING, alone, show, subject_of
from tests.support.rooms import Room


def test_what_is_no_person_is_said() -> None:
    """A person ten times as far and large: the scale of the depth is wrong."""
    view, mask = Room().see((0.0, 2.6))
    person = replace(view, depth=np.where(mask, view.depth, np.uint16(0)))
    subjects = [isolate(Frame.of(each), 10_000) for each in (person, replace(person, depth_scale=100.0))]
    said = [reject_points(observed_points(one), 1.75) for one in subjects if one is not None]
    assert said[0] == ""
    assert "depth_scale" in said[1]


def test_what_two_planes_fit_better_is_an_object() -> None:
    """Two sides of a box are an object, unless a body fits them as well."""
    across, down = np.random.default_rng(0).uniform(-0.5, 0.5, (2, 1_000))
    box = np.stack([across, 1.6 * down, 2.5 + 0.5 * abs(across + 0.2)], axis=1)
    assert "object" in reject_planes(box, 0.012)
    assert not reject_planes(box, 0.0)


@pytest.mark.parametrize(
    ("without", "label", "word"),
    [("", EMPTY, ""), ("head", EMPTY, "head"), ("leg", EMPTY, "legs"), ("leg", HIDDEN, "")],
    ids=["whole", "no head", "on a pole", "behind a table"],
)
def test_a_person_shows_head_and_legs_unless_something_hides_them(
    without: str, label: int, word: str
) -> None:
    """A body on a pole is not a person who stands; behind a table it may be."""
    model = human(1.82)
    pose = name_pose(model, STANDING)
    ((frame,), (joints,)) = show(model, pose[None])
    across, down, away = joints[[model.joint_names.index(name) for name in ("neck", "left_knee")]].T
    middle = CAMERA.cx + CAMERA.fx * across[0] / away[0]
    neck, knee = CAMERA.cy + CAMERA.fy * down / away
    (image,) = frame.views
    row, column = np.indices(image.depth.shape)
    gone = {
        "": np.zeros(image.depth.shape, dtype=np.bool_),
        "head": row < neck,
        "leg": (row > 0.5 * (neck + knee) + 10) & (abs(column - middle) > 3),
    }[without]
    depth = np.where(gone, np.uint16(0), image.depth)
    kinds = np.where(depth > 0, SUBJECT, np.where(gone, label, EMPTY)).astype(np.uint8)
    whole, extent = subject_of(frame, 1_000).largest, (0, 0, CAMERA.width, CAMERA.height)
    subject = alone(replace(whole, image=replace(image, depth=depth), extent=extent, labels=kinds))
    said = reject_parts(model, pose, subject, 1.82)
    assert word in said
    assert bool(said) == bool(word)


@pytest.mark.parametrize(
    ("rises", "lowest", "word"),
    [(0.6, 0.05, ""), (-0.6, 0.05, "upside down"), (0.6, -0.4, "below the floor"), (0.6, 0.9, "floats")],
)
def test_a_body_that_cannot_be_there_is_said(rises: float, lowest: float, word: str) -> None:
    """Upside down, below the floor, above it."""
    said = reject_position(rises, lowest)
    assert word in said
    assert bool(said) == bool(word)
