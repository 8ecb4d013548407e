"""Pictures of a run: they exist, have the right content at the right place, and never stop a run."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageColor
from scipy.ndimage import binary_dilation

from gepf.common.activation import activate
from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics, project
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.bodies.families import angles_of
from gepf.coordinator.palette import STATUS
from gepf.coordinator.pictures.film import spread, tile, write_film
from gepf.coordinator.pictures.overlay import Viewport, paint, view_around
from gepf.coordinator.pictures.plots import angle_curves, curves_of, plot_curves
from gepf.coordinator.pictures.run import draw_run
from gepf.coordinator.pictures.shading import draw_body, shade_depth
from gepf.coordinator.results.evaluation import Truth, read_truth
from gepf.coordinator.results.track import Track, TrackedBody
from gepf.coordinator.sources import Source, open_source
from gepf.coordinator.synthesis.rendering import DepthRenderer
from gepf.coordinator.synthesis.scenes import ARM_DOFS, SCENES
from gepf.coordinator.synthesis.sequence import synthesise
from tests.support.bodies import person
from tests.support.runs import make_track, swing, write_run

FRAMES = 4


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    """The first frames of the arm."""
    out = tmp_path_factory.mktemp("pictures") / "arm"
    synthesise("arm", out, frames=FRAMES)
    return open_source(out)


@pytest.fixture(scope="module")
def truth(source: Source) -> Truth:
    """The truth that comes with it."""
    assert source.truth is not None
    return read_truth(source.truth)


@pytest.fixture(scope="module")
def model() -> BodyModel:
    """The body with the four angles that move."""
    scene = SCENES["arm"]()
    return activate(scene.model, ARM_DOFS, scene.poses[0])


@pytest.fixture(scope="module")
def track(model: BodyModel, truth: Truth) -> Track:
    """A perfect track but for its last frame, with a second hypothesis in some frames."""
    pose = truth.pose[:, [truth.dof_names.index(name) for name in model.dof_names]]
    pose[-1, 1] += 0.8
    other = np.where(np.arange(FRAMES)[:, None] % 2 == 0, pose + 0.4, np.nan)
    weight = np.where(np.isnan(other[:, :1]), [1.0, np.nan], [0.7, 0.3])
    return make_track(
        model,
        pose,
        hypothesis_pose=np.stack([pose, other], axis=1),
        hypothesis_weight=weight,
        status=np.array(["tracked", "ambiguous", "tracked", "lost"]),
    )


@pytest.fixture(scope="module")
def view(track: Track, source: Source) -> Viewport:
    """The body, 300 pixels high."""
    return view_around(track, source.intrinsics, 600, 600)


def painted(source: Source, view: Viewport, model: BodyModel, track: Track, f: int) -> Array:
    """The picture (H, W, 3) of a frame."""
    image = shade_depth(source.view(f).metres(), source.intrinsics)
    return np.asarray(paint(image, view, model, track, f), dtype=np.float64)


def joint_pixel(view: Viewport, track: Track, f: int, name: str) -> Array:
    """Column and row (2,) of a joint in the picture, which is drawn at twice the size and averaged."""
    pixel = project(track.joint_positions[f, track.joint_names.index(name)], view.intrinsics)
    return np.asarray(pixel) / 2.0


def pixels(file: Path) -> Array:
    """A picture's colours (H, W, 3)."""
    with Image.open(file) as image:
        return np.asarray(image.convert("RGB"), dtype=np.float64)


def test_a_run_gets_its_three_pictures_and_none_is_blank(
    source: Source, model: BodyModel, track: Track, truth: Truth, tmp_path: Path
) -> None:
    """All exist, with a useful size, contrast, and a small file."""
    files = draw_run(source, TrackedBody(model, {}), track, tmp_path, truth)
    assert [f.name for f in files] == ["overlay.mp4", "sheet.png", "hypotheses.png"]
    assert set(files) == set(tmp_path.iterdir())
    for file in files[1:]:
        colours = pixels(file)
        assert min(colours.shape[:2]) >= 250
        assert colours.std() > 15.0
        assert file.stat().st_size < 5_000_000


def test_a_small_image_and_one_frame_are_enough(model: BodyModel, tmp_path: Path, track: Track) -> None:
    """A run of a single frame of a coarse camera has all its pictures."""
    coarse = Intrinsics(40, 40, 60.0, 60.0, 19.5, 19.5)
    depth = np.full((40, 40), 3000, dtype=np.uint16)

    source = Source("one", coarse, range(1), lambda _: depth, 1000.0)
    arrays: dict[str, Any] = {f.name: getattr(track, f.name) for f in fields(Track)}
    arrays = {name: array[:1] for name, array in arrays.items() if isinstance(array, np.ndarray)}
    one = replace(track, **arrays)
    files = draw_run(source, TrackedBody(model, {}), one, tmp_path)
    assert all(file.suffix == ".mp4" or pixels(file).std() > 5.0 for file in files)


