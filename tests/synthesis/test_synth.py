"""Synthetic sequences: rendered for the camera or the cameras of a rig, with stated noise and exact truth."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics, back_project, project
from gepf.common.errors import GepfError, InputError
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.results.evaluation import read_truth
from gepf.coordinator.scene.noise import NO_NOISE, SensorNoise
from gepf.coordinator.sources import Source, open_source
from gepf.coordinator.synthesis.noise import add_noise
from gepf.coordinator.synthesis.person_scene import SHOT, person
from gepf.coordinator.synthesis.rendering import DepthRenderer
from gepf.coordinator.synthesis.scenes import SCENES
from gepf.coordinator.synthesis.sequence import synthesise

CAMERA = Intrinsics(160, 120, 170.0, 180.0, 77.3, 61.8)


def rays(camera: Intrinsics) -> Array:
    """Points (H, W, 3) at depth 1 through every pixel's centre."""
    return back_project(np.ones((camera.height, camera.width)), camera)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first frames of the arm, without noise."""
    out = tmp_path_factory.mktemp("synth") / "arm"
    synthesise("arm", out, frames=3)
    return out


@pytest.mark.parametrize("slope", [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
def test_a_slanted_plane_is_rendered_at_the_pixels_centres(slope: tuple[float, float]) -> None:
    """Depth of z = 2 + a x + b y is right to a hundredth of a pixel in any direction."""
    a, b = slope
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.5
    vertices = np.column_stack([corners, 2.0 + corners @ slope])
    with DepthRenderer(CAMERA) as renderer:
        depth = renderer.depth(vertices, np.array([[0, 2, 1], [0, 3, 2]]))
    x, y, _ = np.moveaxis(rays(CAMERA), -1, 0)
    exact = 2.0 / (1.0 - a * x - b * y)
    seen = depth > 0.0
    depth_of_a_pixel = 2.0 / min(CAMERA.fx, CAMERA.fy)
    assert seen.sum() > 5000
    assert np.abs(depth - exact)[seen].max() < 0.01 * depth_of_a_pixel


@pytest.mark.parametrize(("along", "across"), [(0.15, 0.0), (0.0, 0.01), (0.0, 0.002), (0.02, 0.01)])
@pytest.mark.parametrize("slope", [0.0, 1.0])
def test_noise_has_the_stated_width_along_and_across(along: float, across: float, slope: float) -> None:
    """Points of a noisy plane z = 2.5 + a x lie off it by noise along, and a times noise across."""
    camera = Intrinsics(400, 400, 600.0, 600.0, 199.5, 199.5)
    x = rays(camera)[..., 0]
    disc = np.hypot(x, rays(camera)[..., 1]) < 0.28
    exact = np.where(disc, 2.5 / (1.0 - slope * x), 0.0)
    noisy = add_noise(exact, camera, SensorNoise(along, across), np.random.default_rng(1))
    points = back_project(noisy, camera)[(noisy > 0.0) & (np.hypot(x, rays(camera)[..., 1]) < 0.25)]
    off = points[:, 2] - 2.5 - slope * points[:, 0]
    assert np.std(off) == pytest.approx(np.hypot(along, slope * across), rel=0.03, abs=1e-9)
    assert abs(np.mean(off)) < 0.02 * max(along, across)
    assert np.sum(noisy > 0.0) == pytest.approx(np.sum(exact > 0.0), rel=0.01)


def test_no_noise_changes_nothing_and_nothing_stays_nothing() -> None:
    """Noise of width zero returns the image, and an image without depth gets none from noise."""
    exact = np.where(np.hypot(*np.indices((60, 80)) - 30) < 20, 1.5, 0.0)
    camera = Intrinsics(80, 60, 90.0, 90.0, 39.5, 29.5)
    rng = np.random.default_rng(0)
    assert np.array_equal(add_noise(exact, camera, NO_NOISE, rng), exact)
    assert not add_noise(0.0 * exact, camera, SensorNoise(0.1, 0.01), rng).any()


def test_a_sequence_is_one_that_can_be_opened_with_its_truth_and_start(sequence: Path) -> None:
    """The folder reads as a recorded sequence; its depth is the scene's to a tenth of a millimetre."""
    source, scene = open_source(sequence), SCENES["arm"]()
    assert (source.numbers, source.fps, source.intrinsics) == (range(3), 25.0, scene.camera)
    assert source.truth is not None
    truth = read_truth(source.truth)
    assert truth.dof_names == scene.model.dof_names
    assert np.array_equal(truth.pose, scene.poses[:3])
    assert np.array_equal(truth.joint_positions, joint_positions(scene.model, scene.poses[:3]))
    with DepthRenderer(scene.camera) as renderer:
        exact = renderer.depth(pose_vertices(scene.model, scene.poses[2:3])[0], scene.model.triangles)
    assert np.abs(source.view(2).metres() - exact).max() < 0.6e-4
    assert np.array_equal(source.view(2).depth > 0, exact > 0.0)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_other_noise(tmp_path: Path) -> None:
    """Every file of a noisy sequence is reproducible; its first frames do not depend on their number."""
    for name, frames, seed in (("one", 2, 7), ("two", 2, 7), ("short", 1, 7), ("other", 1, 8)):
        synthesise("arm", tmp_path / name, frames, 0.15, 0.01, seed)
    files = sorted(p.relative_to(tmp_path / "one") for p in (tmp_path / "one").rglob("*.*"))
    assert len(files) == 5
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    first = "depth/000000.png"
    assert (tmp_path / "short" / first).read_bytes() == (tmp_path / "one" / first).read_bytes()
    assert (tmp_path / "other" / first).read_bytes() != (tmp_path / "one" / first).read_bytes()


