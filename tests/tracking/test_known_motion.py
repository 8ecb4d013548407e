"""Joint states as the motion prior's mean: a robot that is too fast for its camera is tracked."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.common.frame import Frame, View
from gepf.common.kinematics import retract
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.urdf import read_urdf
from gepf.coordinator.cli import main
from gepf.coordinator.filters.methods import initial_belief
from gepf.coordinator.results.evaluation import read_truth
from gepf.coordinator.scene.noise import NO_NOISE
from gepf.coordinator.settings import Settings
from gepf.coordinator.sources.camera import write_camera
from gepf.coordinator.sources.joint_states import JointStates, read_joint_states
from gepf.coordinator.synthesis.scenes import Scene, roam
from gepf.coordinator.synthesis.sequence import DEPTH_SCALE, write_depth, write_start, write_truth
from gepf.coordinator.tracking.observation import isolate
from gepf.coordinator.tracking.particle_filter import ParticleFilter, encoder_step
from gepf.coordinator.tracking.target import resolve
from gepf.refiners import DirectRefiner
from tests.support.stand_ins import Direct

ARM = Path(__file__).parents[2] / "examples" / "arm7.urdf"
EVERY, FRAMES = 48, 12
SEEDS = range(2)
OFFSET_DEG = 5.0  # of every encoder
SCORES = ("mean_joint_error_cm", "within_deviation", "within_two_deviations")


@pytest.fixture(scope="module")
def fast(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every 48th frame of the robot as it roams: joints move by up to 66 degrees from one to the next."""
    folder, whole = tmp_path_factory.mktemp("fast"), roam(read_urdf(ARM), 1, EVERY * FRAMES)
    poses = whole.poses[::EVERY].copy()
    scene = Scene(whole.model, whole.camera, whole.fps / EVERY, poses, poses[0].copy())
    list(write_depth(scene, NO_NOISE, 0, folder / "depth", kinect=True))
    write_camera(folder / "camera_intrinsic.json", scene.camera, DEPTH_SCALE, scene.fps)
    write_truth(scene, folder / "truth.npz")
    write_start(scene.model, poses[0], folder / "init.json")
    return folder


def write_states(sequence: Path, file: Path) -> Path:
    """Encoders' values in degrees, all off by the same, at other times than the frames'."""
    truth = read_truth(sequence / "truth.npz")
    names = [name for name in truth.dof_names if not name.startswith("root_")]
    whole = roam(read_urdf(ARM), 1, EVERY * FRAMES)
    columns = [whole.model.dof(name) for name in names]
    with file.open("w", newline="") as opened:
        writer = csv.writer(opened)
        writer.writerow(["time_s", *(f"{name}_deg" for name in names)])
        for number in range(0, len(whole.poses), 5):
            degrees = np.degrees(whole.poses[number, columns]) + OFFSET_DEG
            writer.writerow([number / whole.fps, *degrees.tolist()])
    return file


def score(sequence: Path, out: Path, capsys: pytest.CaptureFixture[str], *options: str) -> Array:
    """Joint error in centimetres, and shares within one and two deviations: means of runs over the seeds.

    The runs have four particles.
    """
    scores = []
    for seed in SEEDS:
        run = str(out / str(seed))
        given = ["--model", str(ARM), "--dof", "joints", "--particles", "4", "--points", "1500", *options]
        command = ["track", str(sequence), *given, "--seed", str(seed), "--out", run, "--no-pictures", "-q"]
        assert main(command, Direct().connect) in (0, 3)
        assert main(["evaluate", run, "--truth", str(sequence / "truth.npz")]) == 0
        found = json.loads(capsys.readouterr().out)
        scores.append([found[name] for name in SCORES])
    mean: Array = np.mean(scores, axis=0)
    return mean