def test_a_film_plays_in_real_time(tmp_path: Path) -> None:
    """Every picture is there at its own time, gaps too, of its own size."""
    times, greys = np.array([5.0, 5.033, 5.1, 5.4]), (20, 90, 160, 230)
    pictures = [Image.new("RGB", (64, 48), (grey, grey, grey)) for grey in greys]
    write_film(iter(pictures), (64, 48), times, tmp_path / "overlay.mp4")
    with av.open(str(tmp_path / "overlay.mp4")) as film:
        stream = film.streams.video[0]
        assert (stream.width, stream.height, stream.codec_context.name) == (64, 48, "h264")
        shown = [(frame.time, frame.to_ndarray(format="rgb24").mean()) for frame in film.decode(video=0)]
    assert np.allclose([time for time, _ in shown], times - 5.0, atol=1e-3)
    assert np.allclose([grey for _, grey in shown], greys, atol=6.0)


def test_the_body_is_drawn_where_the_tracker_says_it_is(
    source: Source, view: Viewport, model: BodyModel, track: Track
) -> None:
    """Where the arm is reported 46 degrees off, the picture differs around that arm and nowhere else."""
    right, wrong = (painted(source, view, model, track, f) for f in (FRAMES - 3, FRAMES - 1))
    rows, columns = np.nonzero(np.abs(right - wrong)[30:].sum(axis=-1) > 60.0)
    low, high = np.array([columns.min(), rows.min() + 30]), np.array([columns.max(), rows.max() + 30])
    for name in ("right_elbow", "right_wrist"):
        place = joint_pixel(view, track, FRAMES - 1, name)
        assert np.all((place > low - 1) & (place < high + 1))
    assert high[0] < joint_pixel(view, track, 0, "head")[0]


def test_the_surface_covers_what_opengl_says(view: Viewport, model: BodyModel, track: Track) -> None:
    """Drawn opaque, it covers the pixels of an independent renderer, and a thin line around them."""
    camera = view.intrinsics
    base = Image.new("RGB", (camera.width, camera.height), (0, 0, 255))
    drawn = np.asarray(draw_body(base, model, track.pose[0], camera, 1.0))[..., 2] < 255
    with DepthRenderer(camera) as renderer:
        seen = renderer.depth(pose_vertices(model, track.pose[:1])[0], model.triangles) > 0.0
    assert seen.sum() > 10_000
    assert drawn[seen].mean() > 0.99
    assert np.sum(drawn & ~binary_dilation(seen, iterations=3)) < 0.001 * seen.sum()


