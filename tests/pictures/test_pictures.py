"""Pictures of a run: they exist, show what they should where they should, and never stop a run."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image, ImageColor

from common.activation import activate
from common.body import BodyModel
from common.camera import Intrinsics, project
from common.frame import DepthFrame
from common.kinematics import joint_positions
from coordinator.bodies.angles import angles_of
from coordinator.pictures.film import encode_gif, spread, tile
from coordinator.pictures.hypotheses import curves_of
from coordinator.pictures.overlay import MODEL_COLOUR, Painter, around
from coordinator.pictures.plots import STATUS, draw_status, new_figure, styled
from coordinator.pictures.run import draw_run, shown_at
from coordinator.pictures.shading import contours, lambert, shade_depth
from coordinator.results.evaluation import Truth, read_truth
from coordinator.results.track import Track, TrackedBody
from coordinator.sources import Source, open_source
from coordinator.synthesis.scenes import ARM_DOFS, SCENES
from coordinator.synthesis.sequence import synthesise
from tests.support.bodies import person
from tests.support.runs import swing, write_run

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
    return Track(
        frame=np.arange(FRAMES),
        time_s=np.arange(FRAMES) / 25.0,
        dof_names=model.dof_names,
        pose=pose,
        joint_names=model.joint_names,
        joint_positions=joint_positions(model, pose),
        hypothesis_pose=np.stack([pose, other], axis=1),
        hypothesis_weight=weight,
        status=np.array(["tracked", "ambiguous", "tracked", "lost"]),
    )


def pixels(file: Path) -> NDArray[np.float64]:
    """A picture's colours (H, W, 3)."""
    with Image.open(file) as image:
        return np.asarray(image.convert("RGB"), dtype=np.float64)


def test_a_run_gets_its_five_pictures_and_none_is_blank(
    source: Source, model: BodyModel, track: Track, truth: Truth, tmp_path: Path
) -> None:
    """All are there, of a size to be looked at, with light and dark, and small enough to be sent."""
    files = draw_run(source, TrackedBody(model, {}), track, tmp_path, truth)
    assert {f.name for f in files} == {
        "overlay.gif",
        "overlay.mp4",
        "sheet.png",
        "hypotheses.png",
        "errors.png",
    }
    assert set(files) == set(tmp_path.iterdir())
    for file in (file for file in files if file.suffix != ".mp4"):
        colours = pixels(file)
        assert min(colours.shape[:2]) >= 250
        assert colours.std() > 15.0
        assert file.stat().st_size < 5_000_000
    with Image.open(tmp_path / "overlay.gif") as animation:
        assert getattr(animation, "n_frames") == FRAMES  # noqa: B009 only some formats have it
        assert animation.info["duration"] == 40


def test_without_truth_there_is_no_picture_of_errors(
    source: Source, model: BodyModel, track: Track, tmp_path: Path
) -> None:
    """Four pictures remain."""
    assert len(draw_run(source, TrackedBody(model, {}), track, tmp_path)) == 4
    assert not (tmp_path / "errors.png").exists()


