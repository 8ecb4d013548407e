"""The result of each frame as messages of ROS 2; docs/live.md describes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array
from gepf.common.body import REST_FROM_URDF, TRANSLATION, BodyModel, with_fixed_shape
from gepf.common.kinematics import link_transforms, pose_vertices
from gepf.coordinator.bodies.tracked import coarsen
from gepf.coordinator.palette import PALETTE
from gepf.coordinator.results.live_results import ResultMessage
from gepf.coordinator.results.ros_humans import HumanBodies, body_frames, body_id, in_body, joint_states
from gepf.coordinator.settings import CertaintySettings
from gepf.coordinator.sources.ros2 import Node
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN

JOINTS, FRAMES = "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"
CERTAINTY, MARKERS = "diagnostic_msgs/msg/DiagnosticArray", "visualization_msgs/msg/MarkerArray"
MARKER, STATUS = "visualization_msgs/msg/Marker", "diagnostic_msgs/msg/DiagnosticStatus"
BODY, DOUBTS = "body", "doubtful joints"
COLOURS = {BODY: (*PALETTE.exported_body, 0.6), DOUBTS: (*PALETTE.doubtful_joint, 0.9)}


class MarkerSettings(msgspec.Struct, frozen=True):
    """What is drawn for RViz."""

    doubt_m: float = 0.12  #: diameter of the sphere around a doubtful joint
    surface_m: float = 0.04  #: between the vertices of the body: 200 kB per frame instead of 460


DRAWN = MarkerSettings()
PLACEHOLDER = (1e300, 2e300, 3e300)  # a point

Point = Sequence[float]


class RosOutlet:
    """Publishes results on topics below `topic`, and the frames of joints on /tf.

    While the pose is unknown there are no joint states and frames, and the markers are deleted. The names of
    frames begin with the topic. A person is also one of the `humans`, with frames and joint states as
    in REP 155.
    """

    def __init__(self, node: Node, topic: str, humans: HumanBodies | None = None) -> None:
        self._make, self._header, self._name = node.make, node.header, topic[1:]
        self._humans, self._id = humans, body_id(topic)
        self._marked, self._states = node.type(MARKER), node.type(STATUS)
        self._joints = node.advertise(f"{topic}/joint_states", JOINTS)
        self._frames = node.advertise("/tf", FRAMES)
        self._certainty = node.advertise(f"{topic}/certainty", CERTAINTY)
        self._markers = node.advertise(f"{topic}/markers", MARKERS)
        self.topics = [self._joints, self._frames, self._certainty, self._markers]
        if humans is not None:
            self._human_joints = node.advertise(f"/humans/bodies/{self._id}/joint_states", JOINTS)
            self.topics += [humans.topic, self._human_joints]

    @property
    def has_subscriber(self) -> bool:
        """Whether any of the topics has a subscriber."""
        return any(topic.has_subscriber for topic in self.topics)

    def put(self, message: ResultMessage, model: BodyModel) -> None:
        """Publish a result on the topics that have subscribers."""
        header = self._header(message.time_s)
        if self._certainty.has_subscriber:
            self._certainty.put(self._make(CERTAINTY, header, self._statuses(message)))
        if self._humans is not None:
            self._humans.put(self._id, message.time_s, tracked=message.status not in POSE_UNKNOWN)
        if message.status in POSE_UNKNOWN:
            self._clear(header)
            return
        pose, shape = np.array([[*message.pose.values()]], dtype=np.float64), np.array(message.shape)
        coarse, model = coarsen(model, DRAWN.surface_m), with_fixed_shape(model, shape)
        if self._joints.has_subscriber:
            slides = {name: message.pose[name] for name in model.joints_of(TRANSLATION)}  # metres
            values = {name: value for name, value in (slides | message.angles).items() if value is not None}
            self._joints.put(self._states_of(header, values))
        if self._humans is not None and self._human_joints.has_subscriber:
            states = joint_states(body_frames(model, pose[0]))
            self._human_joints.put(
                self._states_of(header, {f"{name}_{self._id}": value for name, value in states.items()})
            )
        if self._frames.has_subscriber:
            turns = link_transforms(model, pose)[0][model.joint_links, :, :3] @ REST_FROM_URDF
            placed = zip(message.joints.items(), Rotation.from_matrix(turns).as_quat().tolist(), strict=True)
            frames = [
                self._frame(header, f"{self._name}/{name}", place, turn)
                for (name, place), turn in placed
                if place
            ]
            if self._humans is not None:
                frames += self._body(header, model, pose[0])
            self._frames.put(self._make(FRAMES, frames))
        if self._markers.has_subscriber:
            doubts = [place for name, place in message.joints.items() if place and is_doubtful(message, name)]
            body = self._marker(header, BODY, self._marked.ADD, [PLACEHOLDER])
            action = self._marked.ADD if doubts else self._marked.DELETE
            spheres, coarse = self._marker(header, DOUBTS, action, doubts), with_fixed_shape(coarse, shape)
            corners = pose_vertices(coarse, pose)[0][coarse.triangles.ravel()]
            self._markers.put(
                self._make(MARKERS, [body, spheres]), lambda payload: with_points(payload, corners)
            )

    def end(self) -> None:
        """Delete the markers, and remove the body from the list of tracked bodies."""
        if self._humans is not None:
            self._humans.put(self._id, 0.0, tracked=False)
        self._clear(self._header(0.0))

    def _states_of(self, header: Any, values: Mapping[str, float]) -> Any:
        """Joint states by name."""
        positions, nothing = np.array([*values.values()], dtype=np.float64), np.empty(0)
        return self._make(JOINTS, header, [*values], positions, nothing, nothing)

    def _body(self, header: Any, model: BodyModel, pose: Array) -> list[Any]:
        """The frames of a person's body and of its parts, by REP 155."""
        frames, root = body_frames(model, pose), f"body_{self._id}"
        inside = self._make("std_msgs/msg/Header", header.stamp, root)
        place, turn = frames["body"]
        return [self._frame(header, root, place.tolist(), turn.as_quat().tolist())] + [
            self._frame(inside, f"{name}_{self._id}", at.tolist(), own.as_quat().tolist())
            for name, (at, own) in in_body(frames).items()
        ]

    def _clear(self, header: Any) -> None:
        self._markers.put(self._make(MARKERS, [self._marker(header, BODY, self._marked.DELETEALL, [])]))

    def _statuses(self, message: ResultMessage) -> list[Any]:
        """The status of the body, then that of each joint."""
        is_known, states = message.status not in POSE_UNKNOWN, self._states
        level = states.OK if message.status == "tracked" else states.WARN if is_known else states.ERROR
        parts = [self._status("body", level, message.why or message.status, {"residual_m": message.residual})]
        for name, doubt in message.joint_off_probability.items():
            values = {
                "off_probability": doubt,
                "deviation_m": message.joint_deviation[name],
                "seen": message.joint_seen[name],
            }
            level = states.WARN if is_doubtful(message, name) else states.OK
            parts.append(self._status(name, level, "may be wrong" if level else "", values))
        return parts

    def _status(self, name: str, level: int, words: str, values: dict[str, float | None]) -> Any:
        listed = [
            self._make("diagnostic_msgs/msg/KeyValue", key, "" if value is None else f"{value:.4g}")
            for key, value in values.items()
        ]
        named = f"{self._name}/{name}", words, ""
        return self._states(level, *named, listed)

    def _frame(self, header: Any, name: str, place: Point, turn: Point) -> Any:
        """A frame in that of the header; `turn` is a quaternion x, y, z, w."""
        moved = self._make("geometry_msgs/msg/Vector3", *place)
        turned = self._make("geometry_msgs/msg/Quaternion", *turn)
        transform = self._make("geometry_msgs/msg/Transform", moved, turned)
        return self._make("geometry_msgs/msg/TransformStamped", header, name, transform)

    def _marker(self, header: Any, name: str, action: int, points: Sequence[Point]) -> Any:
        make, no_bytes = self._make, np.empty(0, dtype=np.uint8)
        kind, size = (
            (self._marked.TRIANGLE_LIST, 1.0) if name == BODY else (self._marked.SPHERE_LIST, DRAWN.doubt_m)
        )
        place, image = make("geometry_msgs/msg/Point", 0.0, 0.0, 0.0), "sensor_msgs/msg/CompressedImage"
        pose = make("geometry_msgs/msg/Pose", place, make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0))
        scale, colour = make("geometry_msgs/msg/Vector3", size, size, size), COLOURS[name]
        ever = make("builtin_interfaces/msg/Duration", 0, 0)  # until it is deleted
        shown = scale, make("std_msgs/msg/ColorRGBA", *colour), ever, False
        corners = [make("geometry_msgs/msg/Point", *point) for point in points]
        mesh = make("visualization_msgs/msg/MeshFile", "", no_bytes)
        unused: tuple[Any, ...] = [], "", make(image, header, "", no_bytes), [], "", "", mesh, False
        return self._marked(header, f"{self._name}/{name}", 0, kind, action, pose, *shown, corners, *unused)


def is_doubtful(message: ResultMessage, joint: str) -> bool:
    """Whether a joint may be wrong, or nothing is known about it."""
    doubt = message.joint_off_probability[joint]
    return doubt is None or doubt >= CertaintySettings().flagged_probability


def with_points(payload: bytes, points: Array) -> bytes:
    """An encoded message in which points (N, 3) replace the only point of a list, the placeholder.

    Encoding the thousands of corners of a surface as objects would take longer than tracking the frame.
    """
    one, placeholder = np.uint32(1).tobytes(), np.array(PLACEHOLDER).tobytes()
    at = payload.index(placeholder)
    counted = payload.rindex(one, 0, at)
    filled = payload[:counted] + np.uint32(len(points)).tobytes() + payload[counted + 4 : at]
    return filled + points.astype("<f8").tobytes() + payload[at + len(placeholder) :]
