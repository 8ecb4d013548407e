"""Results as messages of ROS 2, heard and answered by a peer of other people (zenoh-ros2-sdk) at a router."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh_ros2_sdk as peer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array
from gepf.common.camera import rigid
from gepf.common.transport.opening import open_router, open_worker
from gepf.coordinator.cli import main
from gepf.coordinator.results.live_results import LiveResults
from gepf.coordinator.results.ros2_results import RosOutlet
from gepf.coordinator.results.ros_humans import HumanBodies
from gepf.coordinator.results.track import read_track
from gepf.coordinator.sources.ros2 import Node
from tests.support.bodies import person
from tests.support.live import AT_TWO_METRES, at_work, plate_image, tracking
from tests.support.processes.certificates import free_port
from tests.support.processes.programs import in_thread, wait_until
from tests.support.published import estimate, nobody
from tests.support.ros import CAMERA, IMAGE, camera_of, header_of, image_of

TOPICS = {
    "/gepf/joint_states": "sensor_msgs/msg/JointState",
    "/gepf/certainty": "diagnostic_msgs/msg/DiagnosticArray",
    "/gepf/markers": "visualization_msgs/msg/MarkerArray",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/humans/bodies/tracked": "hri_msgs/msg/IdsList",
    "/humans/bodies/gepf/joint_states": "sensor_msgs/msg/JointState",
}
HRI = {"IdsList": "std_msgs/Header header\nstring[] ids\n"}  # of the package hri_msgs
DEPTH = "/camera/depth/image_rect_raw"


class Peer:
    """A robot: keeps what it hears of results, and publishes images."""

    def __init__(self, port: int) -> None:
        self.at: dict[str, Any] = {"router_ip": "127.0.0.1", "router_port": port}
        self.heard: dict[str, list[Any]] = {topic: [] for topic in TOPICS}
        self.subscribers = [
            peer.ROS2Subscriber(topic, kind, self.heard[topic].append, **self.at)
            for topic, kind in TOPICS.items()
        ]
        self.images = peer.ROS2Publisher(DEPTH, IMAGE, **self.at)
        self.cameras = peer.ROS2Publisher(f"{DEPTH[:13]}/camera_info", CAMERA, **self.at)
        self.types = peer.ZenohSession.get_instance().store.types

    def show(self, number: int) -> None:
        """Publish the picture of a plate, and its camera."""
        frame, sec = plate_image(number), 1_764_000_000 + number
        header = header_of(self.types, "optical", sec, 123_456_789)
        camera = camera_of(self.types, header, frame.intrinsics)
        self.cameras.publish(**{each.name: getattr(camera, each.name) for each in fields(camera)})
        image = image_of(self.types, header, frame.depth)
        self.images.publish(**{each.name: getattr(image, each.name) for each in fields(image)})


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Peer]:
    """A peer at a router. It computes hashes of types from their definitions, which it would download."""
    folder, types = tmp_path_factory.mktemp("messages"), get_typestore(Stores.ROS2_JAZZY)
    for kind in types.types:
        package, group, name = kind.split("/")
        file = folder / package / group / f"{name}.msg"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(types.generate_msgdef(kind, ros_version=2)[0].split("=" * 80)[0])
    for name, definition in HRI.items():
        (folder / "hri_msgs" / "msg").mkdir(parents=True, exist_ok=True)
        (folder / "hri_msgs" / "msg" / f"{name}.msg").write_text(definition)
    peer.get_registry().messages_dir = folder
    port = free_port()
    with open_router([f"tcp/127.0.0.1:{port}"]):
        robot = Peer(port)
        yield robot
        peer.ZenohSession.get_instance().close()


def test_a_robot_hears_all_about_a_person(robot: Peer) -> None:
    """Frames are at the joints with ROS's axes, the surface is the body's, doubtful joints are marked.

    The person is a tracked body of REP 155, whose frames are at the joints, too. When the person is lost,
    only the certainty goes on, the markers are deleted, and no body is tracked.
    """
    model, seen, away = person(), estimate(3, 0.0), np.array([0.0, 0.0, 2.0])
    seen.pose[model.dof("root_tz")] = away[2]
    placed = replace(seen, joint_positions=seen.joint_positions + away)
    with open_worker([f"tcp/127.0.0.1:{robot.at['router_port']}"]) as bus:
        node = Node(bus, 0)
        outlet = RosOutlet(node, "/gepf", HumanBodies(node))
        wait_until(lambda: all(name in dict(peer.get_topic_names_and_types(**robot.at)) for name in TOPICS))
        results = LiveResults(outlet)
        wait_until(lambda: all(each.has_subscriber for each in outlet.topics))
        results.put(placed, model, {})  # an overloaded link drops messages
        wait_until(lambda: all(robot.heard.values()))
        results.put(nobody(4), model, {})
        results.end()
        wait_until(lambda: [len(got) for got in robot.heard.values()] == [1, 2, 3, 1, 3, 1])
    states, frames = robot.heard["/gepf/joint_states"][0], robot.heard["/tf"][0].transforms
    assert dict(zip(states.name, states.position, strict=True))["right_elbow_flexion"] == pytest.approx(0.0)
    assert (states.header.stamp.nanosec, states.header.frame_id) == (100_000_000, "camera")
    frames, parts = frames[: len(model.joint_names)], frames[len(model.joint_names) :]
    assert [frame.child_frame_id for frame in frames] == [f"gepf/{name}" for name in model.joint_names]
    moved = [frame.transform.translation for frame in frames]
    assert np.allclose([[at.x, at.y, at.z] for at in moved], placed.joint_positions)
    turn = frames[0].transform.rotation
    ahead_left_up = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix().T
    assert np.allclose(ahead_left_up, [[0, 0, -1], [1, 0, 0], [0, -1, 0]])  # the person faces the camera
    assert [each.ids for each in robot.heard["/humans/bodies/tracked"]] == [["gepf"], [], []]
    places = dict(zip(model.joint_names, placed.joint_positions, strict=True))
    root, *others = parts
    assert (root.header.frame_id, root.child_frame_id) == ("camera", "body_gepf")
    hips = 0.5 * (places["left_hip"] + places["right_hip"])
    assert np.allclose(transform_of(root)[:3, 3], hips)
    assert np.allclose(transform_of(root)[:3, :3], [[0, 1, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-6)
    assert {frame.header.frame_id for frame in others} == {"body_gepf"}
    found = {each.child_frame_id: (transform_of(root) @ transform_of(each))[:3, 3] for each in others}
    for short, side in (("l", "left"), ("r", "right")):
        for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
            assert np.allclose(found[f"{short}_{part}_gepf"], places[f"{side}_{part}"])
    assert {"waist_gepf", "torso_gepf", "head_gepf"} < set(found)
    body, doubts = robot.heard["/gepf/markers"][0].markers
    corners = [[at.x, at.y, at.z] for at in body.points]
    surface = model.vertices + away
    assert np.max(KDTree(surface).query(corners)[0]) < 1e-9
    assert np.allclose([np.min(corners, 0), np.max(corners, 0)], [surface.min(0), surface.max(0)], atol=0.04)
    assert (doubts.action, len(doubts.points)) == (0, len(model.joint_names))  # all by 0.25
    assert [each.markers[0].action for each in robot.heard["/gepf/markers"][1:]] == [3, 3]
    certain, lost = robot.heard["/gepf/certainty"]
    wrist = next(each for each in certain.status if each.name == "gepf/right_wrist")
    values = {each.key: float(each.value) for each in wrist.values}
    assert (wrist.level, values) == (1, {"off_probability": 0.25, "deviation_m": 0.05, "seen": 0.75})
    assert (certain.status[0].level, lost.status[0].level, lost.status[0].message) == (0, 2, "absent")


def transform_of(frame: Any) -> Array:
    """The transform (4, 4) of a frame."""
    at, turn = frame.transform.translation, frame.transform.rotation
    return rigid(
        Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix(), np.array([at.x, at.y, at.z])
    )


def test_a_robot_has_its_images_tracked(robot: Peer, tmp_path: Path) -> None:
    """It finds our subscription in the graph, and hears where the plate is, at the time of its own images."""
    router, shown = f"tcp/127.0.0.1:{robot.at['router_port']}", list[int]()

    def show(stop: Any) -> None:
        info = None
        while not stop.wait(0.1) and not (info and info.subscriber_count):
            info = peer.get_topic_info(DEPTH, **robot.at)
        while not stop.wait(0.1):
            robot.show(len(shown))
            shown.append(len(shown))
            if len(robot.heard["/tf"]) > 4:
                os.kill(os.getpid(), signal.SIGINT)  # topics have no end
                return

    robot.heard["/tf"].clear()
    options = {"connect": router, "publish": "ros2:/gepf", "particles": 20}
    with at_work(router), in_thread(show):
        assert main(tracking(f"ros2:{DEPTH}", tmp_path / "run", "--no-pictures", **options)) == 0
    track = read_track(tmp_path / "run")
    assert len(track.frame) > 4
    for each in robot.heard["/tf"]:
        (frame,) = each.transforms
        assert frame.header.frame_id == "optical"
        assert frame.header.stamp.nanosec == 123_456_789
        assert 1_764_000_000 <= frame.header.stamp.sec < 1_764_000_000 + len(shown)
        at = frame.transform.translation
        assert np.allclose([at.x, at.y, at.z], AT_TWO_METRES[:3])