def test_truth_of_something_else_is_reported_and_the_other_pictures_are_drawn(
    source: Source,
    model: BodyModel,
    track: Track,
    truth: Truth,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A run that is done does not fail because its truth cannot be compared."""
    elsewhere = replace(truth, frame=truth.frame + 1000)
    assert len(draw_run(source, TrackedBody(model, {}), track, tmp_path, elsewhere)) == 4
    assert "no picture of the errors" in caplog.text


def test_without_opengl_the_body_is_dots_and_one_line_says_so(
    source: Source,
    model: BodyModel,
    track: Track,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Pictures degrade, the run goes on, and the warning names the packages once."""
    monkeypatch.setenv("EGL_DEVICE_ID", "99")
    files = draw_run(source, TrackedBody(model, {}), track, tmp_path)
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "libegl1" in caplog.text
    assert pixels(files[1]).std() > 15.0


@pytest.mark.parametrize("opengl", [True, False])
def test_the_body_is_drawn_where_the_tracker_says_it_is(
    opengl: bool, source: Source, model: BodyModel, track: Track
) -> None:
    """Where the arm is reported 46 degrees off, the picture differs around that arm and nowhere else."""
    view = around(track, source.intrinsics, 300, 300)
    painter = Painter(model, view, opengl=opengl)
    right, wrong = (painter.paint(source.frame(f), shown_at(track, f)) for f in (FRAMES - 3, FRAMES - 1))
    painter.close()
    moved = np.abs(np.asarray(right, dtype=float) - np.asarray(wrong, dtype=float)).sum(axis=-1) > 60.0
    arm = project(joint_positions(model, track.pose[-1:])[0], view.intrinsics)[
        [model.joint_names.index("right_elbow"), model.joint_names.index("right_wrist")]
    ]
    rows, columns = np.nonzero(moved[30:])
    low, high = np.array([columns.min(), rows.min() + 30]), np.array([columns.max(), rows.max() + 30])
    assert np.all((arm > low - 1) & (arm < high + 1))
    head = project(track.joint_positions[0], view.intrinsics)[model.joint_names.index("head")]
    assert high[0] < head[0]


def test_the_picture_of_a_frame_has_the_model_the_skeleton_and_the_status(
    source: Source, model: BodyModel, track: Track
) -> None:
    """Orange surrounds the body, white joins its joints, and the status has its colour in the corner."""
    view = around(track, source.intrinsics, 300, 300)
    painter = Painter(model, view)
    picture = np.asarray(painter.paint(source.frame(3), shown_at(track, 3)), dtype=float)
    painter.close()
    assert picture.shape == (view.height, view.width, 3)
    assert max(view.width, view.height) == 300
    near = np.abs(picture - MODEL_COLOUR).sum(axis=-1) < 60.0
    assert np.sum(near) > 300
    knee = project(track.joint_positions[3], view.intrinsics)[model.joint_names.index("left_knee")]
    column, row = np.rint(knee).astype(int)
    assert picture[row, column].min() > 230.0
    corner = picture[:30, view.width // 2 :]
    assert np.sum(np.abs(corner - ImageColor.getrgb(STATUS["lost"])).sum(axis=-1) < 40.0) > 10


def test_a_flagged_joint_is_hollow_and_its_lines_are_dashed(
    source: Source, model: BodyModel, track: Track
) -> None:
    """White in the middle of a joint that is sure, not of one that is not; less of the line is white."""
    view = around(track, source.intrinsics, 600, 600)
    painter, shown = Painter(model, view), replace(shown_at(track, 0), weights=np.full(2, np.nan))
    knee = model.joint_names.index("left_knee")
    flagged = np.arange(len(model.joint_names)) == knee
    sure, doubted = (
        np.asarray(painter.paint(source.frame(0), replace(shown, flagged=flags)), dtype=float)
        for flags in (~flagged & False, flagged)
    )
    painter.close()
    column, row = np.rint(project(track.joint_positions[0], view.intrinsics)[knee]).astype(int)
    assert sure[row, column].min() > 230.0
    assert doubted[row, column].min() < 200.0
    assert np.any(sure != doubted)


def test_a_hypothesis_is_the_fainter_the_less_its_weight(
    source: Source, model: BodyModel, track: Track
) -> None:
    """The other one of two changes the picture, and less so where it hardly counts."""
    painter = Painter(model, around(track, source.intrinsics, 300, 300))
    alone, faint, strong = (
        np.asarray(
            painter.paint(source.frame(0), replace(shown_at(track, 0), weights=np.array(weights))), float
        )
        for weights in ([1.0, np.nan], [1.0, 0.0], [1.0, 1.0])
    )
    painter.close()
    assert 0.0 < np.abs(faint - alone).sum() < 0.4 * np.abs(strong - alone).sum()


def test_a_frame_without_depth_and_a_pose_behind_the_camera_can_be_drawn(
    source: Source, track: Track
) -> None:
    """What a lost run may contain does not stop its pictures."""
    empty = replace(source.frame(0), depth=np.zeros_like(source.frame(0).depth))
    view = around(replace(track, joint_positions=track.joint_positions * np.nan), source.intrinsics, 200, 200)
    assert (view.left, view.top, view.columns, view.rows) == (0, 0, 512, 512)
    scene = SCENES["arm"]()
    for depth in (-1.0, 0.05):
        painter = Painter(scene.model, view)
        pose = scene.poses[0].copy()
        pose[2] = depth
        shown = replace(shown_at(track, 3), pose=pose, hypotheses=pose[None], weights=np.ones(1))
        assert painter.paint(empty, shown).size == (200, 200)
        painter.close()


def test_a_view_shows_a_point_where_its_camera_says(track: Track, source: Source) -> None:
    """The picture's camera and the crop and scale of the image agree."""
    view = around(track, source.intrinsics, 300, 200)
    points = track.joint_positions[0]
    in_window = project(points, source.intrinsics) - (view.left, view.top)
    assert np.allclose(project(points, view.intrinsics), (in_window + 0.5) * view.scale - 0.5)
    assert np.all((in_window > 0) & (in_window < (view.columns, view.rows)))
    assert view.crop(source.frame(0).metres()).shape == (view.rows, view.columns)


def test_a_lost_body_does_not_widen_the_view(track: Track, source: Source) -> None:
    """Joints of the lost frame far outside leave the view as it was; if all are lost, they count."""
    away = track.joint_positions.copy()
    away[3] += (0.5, 0.0, -1.0)
    once = replace(track, joint_positions=away)
    always = replace(once, status=np.array(["lost"] * FRAMES))
    view = around(track, source.intrinsics, 300, 300)
    assert around(once, source.intrinsics, 300, 300) == view
    assert around(always, source.intrinsics, 300, 300).columns > view.columns


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
    """Seven pictures in rows of three: each colour covers its picture's area."""
    colours = [(30 * k + 20, 255 - 30 * k, 7) for k in range(7)]
    sheet = np.asarray(tile([Image.new("RGB", (20, 10), c) for c in colours], 3))
    for colour in colours:
        assert np.sum(np.all(sheet == colour, axis=-1)) == 200


def test_an_animation_is_shrunk_until_it_is_small_enough() -> None:
    """Noise, which does not compress, comes out below the limit, all frames there."""
    rng = np.random.default_rng(0)
    pictures = [Image.fromarray(rng.integers(0, 255, (200, 160, 3), dtype=np.uint8)) for _ in range(5)]
    data = encode_gif(pictures, 0.1, largest=60_000)
    assert len(data) <= 60_000
    with Image.open(io.BytesIO(data)) as animation:
        assert getattr(animation, "n_frames") == 5  # noqa: B009 only some formats have it
        assert animation.width < 160


def test_a_surface_is_brightest_where_it_faces_the_light() -> None:
    """A sphere is brighter towards the upper left than towards the lower right, and dark outside."""
    camera = Intrinsics(101, 101, 200.0, 200.0, 50.0, 50.0)
    v, u = np.indices((101, 101)) - 50.0
    inside = np.hypot(u, v) < 40
    bulge = np.sqrt(np.maximum(1600.0 - u**2 - v**2, 0.0)) / 200.0
    light = lambert(np.where(inside, 1.0 - bulge, 0.0).astype(np.float32), camera)
    assert light[35, 40] > 0.95 > light[50, 50] > light[65, 70] > 0.0
    assert not light[~inside].any()
    assert not shade_depth(np.zeros((20, 20), dtype=np.float32), camera).any()


def test_contours_run_around_a_surface_and_along_its_steps() -> None:
    """A plate in front of a wall has a line around it, the wall one around itself, and slopes none."""
    depth = np.zeros((30, 40), dtype=np.float32)
    depth[5:25, 5:35] = 2.0 + 0.01 * np.arange(30, dtype=np.float32)
    depth[10:20, 10:20] = 1.5
    edge = contours(depth, 0.06)
    assert edge[10, 10:20].all()
    assert edge[5, 5:35].all()
    for plain in (edge[12:18, 12:18], edge[7:9, 7:33], edge[depth == 0.0]):
        assert not plain.any()


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


def test_a_frame_of_another_status_is_seen_in_the_strip(tmp_path: Path) -> None:
    """One ambiguous frame among tracked ones has its own share of the strip, and so has every other."""
    status = np.array(["tracked"] * 10 + ["ambiguous"] + ["tracked"] * 9)
    with styled():
        figure = new_figure(4.0, 3.0)
        axes = figure.subplots()
        draw_status(axes, np.arange(20) / 25.0, status)
        axes.set_axis_off()
        figure.savefig(tmp_path / "strip.png")
    row = pixels(tmp_path / "strip.png")[60]  # above the names
    amber = np.all(np.abs(row - [0xF5, 0xBE, 0x46]) < 8, axis=1).sum()
    green = np.all(np.abs(row - [0x5C, 0xC8, 0x78]) < 8, axis=1).sum()
    assert green > 0
    assert amber / green == pytest.approx(1 / 19, rel=0.25)


def test_a_small_image_and_one_frame_are_enough(model: BodyModel, tmp_path: Path, track: Track) -> None:
    """A run of a single frame of a coarse camera has all its pictures."""
    scene = SCENES["arm"]()
    coarse = Intrinsics(40, 40, 60.0, 60.0, 19.5, 19.5)
    frame = DepthFrame(0, 0.0, np.full((40, 40), 3000, dtype=np.uint16), 1000.0, coarse)

    class OneFrame:
        name, intrinsics, fps, numbers, truth, init = "one", coarse, 30.0, range(1), None, None

        def frame(self, number: int) -> DepthFrame:
            """The one."""
            assert number == 0
            return frame

    one = replace(
        track,
        **{name: getattr(track, name)[:1] for name in ("frame", "time_s", "pose", "joint_positions")},
        **{name: getattr(track, name)[:1] for name in ("hypothesis_pose", "hypothesis_weight", "status")},
    )
    assert scene.model.joint_names == model.joint_names
    files = draw_run(OneFrame(), TrackedBody(model, {}), one, tmp_path)  # type: ignore[arg-type]
    assert len(files) >= 3
    for file in files:
        assert file.suffix == ".mp4" or pixels(file).std() > 5.0
