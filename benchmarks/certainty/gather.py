"""Features and errors of each joint while recordings are tracked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks import gestures
from benchmarks.recordings import Recording, choose, find_people, read_frames, read_reference
from gepf.common.arrays import Array, Mask
from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.common.frame import Frame
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.files import TRUTH_FILE
from gepf.coordinator.results.evaluation import positions
from gepf.coordinator.scene.noise import NO_NOISE
from gepf.coordinator.settings import Settings
from gepf.coordinator.synthesis.sequence import PERSON, synthesise, write_depth, write_facts
from gepf.coordinator.tracking.certainty import Features, measure_features, seen_shares
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN
from gepf.coordinator.tracking.reporting import Stopwatch, UpdatedPerson, report
from gepf.coordinator.tracking.segmenter import BodyView, ExpectedSurface, Segmenter
from gepf.coordinator.tracking.state import first_state
from gepf.coordinator.tracking.target import TargetTracker
from gepf.coordinator.tracking.track_state import TrackedBefore
from gepf.refiners import DirectRefiner

ROOMS = ("skinned", "three_cameras", "rooms")  # folders of rendered recordings
FRAMES = 50  # of each rendered person


@dataclass(frozen=True, slots=True, eq=False)
class Gathered:
    """F tracked frames of one recording with J joints."""

    kind: str  # recordings of one kind are scored together
    person: str  # whose constant offsets are removed; empty if the truth is exact
    features: Features  # (F, J) each
    apart: Array  # (F, J, 3) metres from the reference
    holds: Mask  # (F, J) where depth does not contradict the reference
    status: NDArray[np.str_]  # (F,)


def find_hard(data: Path, subjects: Sequence[int]) -> list[Recording]:
    """The hard actions of these subjects; InputError if there are none."""
    return choose(find_people(data, subjects), ["hard"])


def find_rendered(data: Path) -> list[Recording]:
    """The available skinned people, alone and in rooms, with exact truth and no second person."""
    truths = sorted(path for kind in ROOMS for path in (data / kind).glob(f"*/{TRUTH_FILE}"))
    return [Recording(t.parent.name, t.parent, t) for t in truths if t.parent.name != "second"]


def find_clothed(data: Path) -> list[Recording]:
    """The clothed people, with exact truth; InputError if there are none."""
    truths = sorted((data / "clothed").glob(f"*/{TRUTH_FILE}"))
    if not truths:
        raise InputError(f"{data / 'clothed'} holds no recordings; give the folder with --data")
    return [Recording(t.parent.name, t.parent, t) for t in truths]


def render_people(folder: Path, seeds: Sequence[int]) -> list[Recording]:
    """Render people who move fast, at 10 frames a second with exact truth, into a folder."""
    for seed in seeds:
        synthesise(PERSON, folder / str(seed), FRAMES, seed=seed, kinect=True)
    return [Recording(str(s), folder / str(s), folder / str(s) / TRUTH_FILE) for s in seeds]


def render_gestures(folder: Path, seeds: Sequence[int]) -> list[Recording]:
    """Render people who move their arms fast, from the front, in front of a wall, and from behind."""
    recordings = list[Recording]()
    for scene in (gestures.arms, gestures.wall, gestures.back):
        for seed in seeds:
            out, shown = folder / f"{scene.__name__}{seed}", scene(seed)
            for _ in write_depth(shown, NO_NOISE, seed, out / "depth", kinect=True):
                pass
            write_facts(shown, out)
            recordings.append(Recording(out.name, out, out / TRUTH_FILE))
    return recordings


def gather(
    kind: str, recording: Recording, every: int, settings: Settings, bodies: Bodies, cut: float | None = None
) -> Gathered | None:
    """Track every n-th frame; None if no frame with a reference has a tracked body.

    cut: share of the way from knees to hips at which the image ends; None for the whole image.
    """
    frames = read_frames(recording)
    reference = read_reference(recording, frames)
    if cut is not None:
        row = row_between(reference.joints, reference.names, cut, frames[0].views[0].intrinsics)
        frames = [cut_below(frame, row) for frame in frames]
    state = first_state(bodies, None, settings)
    segmenter = Segmenter(settings.points, settings.scene)
    tracker = TargetTracker(DirectRefiner(), settings, bodies, state)
    rows: list[tuple[Array, Array, Mask, str]] = []
    for frame in frames[::every]:
        tracker.accept_first_detection()
        surface = tracker.segmentation_surface()
        segmented = segmenter.segment(frame, [ExpectedSurface(surface)], find=surface is None)
        segmenter.learn(segmented)
        (subject,) = segmented.subjects
        if segmented.candidates:
            subject = segmented.candidates[0].subject
        submitted = tracker.submit(BodyView(frame, subject, segmented.planes(subject)), Stopwatch())
        if isinstance(submitted, UpdatedPerson):  # nothing was refined
            continue
        updated, track = tracker.update(submitted, {}), tracker.track
        estimate, context = report(updated, {}, settings).estimate, submitted.context
        assert isinstance(track, TrackedBefore)
        found = np.flatnonzero(reference.frame == frame.number)
        if estimate.status in POSE_UNKNOWN or not len(found):
            continue
        belief, weights = track.belief, estimate.hypothesis_weight
        features = measure_features(
            tracker.model,
            belief.reported,
            joint_positions(tracker.model, np.stack([belief.reported, *belief.poses[: len(weights)]])),
            weights,
            context,
            track.normalised_residual,
            seen_shares(tracker.model, belief.reported, context.subject, context.stretch, settings.certainty),
            settings.certainty,
        )
        mine, row = positions(tracker.model.joint_names, reference.names), found[0]
        apart = estimate.joint_positions[mine] - reference.joints[row]
        rows.append((np.array(features)[:, mine], apart, reference.holds[row], estimate.status))
    if not rows:
        return None
    columns, apart, holds, status = (np.array(column) for column in zip(*rows, strict=True))
    person = "" if recording.action is None else recording.name.rpartition("_")[2]
    return Gathered(kind, person, Features(*np.moveaxis(columns, 1, 0)), apart, holds, status)


def row_between(joints: Array, names: tuple[str, ...], share: float, camera: Intrinsics) -> int:
    """The row at a share of the way from knees to hips, by joints (F, J, 3)."""
    knees, hips = (
        np.mean([joints[:, names.index(f"{side}_{part}")] for side in ("left", "right")], axis=(0, 1))
        for part in ("knee", "hip")
    )
    _, y, z = knees + share * (hips - knees)
    return int(np.clip(round(camera.cy + camera.fy * y / z), 1, camera.height))


def cut_below(frame: Frame, row: int) -> Frame:
    """The part of a frame above a row."""
    (view,) = frame.views
    camera = view.intrinsics
    lens = (camera.fx, camera.fy, camera.cx, camera.cy)
    depth = np.ascontiguousarray(view.depth[:row])
    return Frame.of(replace(view, depth=depth, intrinsics=Intrinsics(camera.width, row, *lens)))