def test_the_picture_of_a_frame_has_the_model_the_skeleton_and_the_status(
    source: Source, view: Viewport, model: BodyModel, track: Track
) -> None:
    """The body has a warm colour, white lines join the joints, the status has its colour in the corner."""
    picture = painted(source, view, model, track, 3)
    assert picture.shape == (view.height // 2, view.width // 2, 3)
    assert max(picture.shape) == 300
    assert np.sum(picture[..., 0] - picture[..., 2] > 30.0) > 300
    column, row = np.rint(joint_pixel(view, track, 3, "left_knee")).astype(int)
    assert picture[row, column].min() > 230.0
    corner = picture[:30, picture.shape[1] // 2 :]
    assert np.sum(np.abs(corner - ImageColor.getrgb(STATUS["lost"])).sum(axis=-1) < 40.0) > 10


def test_a_flagged_joint_is_hollow(source: Source, view: Viewport, model: BodyModel, track: Track) -> None:
    """White in the middle of a joint that is not flagged, but not of a flagged one."""
    chance = np.zeros((FRAMES, len(model.joint_names)))
    chance[:, model.joint_names.index("left_wrist")] = 1.0
    alone = replace(track, hypothesis_weight=np.full((FRAMES, 2), np.nan))
    column, row = np.rint(joint_pixel(view, track, 0, "left_wrist")).astype(int)
    sure, doubted = (
        painted(source, view, model, replace(alone, joint_off_probability=chances), 0)
        for chances in (0.0 * chance, chance)
    )
    near = (slice(row - 4, row + 5), slice(column - 4, column + 5))
    assert np.sum(sure[near].min(axis=-1) > 230.0) != np.sum(doubted[near].min(axis=-1) > 230.0)


def test_a_hypothesis_is_the_fainter_the_less_its_weight(
    source: Source, view: Viewport, model: BodyModel, track: Track
) -> None:
    """The second of two hypotheses changes the picture, less if its weight is small."""
    alone, faint, strong = (
        painted(source, view, model, replace(track, hypothesis_weight=np.tile(weights, (FRAMES, 1))), 0)
        for weights in ([1.0, np.nan], [1.0, 0.01], [1.0, 1.0])
    )
    assert 0.0 < np.abs(faint - alone).sum() < 0.4 * np.abs(strong - alone).sum()


def test_what_a_lost_run_may_contain_can_be_drawn(source: Source, track: Track) -> None:
    """A frame without depth, no joint that is known, and poses at and behind the camera."""
    view = view_around(
        replace(track, joint_positions=track.joint_positions * np.nan), source.intrinsics, 200, 200
    )
    assert (view.left, view.top, view.width, view.height) == (0, 0, 200, 200)
    empty = shade_depth(np.zeros((512, 512), dtype=np.float32), source.intrinsics)
    whole = SCENES["arm"]()
    for depth in (-1.0, 0.05):
        pose = whole.poses[:FRAMES].copy()
        pose[:, 2] = depth
        away = replace(track, dof_names=whole.model.dof_names, pose=pose, hypothesis_pose=pose[:, None])
        away = replace(away, hypothesis_weight=np.ones((FRAMES, 1)))
        assert paint(empty, view, whole.model, away, 3).size == (100, 100)


def test_a_view_shows_a_point_where_its_camera_says(view: Viewport, track: Track, source: Source) -> None:
    """The picture's camera and the window of the image agree, whatever the image's resolution."""
    points = track.joint_positions[0]
    in_window = project(points, source.intrinsics) - (view.left, view.top)
    assert np.allclose(project(points, view.intrinsics), (in_window + 0.5) * view.scale - 0.5)
    assert np.all((in_window > 0) & (in_window * view.scale < (view.width, view.height)))
    window = Viewport(Intrinsics(64, 48, 50.0, 50.0, 31.5, 23.5), 22, 8, 4.0, 80, 80)
    for scale in (1, 2):
        picture = Image.new("RGB", (64 * scale, 48 * scale), (0, 200, 0))
        picture.paste((200, 0, 0), (0, 0, 32 * scale, 48 * scale))
        shown = np.asarray(window.cut(picture))
        assert shown.shape == (80, 80, 3)
        assert shown[40, [5, 35, 45, 75], 0].tolist() == [200, 200, 0, 0]


def test_a_lost_body_does_not_widen_the_view(view: Viewport, track: Track, source: Source) -> None:
    """Joints of a lost frame do not change the view; if all frames are lost, they do."""
    away = track.joint_positions.copy()
    away[3] += (0.5, 0.0, -1.0)
    once = replace(track, joint_positions=away)
    always = replace(once, status=np.array(["lost"] * FRAMES))
    assert view_around(once, source.intrinsics, 600, 600) == view
    assert view_around(always, source.intrinsics, 600, 600).scale < view.scale


@given(st.integers(1, 500), st.integers(1, 100))
def test_spread_takes_the_first_and_the_last_and_no_frame_twice(count: int, wanted: int) -> None:
    """At most as many as wanted, in order, with gaps that differ by at most one."""
    chosen = spread(count, wanted)
    assert len(chosen) == min(count, wanted)
    assert chosen[0] == 0
    assert wanted == 1 or chosen[-1] == count - 1
    assert np.all(np.diff(chosen) >= 1)
    assert len(chosen) < 3 or np.ptp(np.diff(chosen)) <= 1


def test_a_sheet_holds_every_picture_once() -> None:
    """Seven pictures in three rows: each colour covers its picture's area."""
    colours = [(30 * k + 20, 255 - 30 * k, 7) for k in range(7)]
    sheet = np.asarray(tile([Image.new("RGB", (20, 10), c) for c in colours]))
    for colour in colours:
        assert np.sum(np.all(sheet == colour, axis=-1)) == 200


def test_the_angles_that_vary_most_are_shown_and_the_whole_bodys_turn_is_not(tmp_path: Path) -> None:
    """A person's angles by their plain names; the pelvis may turn as it will."""
    model, names = person(), angles_of(person()).names
    track = write_run(tmp_path / "run", model, swing(model, FRAMES))
    angle = np.zeros((FRAMES, len(names)))
    turning = [name for name in names if name.startswith(("pelvis", "right"))][-6:]
    for k, name in enumerate(turning):
        angle[:, names.index(name)] = np.arange(FRAMES) * 0.01 * (k + 1)
    angle[:, names.index("pelvis_turn")] = np.arange(FRAMES)
    track = replace(track, angle_names=names, angle=angle, angle_deviation=angle)
    curves = curves_of(track, TrackedBody(model, {}), None)
    assert sorted(curve.name for curve in curves) == sorted(turning)


def test_a_frame_of_another_status_is_seen_behind_the_curves(tmp_path: Path) -> None:
    """One ambiguous frame among tracked ones has its own share of the width."""
    model = person()
    track = write_run(tmp_path / "run", model, np.tile(swing(model, 1), (20, 1)))
    status = np.array(["tracked"] * 10 + ["ambiguous"] + ["tracked"] * 9)
    zeros = np.zeros((20, 1))
    track = replace(track, status=status, angle_names=("a",), angle=zeros, angle_deviation=zeros)
    plot_curves(track, angle_curves(track, ("a",))).savefig(tmp_path / "plot.png")
    row = pixels(tmp_path / "plot.png")[60]
    amber = np.all(np.abs(row - [0xFC, 0xEF, 0xD1]) < 8, axis=1).sum()
    assert amber / len(row) == pytest.approx(1 / 20, rel=0.25)
