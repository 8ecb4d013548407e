"""People as bodies of REP 155, the convention of ROS for perception in human-robot interaction (ROS4HRI).

A body has an identifier, a frame `body_ID` between the hips, in which the frames of its parts are, and joint
states of the kinematic model of the package `human_description`. Frames have x ahead, y left and z up if the
person stands; those of limbs have z from the limb's end to its origin.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array
from gepf.common.body import REST_FROM_URDF, BodyModel
from gepf.common.kinematics import joint_positions, link_transforms
from gepf.coordinator.sources.ros2 import Node

IDS, IDS_DEFINITION = "hri_msgs/msg/IdsList", "std_msgs/Header header\nstring[] ids\n"
SIDES = {"l": ("left", 1.0), "r": ("right", -1.0)}
LIMBS = {"arm": ("shoulder", "elbow", "wrist"), "leg": ("hip", "knee", "ankle")}
LIMB_END = np.array([0.0, 0.0, -1.0])  # from a limb's origin

Frames = dict[str, tuple[Array, Rotation]]
"""Position (3,) and orientation of frames by name, in the frame of the camera or rig."""


class HumanBodies:
    """The list of the tracked bodies of a run."""

    def __init__(self, node: Node) -> None:
        node.define(IDS, IDS_DEFINITION)
        self._make, self._header, self._tracked = node.make, node.header, set[str]()
        self.topic = node.advertise("/humans/bodies/tracked", IDS)

    def put(self, body: str, time_s: float, *, tracked: bool) -> None:
        """Publish the identifiers of all tracked bodies, after a frame in which `body` is tracked or not."""
        self._tracked = self._tracked | {body} if tracked else self._tracked - {body}
        if self.topic.has_subscriber:
            self.topic.put(self._make(IDS, self._header(time_s), sorted(self._tracked)))


def body_id(topic: str) -> str:
    """The identifier of the body with results below a topic; a valid part of a topic."""
    return topic.strip("/").replace("/", "_")


def body_frames(model: BodyModel, pose: Array) -> Frames:
    """The frames of the body and its parts, without identifier; `pose` (D,)."""
    places = dict(zip(model.joint_names, joint_positions(model, pose[None])[0], strict=True))
    turns = link_transforms(model, pose[None])[0][model.joint_links, :, :3] @ REST_FROM_URDF
    turned = dict(zip(model.joint_names, Rotation.from_matrix(turns), strict=True))
    hips, shoulders = (
        0.5 * (places[f"left_{name}"] + places[f"right_{name}"]) for name in ("hip", "shoulder")
    )
    found: Frames = {
        "body": (hips, turned["pelvis"]),
        "waist": (hips, turned["neck"]),
        "torso": (shoulders, turned["neck"]),
        "head": (places["head"], turned["head"]),
    }
    for short, (side, _) in SIDES.items():
        for upper, lower, end in LIMBS.values():
            start, middle, last = (places[f"{side}_{name}"] for name in (upper, lower, end))
            forearm = aligned(turned[f"{side}_{lower}"], last - middle)
            found[f"{short}_{upper}"] = start, aligned(turned[f"{side}_{upper}"], middle - start)
            found[f"{short}_{lower}"] = middle, forearm
            found[f"{short}_{end}"] = last, forearm
    return found


def aligned(turn: Rotation, direction: Array) -> Rotation:
    """The orientation of a limb, rotated as little as possible so that the limb has this direction (3,)."""
    least, _ = Rotation.align_vectors([direction], [turn.apply(LIMB_END)])
    return least * turn


def in_body(frames: Frames) -> Frames:
    """All frames but the body's, in the body's frame."""
    origin, turn = frames["body"]
    back = turn.inv()
    return {
        name: (back.apply(at - origin), back * own) for name, (at, own) in frames.items() if name != "body"
    }


def joint_states(frames: Frames) -> Mapping[str, float]:
    """Angles, radians, of the joints of the package `human_description`, by name without identifier.

    Its spine only bends forward: the trunk's other rotations are in the angles of the shoulders and the head.
    """
    turn = {name: own for name, (_, own) in frames.items()}
    found = {"waist": bend(turn["body"], turn["torso"], np.array([0.0, 0.0, 1.0]))}
    torso = turn["body"] * Rotation.from_euler("y", found["waist"])
    roll, yaw, nod = angles("XZY", torso, turn["head"])
    found |= {"r_head": roll, "y_head": yaw, "p_head": -nod}
    for side, (_, out) in SIDES.items():
        first, abduction, last = angles("ZXZ", torso, turn[f"{side}_shoulder"])
        if out < 0.0:  # the same rotation, with the abduction to the right
            first, abduction, last = (wrapped(first + np.pi), -abduction, wrapped(last - np.pi))
        found |= {f"{side}_y_shoulder": -out * first, f"{side}_p_shoulder": out * abduction}
        found |= {f"{side}_r_shoulder": out * last}
        yaw, abduction, flexion = angles("ZXY", turn["body"], turn[f"{side}_hip"])
        found |= {f"{side}_y_hip": -yaw, f"{side}_p_hip": out * abduction, f"{side}_r_hip": -flexion}
        for upper, lower, _ in LIMBS.values():
            found[f"{side}_{lower}"] = -bend(turn[f"{side}_{upper}"], turn[f"{side}_{lower}"], LIMB_END)
    return found


def bend(carrier: Rotation, moved: Rotation, along: Array) -> float:
    """The rotation about the carrier's y, radians, that brings a direction (3,) nearest to `moved`'s."""
    before, after = along, (carrier.inv() * moved).apply(along)
    return float(np.arctan2(before[2] * after[0] - before[0] * after[2], after @ before))


def angles(order: str, carrier: Rotation, moved: Rotation) -> tuple[float, float, float]:
    """Euler angles, radians, of one orientation in another; at a singularity any that give it."""
    first, middle, last = (carrier.inv() * moved).as_euler(order, suppress_warnings=True).tolist()
    return first, middle, last


def wrapped(angle: float) -> float:
    """The same angle between -pi and pi."""
    return float(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)
