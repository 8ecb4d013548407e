"""Angles that a frame does not show are smoothed with the frames around; those that are known stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.families import angles_of
from gepf.coordinator.results.angles import with_angles
from gepf.coordinator.results.log import assemble
from gepf.coordinator.results.track import Track
from gepf.coordinator.tracking.estimate import Certainty, Estimate, Status
from tests.support.bodies import person

MODEL = person()
SURE = 0.02  # metres


def standing(frames: int, **degrees: Array | float) -> Array:
    """Poses (F, D), upright, with some degrees of freedom."""
    poses = np.zeros((frames, len(MODEL.dof_names)))
    for dof, values in degrees.items():
        poses[:, MODEL.dof(dof)] = np.radians(values)
    return poses


def tracked(
    poses: Array,
    others: Array | None = None,
    off: dict[str, Array] | None = None,
    unknown: tuple[int, ...] = (),
) -> Track:
    """The track of such poses (F, D), with other hypotheses (F, D) as likely, and with joints off (F,)."""
    estimates = []
    for f, pose in enumerate(poses):
        shown = pose[None] if others is None else np.stack([pose, others[f]])
        joints, deviation = joint_positions(MODEL, pose[None])[0], np.full(len(MODEL.joint_names), SURE)
        for joint, metres in (off or {}).items():
            deviation[MODEL.joint_names.index(joint)] = metres[f]
        certainty = Certainty(np.ones_like(deviation), np.zeros_like(deviation), deviation)
        status: Status = "lost" if f in unknown else "tracked"
        weights = np.full(len(shown), 1.0 / len(shown))
        estimates.append(
            Estimate(f, f / 30.0, status, pose, joints, shown, weights, 0.01, certainty=certainty)
        )
    return assemble(MODEL, estimates)


def angle(track: Track, name: str) -> tuple[Array, Array]:
    """An angle (F,) and its deviation (F,), degrees."""
    at = track.angle_names.index(name)
    return np.degrees(track.angle[:, at]), np.degrees(track.angle_deviation[:, at])


def test_a_rotation_that_nothing_shows_is_that_of_the_frames_around() -> None:
    """While the elbow is straight and the reported rotation jumps by 220; the deviation is as large."""
    elbow, twist = np.full(30, 80.0), np.full(30, 20.0)
    elbow[10:20], twist[10:20] = 1.0, np.resize([110.0, -110.0], 10)
    poses = standing(30, r_elbow_flexion=elbow, r_shoulder_twisting=twist)
    found, deviation = angle(tracked(poses), "right_shoulder_rotation")
    assert np.allclose(found, 20.0, atol=7.0)
    assert deviation[10:20].min() > 100.0


@pytest.mark.parametrize(
    ("dof", "name"),
    [
        ("r_shoulder_twisting", "right_shoulder_rotation"),
        ("r_hip_twisting", "right_hip_rotation"),
        ("r_ankle_flexion", "right_ankle_flexion"),
        ("l_elbow_flexion", "left_elbow_flexion"),
    ],
)
def test_a_hop_on_which_hypotheses_disagree_is_smoothed(dof: str, name: str) -> None:
    """The same hop with all agreed stays, and no angle of another limb changes."""
    poses = standing(30, r_elbow_flexion=30.0)
    hopped = poses.copy()
    hopped[15:18, MODEL.dof(dof)] += np.radians(70.0)
    sure, unsure = tracked(hopped), tracked(hopped, others=poses)
    assert np.ptp(angle(sure, name)[0]) > 50.0
    found, deviation = angle(unsure, name)
    assert np.abs(np.diff(found)).max() < 40.0
    assert deviation[15:18].min() > 40.0
    assert np.allclose(angle(sure, "left_knee_flexion")[0], angle(unsure, "left_knee_flexion")[0], atol=0.01)


def test_a_limb_that_is_found_again_does_not_hop() -> None:
    """An elbow that was 130 degrees off for long, and known to be, comes back as fast as people move."""
    bend, off = np.full(40, 5.0), np.full(40, SURE)
    bend[20:], off[:20] = 135.0, 0.4
    track = tracked(standing(40, r_elbow_flexion=bend), off={"right_wrist": off})
    found, deviation = angle(track, "right_elbow_flexion")
    assert np.abs(np.diff(found)).max() < 60.0
    assert np.allclose(found[20:], 135.0, atol=2.0)
    assert found[0] == pytest.approx(5.0, abs=2.0)
    assert deviation[:20].min() > 60.0
    assert deviation[20:].max() < 10.0


def test_a_fast_motion_that_is_seen_stays_as_it_is() -> None:
    """A punch: 70 degrees from one frame to the next; and a swing that the bent elbow shows."""
    bend = np.r_[np.full(10, 120.0), 50.0, np.full(10, 0.0)]
    swung = 40.0 * np.sin(np.linspace(0.0, 1.5 * np.pi, 21))
    poses = standing(21, l_elbow_flexion=bend, r_elbow_flexion=90.0, r_shoulder_twisting=swung)
    track = tracked(poses)
    assert np.allclose(angle(track, "left_elbow_flexion")[0], bend, atol=0.1)
    assert np.allclose(angle(track, "right_shoulder_rotation")[0], swung, atol=1.0)


def test_angles_of_frames_in_which_the_body_is_lost_are_those_of_the_frames_around() -> None:
    """Their values are guesses; their deviation is NaN."""
    bend = np.linspace(0.0, 90.0, 31)
    guessed = bend.copy()
    guessed[10:13] = 150.0
    track = tracked(standing(31, r_knee_flexion=guessed), unknown=(10, 11, 12))
    found, deviation = angle(track, "right_knee_flexion")
    assert np.abs(found - bend).max() < 40.0
    assert np.isnan(deviation[10:13]).all()


def test_what_is_guessed_while_the_body_is_lost_is_no_turn() -> None:
    """Guesses in all directions do not add a turn for a person who stands as before."""
    turned = np.zeros(40)
    turned[15:20], turned[20:25] = 140.0, -100.0
    track = tracked(standing(40, root_ry=turned), unknown=tuple(range(15, 25)))
    found, _ = angle(track, "pelvis_turn")
    assert np.abs(found[25:]).max() < 1.0
    assert np.abs(found).max() < 30.0


def test_time_stamps_that_stand_still_do_not_flatten_angles() -> None:
    """Frames of one time count as far apart as usual, as they do for the tracker."""
    bend = np.linspace(0.0, 90.0, 31)
    off = {"right_wrist": np.full(31, 0.06)}
    track = tracked(standing(31, r_elbow_flexion=bend), off=off)
    angles = angles_of(MODEL, {})
    for times in (track.time_s, np.zeros(31)):
        found, _ = angle(with_angles(replace(track, time_s=times), angles), "right_elbow_flexion")
        assert np.abs(found - bend).max() < 2.0


def test_angles_are_as_sure_as_their_hypotheses_agree() -> None:
    """An elbow with a straight hypothesis has a large deviation; others do not."""
    bent = standing(2, r_elbow_flexion=80.0)
    track = tracked(bent, others=standing(2), unknown=(1,))
    found, deviation = angle(track, "right_elbow_flexion")
    assert found[0] == pytest.approx(80.0)
    assert deviation[0] == pytest.approx(2.0 * np.sqrt(0.5) * 80.0, rel=0.02)
    assert 0.0 < angle(track, "left_elbow_flexion")[1][0] < 10.0
    assert np.isnan(deviation[1])
