"""Whether colour shows people where depth does, or the pose is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from gepf.coordinator.colour.agreement import ColourState, Verdict, judge, trusted, with_agreement
from gepf.coordinator.colour.matching import EXCHANGED, ExpectedBody
from gepf.coordinator.settings import ColourSettings
from gepf.coordinator.tracking.observation import isolate
from tests.support.coloured import coloured
from tests.support.people import STANDING, known

SETTINGS = ColourSettings()


@pytest.mark.parametrize(
    ("body_m", "shift_px", "verdict"),
    [
        (0.0, 0.0, "agrees"),
        (0.0, 6.0, "elsewhere"),
        (0.0, 11.0, "elsewhere"),
        (0.0, 25.0, "elsewhere"),
        (0.0, 90.0, "elsewhere"),
        (0.4, 0.0, "another pose"),
        (0.4, 90.0, "elsewhere"),
    ],
    ids=[
        "right",
        "all shifted by 5 cm",
        "by 10 cm",
        "by 23 cm",
        "far away",
        "the body is beside the person",
        "both",
    ],
)
@pytest.mark.parametrize("sides", ["as they are", "exchanged"])
def test_what_keypoints_say_about_colour_and_about_the_pose(
    body_m: float, shift_px: float, verdict: Verdict, sides: str
) -> None:
    """Keypoints on the person's pixels do not speak against colour, wherever the body is."""
    model, pose = known().tracked(known().usual_size, STANDING)
    frame, moved = coloured()[0], pose.copy()
    subject, (image,) = isolate(frame, 100), frame.views
    assert subject is not None
    (view,) = subject.views
    moved[model.dof("root_tx")] += body_m
    true = ExpectedBody(model, pose).pixels(image)
    keypoints = np.column_stack([true + np.array([shift_px, 0.0]), np.full(17, 0.1)]).astype(np.float32)
    keypoints = keypoints[EXCHANGED] if sides == "exchanged" else keypoints
    assert judge(ExpectedBody(model, moved).pixels(image), keypoints, view, SETTINGS) == verdict


def test_colour_is_trusted_if_it_shows_a_person_whose_pose_is_wrong() -> None:
    """This neither ends the use of colour, nor begins it again."""
    unsure = ColourState(against_s=2.0)
    after = unsure.after(["another pose"], 0.5, 10.0, SETTINGS)
    assert after.against_s == unsure.against_s
    assert trusted({"": after}, 10.0, SETTINGS) == {""}
    assert not trusted({"": unsure.after(["elsewhere"], 0.5, 10.0, SETTINGS)}, 10.0, SETTINGS)


def test_colour_that_shows_a_candidate_is_trusted() -> None:
    """A person without a body shows that colour shows people; whether it is used does not change."""
    states = {"left": ColourState(against_s=4.0, used=False), "right": ColourState(against_s=1.0)}
    after = with_agreement(states, {"right", "new"}, 10.0)
    assert trusted(after, 12.0, SETTINGS) == {"right", "new"}
    assert after["left"] == states["left"]
    assert after["right"].against_s == 1.0
    assert trusted(with_agreement(states, {"left"}, 10.0), 10.0, SETTINGS) == set()
