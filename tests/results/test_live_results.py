"""Results that are published: what a message holds, and the example that listens."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from gepf.common.transport.opening import open_coordinator
from gepf.coordinator.results.live_results import LiveResults, PackedOutlet, read_result
from tests.support.bodies import person
from tests.support.published import estimate, nobody

EXAMPLE = Path(__file__).parents[2] / "examples" / "live_results.py"


class Heard:
    """Keeps what is published."""

    has_subscriber = True

    def __init__(self) -> None:
        self.payloads: list[bytes] = []

    def put(self, payload: bytes) -> None:
        """A message."""
        self.payloads.append(payload)

    put_blocking = put


def test_before_anybody_is_found_all_is_null() -> None:
    """Such frames are published with nulls; angles begin with the first person."""
    heard: Any = Heard()
    results = LiveResults(PackedOutlet(heard, as_json=True))
    results.put(nobody(0), person(), {})
    results.put(estimate(1, 0.5), person(), {})
    absent, found = (msgspec.json.decode(payload) for payload in heard.payloads)
    assert absent["status"] == "absent"
    for what in ("pose", "angles", "angle_deviation", "joints", "joint_deviation"):
        assert set(absent[what].values()) == {None}
    assert found["angles"]["pelvis_turn"] == pytest.approx(-0.5)


def test_a_message_says_all_of_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Names and values of all results of the frame; null for unknown ones."""
    heard: Any = Heard()
    monkeypatch.setattr(time, "time", lambda: 12.5)
    results = LiveResults(PackedOutlet(heard, as_json=True))
    results.put(estimate(3, 0.5), person(), {})
    results.put(estimate(4, 0.5, "lost"), person(), {})
    results.end()
    first, lost, end = (msgspec.json.decode(payload) for payload in heard.payloads)
    about = [first[name] for name in ("kind", "version", "frame", "estimated_at")]
    assert about == ["estimate", 1, 3, 12.5]
    assert first["pose"]["root_ry"] == 0.5
    assert first["angles"]["pelvis_turn"] == pytest.approx(-0.5)
    wrist = person().joint_names.index("right_wrist")
    assert first["joints"]["right_wrist"] == estimate(3, 0.5).joint_positions[wrist].tolist()
    assert first["joint_deviation"]["right_wrist"] == 0.05
    assert first["joint_off_probability"]["right_wrist"] == 0.25
    assert first["joint_seen"]["right_wrist"] == 0.75
    assert first["hypotheses"] == {"weight": [1.0], "pose": [[*first["pose"].values()]]}
    received = read_result(heard.payloads[0])
    assert received is not None
    assert np.array_equal(received.track.joint_positions[0], estimate(3, 0.5).joint_positions)
    assert lost["joint_seen"]["right_wrist"] is None
    assert lost["angle_deviation"]["pelvis_turn"] is None
    assert lost["status"] == "lost"
    assert end == {"kind": "estimates-end", "version": 1}


def test_angles_go_on_past_half_a_turn() -> None:
    """The turn of a person who keeps turning is continuous, without a jump of 360 degrees."""
    heard: Any = Heard()
    results = LiveResults(PackedOutlet(heard))
    for frame, turn in enumerate(np.linspace(0.0, 6.0, 12)):
        results.put(estimate(frame, float(turn)), person(), {})
    turns = [msgspec.msgpack.decode(payload)["angles"]["pelvis_turn"] for payload in heard.payloads]
    assert np.allclose(turns, -np.linspace(0.0, 6.0, 12))


def test_the_example_listens(endpoint: str) -> None:
    """As a process: it prints a line for each frame that it hears of, and ends with the stream."""
    command = [sys.executable, str(EXAMPLE), endpoint, "robot/person"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as listener,
        open_coordinator((endpoint,), ()) as bus,
    ):
        try:
            publisher = bus.publish("robot/person")
            results, began = LiveResults(PackedOutlet(publisher)), time.monotonic()
            while not publisher.has_subscriber and time.monotonic() < began + 300.0:
                time.sleep(0.02)
            results.put(nobody(6), person(), {})
            results.put(estimate(7, 0.0), person(), {})
            results.end()
            said, _ = listener.communicate(timeout=300.0)
        finally:
            listener.kill()
    assert listener.returncode == 0
    assert said.startswith("6 absent\n7 tracked: right_wrist -0.")
    assert said.endswith("right_elbow_flexion 0.00 rad\n")
