"""Keypoints in colour: where people are segmented in a frame, and what the network sees of them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import DepthFrame, SubjectFrame
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.colour.finder import KeypointFinder, Keypoints, fitted_poses, with_keypoints
from gepf.coordinator.tracking.segmenter import SegmentedFrame
from gepf.coordinator.tracking.target import TargetTracker

TRIAL = os.environ.get("GEPF_TRIAL", "early,prop,cand").split(",")
IMAGE_UP = np.array([0.0, -1.0, 0.0])  # in the camera's frame
MAX_MOTION_M = 0.8  # of a body between two frames


@dataclass(frozen=True, slots=True, eq=False)
class Looked:
    """For each person: keypoints, poses (F, D) that they suggest, the surface (V, 3) to segment around."""

    keypoints: Sequence[Keypoints]
    suggested: Sequence[Array]
    surfaces: Sequence[Array | None]


def look(finder: KeypointFinder | None, targets: Sequence[TargetTracker], frame: DepthFrame) -> Looked:
    """Look for each person in colour, where the person is expected."""
    bodies = [target.expected_body for target in targets]
    surfaces = [target.segmentation_surface for target in targets]
    if finder is None:
        return Looked([{}] * len(targets), [np.empty((0, 0))] * len(targets), surfaces)
    keypoints = finder.submit(frame, bodies).result()
    suggested = [fitted_poses(*each, frame) for each in zip(bodies, keypoints, strict=True)]
    if "early" in TRIAL:
        surfaces = [around(*each) for each in zip(targets, surfaces, suggested, strict=True)]
    if "prop" not in TRIAL:
        suggested = [np.empty((0, 0))] * len(targets)
    return Looked(keypoints, suggested, surfaces)


def around(target: TargetTracker, expected: Array | None, suggested: Array) -> Array | None:
    """The vertices (V, 3) around which a person is segmented: of the pose that keypoints suggest, if they do.

    If it is farther from the expected pose than a body moves, one of them is wrong: those of both.
    """
    if expected is None or not len(suggested):
        return expected
    seen = pose_vertices(target.model, suggested[:1])[0]
    moved = float(np.linalg.norm(seen - expected, axis=1).mean())
    if "union" in TRIAL:
        return np.concatenate([seen, expected])
    return seen if moved < MAX_MOTION_M else np.concatenate([seen, expected])


def attach(finder: KeypointFinder | None, segmented: SegmentedFrame, looked: Looked) -> SegmentedFrame:
    """The segmented frame with the keypoints of each person, and those of candidates.

    Candidates in whom the network sees a person come first.
    """
    if finder is None:
        return segmented
    candidates = list(segmented.candidates)
    if "cand" in TRIAL:
        candidates = [look_at(finder, each, segmented) for each in candidates]
        candidates.sort(key=lambda each: all(view.keypoints is None for view in each.views))
    subjects = tuple(map(with_keypoints, segmented.subjects, looked.keypoints))
    return replace(segmented, subjects=subjects, candidates=tuple(candidates))


def look_at(finder: KeypointFinder, candidate: SubjectFrame, segmented: SegmentedFrame) -> SubjectFrame:
    """The candidate with its keypoints, if the network sees a person there."""
    planes = segmented.planes(candidate)
    found = finder.look_at(candidate, segmented.frame, planes.up if planes.has_floor else IMAGE_UP)
    return with_keypoints(candidate, found) or candidate
