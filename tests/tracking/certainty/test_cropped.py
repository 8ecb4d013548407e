"""Certainty of joints outside the image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.camera import Intrinsics
from common.frame import DepthFrame
from coordinator.tracking.certainty.certainty import FLAGGED, Certainty
from tests.support.people import shown, tracker

KNEES = 180  # row of the picture at which the standing person's are, about
OUTSIDE = ("right_ankle", "left_ankle")
INSIDE = ("head", "right_elbow", "right_wrist", "right_hip", "left_hip")


def without_lower_legs(frame: DepthFrame) -> DepthFrame:
    """The frame, cut at the knees."""
    camera = frame.intrinsics
    lens = (camera.fx, camera.fy, camera.cx, camera.cy)
    depth = np.ascontiguousarray(frame.depth[:KNEES])
    return replace(frame, depth=depth, intrinsics=Intrinsics(camera.width, KNEES, *lens))


def followed(*, cropped: bool) -> Certainty:
    """How sure the last frame is of a person whose start is known."""
    following = tracker()
    for frame in shown("standing").frames:
        estimate = following.track(without_lower_legs(frame) if cropped else frame)
    assert estimate.certainty is not None
    return estimate.certainty


def test_joints_outside_the_picture_are_much_less_sure() -> None:
    """They are not seen, ten times as likely off as those in the picture, by more. None in it is flagged."""
    names = tracker().model.joint_names
    outside, inside = ([names.index(name) for name in group] for group in (OUTSIDE, INSIDE))
    whole, cropped = followed(cropped=False), followed(cropped=True)
    assert (cropped.seen[outside] < 0.05).all()
    assert cropped.off_probability[outside].min() > 10.0 * cropped.off_probability[inside].max()
    assert cropped.deviation[outside].min() > 2.0 * cropped.deviation[inside].max()
    assert (cropped.off_probability[inside] < FLAGGED).all()
    assert (whole.off_probability[outside] < FLAGGED).all()
    assert (whole.seen[outside] > 0.5).all()
