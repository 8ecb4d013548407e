"""The subject is cut out of frame after frame."""

from __future__ import annotations

import numpy as np

from common.frame import HIDDEN, SUBJECT
from coordinator.scene.limits import Limits
from coordinator.scene.scope import Scope
from coordinator.tracking.observing.isolation import Isolation, prepare
from tests.support.rooms import TABLE, Room

PERSON = (-0.4, 2.6)


def test_somebody_is_found_whose_body_is_not_known() -> None:
    """In a room it is the best candidate, with what hides it; the points are the subject's."""
    room = Room((TABLE,), noise=0.001)
    frame, truth = room.see(PERSON)
    isolated = Isolation(300).cut(frame, None)
    subject = isolated.subject
    assert subject is not None
    assert subject.kinds is not None
    assert len(subject.picked) == 300
    assert np.all(subject.kinds.ravel()[subject.picked] == SUBJECT)
    assert np.any(subject.kinds == HIDDEN)
    assert np.sum(subject.kinds == SUBJECT) / truth.sum() > 0.9
    assert isolated.change.furnished


def test_nobody_is_no_subject() -> None:
    """A room without anybody, and a frame in which nothing counts, have none."""
    assert Isolation(300).cut(Room(noise=0.001).see(None).frame, None).subject is None
    near = Scope(limits=Limits(far=0.5))
    assert Isolation(300, near).cut(Room().see(PERSON).frame, None).subject is None


def test_preparing_leaves_nothing_behind() -> None:
    """What is loaded ahead does not change what is found."""
    frame = Room(noise=0.001).see(PERSON).frame
    before = Isolation(300).cut(frame, None).subject
    prepare()
    after = Isolation(300).cut(frame, None).subject
    assert before is not None
    assert after is not None
    np.testing.assert_array_equal(after.frame.depth, before.frame.depth)
    np.testing.assert_array_equal(after.picked, before.picked)