def test_a_fast_robot_is_followed_where_its_encoders_lead(
    fast: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With joint states, 5 degrees off, to 5 mm, as if it were slow; without them the error is twice that.

    The stated deviations of the joints are of the size of their errors.
    """
    states = write_states(fast, tmp_path / "joints.csv")
    led, within, within_two = score(fast, tmp_path / "led", capsys, "--joint-states", str(states))
    assert led < 0.5
    assert within < 0.9
    assert within_two > 0.6
    assert led < 0.5 * score(fast, tmp_path / "alone", capsys)[0]


def states(names: tuple[str, ...], values: list[list[float]]) -> JointStates:
    """States at 0, 1, 2 ... seconds."""
    return JointStates(names, np.arange(len(values), dtype=np.float64), np.array(values))


def test_steps_are_changes_of_what_is_known_alone() -> None:
    """Interpolated in time; unknown joints, times outside and balls of which a part is known have none."""
    model = human()
    pose = np.zeros(len(model.dof_names))
    known = states(("l_elbow_flexion", "l_shoulder_flexion", "gripper"), [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    step = encoder_step(known, model, pose, 0.25, 0.75)
    assert step is not None
    assert step[model.dof("l_elbow_flexion")] == pytest.approx(0.5)
    assert np.isfinite(step).sum() == 1
    assert encoder_step(known, model, pose, 0.5, 1.5) is None
    assert encoder_step(known, model, pose, None, 0.5) is None


def test_a_ball_turns_as_its_three_joints_say() -> None:
    """The step leads from the one turn to the other, though the angles do not simply add."""
    model = human()
    names = ("l_shoulder_flexion", "l_shoulder_abduct", "l_shoulder_twisting")
    columns = [model.dof(name) for name in names]
    one, other = [0.2, 0.9, -0.3], [1.1, 0.4, 0.5]
    pose = np.zeros(len(model.dof_names))
    pose[columns] = one
    step = encoder_step(states(names, [one, other]), model, pose, 0.0, 1.0)
    assert step is not None
    moved: Array = retract(model, pose[None], np.nan_to_num(step)[None])[0]
    assert np.allclose(moved[columns], other)


def test_a_bag_of_joint_states_is_read(tmp_path: Path) -> None:
    """Times from the first state, where there is no depth; the joints' own order of names."""
    types = get_typestore(Stores.ROS1_NOETIC)
    state, header = types.types["sensor_msgs/msg/JointState"], types.types["std_msgs/msg/Header"]
    stamp = types.types["builtin_interfaces/msg/Time"](0, 0)
    with Writer(tmp_path / "joints.bag") as bag:
        topic = bag.add_connection("/joint_states", state.__msgtype__, typestore=types)
        for k in range(3):
            empty = np.empty(0)
            message = state(header(k, stamp, ""), ["b", "a"], np.array([0.1 * k, 2.0]), empty, empty)
            bag.write(topic, 5_000_000_000 + 10_000_000 * k, types.serialize_ros1(message, state.__msgtype__))
    read = read_joint_states(tmp_path / "joints.bag")
    assert read.names == ("b", "a")
    assert np.allclose(read.times_s, [0.0, 0.01, 0.02])
    assert np.allclose(read.at(0.015), [0.15, 2.0])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a,b\n1,2\n3,4\n", "has no column time_s, but a, b"),
        ("time_s,a\n0,1\n", "has 1 states of 1 joints"),
        ("time_s,a\n0,1\n0,2\n", "finite numbers and different times"),
        ("time_s,a\n0,one\n", "cannot read"),
        ("time_s,a\n0,nan\n1,2\n", "with finite numbers"),
    ],
)
def test_a_file_without_sense_is_refused(tmp_path: Path, text: str, says: str) -> None:
    """One line says how to correct it."""
    (tmp_path / "joints.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        read_joint_states(tmp_path / "joints.csv")


def test_states_that_the_body_does_not_have_are_named(caplog: pytest.LogCaptureFixture) -> None:
    """A misspelt joint among good ones: a warning with the name that may be meant; another robot: refused."""
    known = read_urdf(ARM).dof_names
    states(("elbow", "wrist_bend"), [[0.0, 0.0]]).check_names(known)
    assert not caplog.text
    states(("elbow", "wrist_bent", "qqq"), [[0.0, 0.0, 0.0]]).check_names(known)
    assert "'wrist_bent'; did you mean wrist_bend" in caplog.text
    assert "'qqq'; gepf model dofs lists all; its states are left out" in caplog.text
    with pytest.raises(InputError, match="--joint-states: unknown degree of freedom 'axis1'"):
        states(("axis1", "elbw"), [[0.0, 0.0]]).check_names(known)


def test_where_encoders_say_nothing_colour_moves_the_body() -> None:
    """Encoders of other joints, or before their first value: the step that colour shows is not lost."""
    model, start, step = human(), np.zeros(len(human().dof_names)), np.array([0.3, 0.0, 0.0])
    silent = JointStates(("wheel",), np.array([0.0, 1.0]), np.zeros((2, 1)))
    depth = np.full((24, 32), 2500, np.uint16)
    frame = Frame.of(View(1, 1 / 30, depth, 1000.0, Intrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)))
    subject = isolate(frame, 100)
    assert subject is not None
    settings = resolve(Settings(), PEOPLE)
    moved = []
    for encoders in (None, silent):
        particles = ParticleFilter(DirectRefiner(), settings, PEOPLE, encoders)
        belief = initial_belief(model, start, settings)
        moved.append(particles.propose(model, belief, subject, 0.0, None, step).poses)
    np.testing.assert_array_equal(moved[0], moved[1])
    assert abs(np.median(moved[0][:, model.dof("root_tx")]) - step[0]) < 0.1