@pytest.mark.parametrize("name", ["arm", "turn"])
def test_a_scene_moves_as_a_person_can_and_stays_in_the_picture(name: str) -> None:
    """Angles keep to their limits and below 18 degrees a frame, as in a spin; no vertex leaves the image."""
    scene = SCENES[name]()
    model = scene.model
    angles = [j for j, dof in enumerate(model.dof_names) if not dof.startswith("root_t")]
    assert np.degrees(np.abs(np.diff(scene.poses[:, angles], axis=0)).max()) < 18.0
    assert np.all((scene.poses >= model.limits[:, 0]) & (scene.poses <= model.limits[:, 1]))
    for pose in scene.poses[::5]:
        pixels = project(pose_vertices(model, pose[None])[0], scene.camera)
        assert pixels.min() > 0.0
        assert np.all(pixels.max(axis=0) < (scene.camera.width - 1, scene.camera.height - 1))


@pytest.mark.parametrize(
    ("scene", "wish", "complaint"),
    [
        ("arm", {"frames": 177}, "choose from 1 to 176"),
        ("arm", {"noise_depth": -0.1}, "choose from 0 to 1 metre"),
        ("arm", {"noise_lateral": float("nan")}, "choose from 0 to 1 metre"),
        ("arm", {"seed": -1}, "choose 0 or more"),
        ("turn", {"cameras": 0}, "choose 1 to"),
    ],
)
def test_a_wish_that_cannot_be_met_is_one_line_and_leaves_nothing(
    scene: str, wish: dict[str, float], complaint: str, tmp_path: Path
) -> None:
    """The message names the choices, and no folder appears."""
    with pytest.raises(InputError, match=complaint):
        synthesise(scene, tmp_path / "out", **wish)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_a_folder_in_use_is_left_alone(tmp_path: Path) -> None:
    """A folder that holds something is refused, and what it holds stays."""
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="choose another"):
        synthesise("arm", tmp_path, frames=1)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_without_opengl_the_message_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine whose EGL has no device gets one line that says what to install."""
    monkeypatch.setenv("EGL_DEVICE_ID", "99")
    with pytest.raises(GepfError, match="apt install libegl1 libgl1"):
        DepthRenderer(CAMERA)


def test_a_person_is_another_with_every_seed_and_moves_as_people_can() -> None:
    """The same seed, the same poses; feet on the floor; limits kept; at rest first, then fast."""
    scene, again, other = person(3), person(3), person(4)
    assert np.array_equal(scene.poses, again.poses)
    assert not np.array_equal(scene.model.vertices.max(axis=0), other.model.vertices.max(axis=0))
    low, high = scene.model.limits.T
    assert np.all((scene.poses >= low - 1e-9) & (scene.poses <= high + 1e-9))
    lowest = [pose_vertices(scene.model, pose[None])[0, :, 1].max() for pose in scene.poses[::10]]
    assert np.ptp(lowest) < 1e-9
    joints = joint_positions(scene.model, scene.poses)
    speed = np.linalg.norm(np.diff(joints, axis=0), axis=-1).max(axis=1) * SHOT.fps
    assert speed[:4].max() < 0.01
    assert speed.max() > 2.5  # metres a second, of a wrist
    assert scene.start is None


def test_a_person_is_rendered_without_a_start(tmp_path: Path) -> None:
    """The person must be detected; the truth exists."""
    synthesise("person", tmp_path / "fast", frames=2, seed=1, kinect=True)
    source = open_source(tmp_path / "fast")
    assert source.init is None
    assert source.fps == SHOT.fps
    truth = read_truth(tmp_path / "fast" / "truth.npz")
    assert truth.joint_positions.shape == (2, 15, 3)
    with pytest.raises(InputError, match="has a body of its own"):
        synthesise("person", tmp_path / "other", model="human")


LATE_S = 0.008


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Source:
    """Three cameras, 60 degrees and 8 ms from each other, around two people in a room."""
    out = tmp_path_factory.mktemp("synth") / "rig"
    synthesise("two", out, frames=4, cameras=3, apart=60.0, late=1000.0 * LATE_S, room=True)
    return open_source(out / "rig.json")


def test_cameras_are_around_the_person_and_late(rig: Source) -> None:
    """They look at one place from one distance, and each has images 8 ms after those of the one before."""
    assert [view.camera for view in rig.views] == ["cam0", "cam1", "cam2"]
    frame = rig.frame(2)
    for n, view in enumerate(frame.views):
        assert view.time_s - frame.time_s == pytest.approx(n * LATE_S)
    ahead = [view.T_rig_camera[:3, 2] for view in rig.views]
    for one, other in pairwise(ahead):
        assert np.degrees(np.arccos(one @ other)) == pytest.approx(60.0)


def test_truth_and_images_are_one_motion(rig: Source) -> None:
    """Joints of every camera, at its times, are on one path; all see one floor, and depth at the joints."""
    paths = []
    for view in rig.views:
        assert view.truth is not None
        joints = read_truth(view.truth, np.eye(4)).joint_positions
        paths.append(joints @ view.T_rig_camera[:3, :3].T + view.T_rig_camera[:3, 3])
        for frame in view:
            (image,) = frame.views
            metres = image.metres()
            points = back_project(metres, image.intrinsics)[metres > 0.0]
            floor = (points @ view.T_rig_camera[:3, :3].T + view.T_rig_camera[:3, 3])[:, 1].max()
            assert floor == pytest.approx(1.0, abs=0.01)  # the camera is one metre high
            at = np.rint(project(joints[frame.number], image.intrinsics)).astype(int)
            inside = (
                (at[:, 1] < metres.shape[0] - 1) & (at[:, 0] < metres.shape[1] - 1) & np.all(at > 0, axis=1)
            )
            behind = joints[frame.number][inside, 2] - metres[at[inside, 1], at[inside, 0]]
            assert behind.min() > -0.02
    for n, path in enumerate(paths):
        step = n * LATE_S * rig.fps
        between = (1.0 - step) * paths[0][:-1] + step * paths[0][1:]
        assert np.abs(path[:-1] - between).max() < 0.003
