"""A worker computes every request that decoders accept, in bounded time; a coordinator accepts the reply."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.bounds import LARGEST, LARGEST_LOG_LIKELIHOOD, MOST_PIXELS
from gepf.common.errors import ProtocolError
from gepf.common.protocol.messages import decode_refined, encode_refined
from gepf.common.refinement import Particles, Refined, triangle_size
from gepf.common.settings import RefineSettings
from gepf.coordinator.filters.gradient_enhanced import begin
from gepf.coordinator.settings import preset
from gepf.worker.kernel.icp import check_work, refine
from gepf.worker.kernel.observation import observe, pack_views
from gepf.worker.kernel.surface import pack_model
from gepf.worker.kernel.visibility import DepthImage, rasterise
from gepf.worker.kernel.workspace import LARGEST_SIDE_PX, make_workspaces
from gepf.worker.warm_up import tiny_frame, tiny_model
from tests.support.extremes import Extremes
from tests.support.filtering import advance
from tests.support.processes.serving import MODEL, POSES


@pytest.mark.parametrize(
    "settings",
    [
        RefineSettings(noise_lateral=1e6),  # Eq. 4 is singular in all other directions
        *(RefineSettings(sensor="camera", noise_depth=error) for error in (1e4, 1e6)),
        *(RefineSettings(noise_depth=0.01 / ratio) for ratio in (1e4, 1e6)),  # all else is rounded away
    ],
)
def test_noise_without_measure_gives_numbers(settings: RefineSettings) -> None:
    """Along or across: particles on the body and beside it have a finite likelihood and a residual."""
    for beside in (0.0, 0.5, 1.5):
        poses = POSES[:3] + beside * np.eye(POSES.shape[1])[0]
        refined = refine(MODEL, observe(tiny_frame()), Particles(poses, settings))
        decode_refined(encode_refined(refined), poses.shape)
        assert np.all(np.isfinite(refined.log_likelihood))
        assert np.all(refined.residual >= 0.0)


def test_work_without_end_is_refused() -> None:
    """Each number of a request is within its bounds, but together they would take days."""
    check_work(RefineSettings(icp_iterations=6), 1000, 10_000, 7_000)
    many = RefineSettings(icp_iterations=100)
    with pytest.raises(ProtocolError, match="steps of work, more than 1e"):
        check_work(many, 1000, 10_000, 7_000)
    with pytest.raises(ProtocolError, match="steps of work"):
        refine(MODEL, observe(tiny_frame()), Particles(np.tile(POSES, (200, 1)), many))


def test_drawing_ends() -> None:
    """For any number of triangles, the number of drawn pixels is limited."""
    side = LARGEST_SIDE_PX
    corners = np.array([[0.0, 0.0], [0.0, 2.0 * side], [2.0 * side, 0.0]])  # the last of them is nearest
    full = MOST_PIXELS // side**2
    skeleton, surface = pack_model(MODEL)
    surface = surface._replace(vertices=np.zeros((3 * (full + 1), 3)))
    views = pack_views(observe(tiny_frame()), RefineSettings())
    workspace = make_workspaces(skeleton, surface, views).shared
    workspace.image[:] = np.tile(corners, (full + 1, 1))
    workspace.posed[:, 2] = np.repeat(np.linspace(3.0, 2.0, full + 1), 3)
    seen = DepthImage(
        np.empty((side + 3, side + 3), np.float32), np.empty((side + 3, side + 3), np.uint32), 0, 0, 1.0
    )
    triangles = np.arange(3 * (full + 1), dtype=np.uint32).reshape(-1, 3)
    rasterise(triangles, False, workspace, seen)
    assert np.all(workspace.front)
    np.testing.assert_allclose(seen.depth.min(), workspace.posed[3 * full - 1, 2])


def test_what_is_laid_out_goes_with_its_model() -> None:
    """A worker keeps nothing of a model that it has forgotten."""
    model = replace(MODEL, name="short-lived")
    assert pack_model(model) is pack_model(model)
    surface = weakref.ref(pack_model(model)[1].vertices)
    assert surface() is not None
    del model
    gc.collect()
    assert surface() is None


def test_settings_of_extremes_are_all_settings() -> None:
    """A setting that is added is made extreme, too."""
    settings = [msgspec.structs.asdict(case.request.particles.settings) for case in Extremes(1).accepted(60)]
    assert all(len({each[name] for each in settings}) > 1 for name in settings[0])


@pytest.mark.parametrize("name", ["paper", "default"])
def test_a_filter_survives_any_answer(name: str) -> None:
    """Invented replies do not end a coordinator: the filter's state stays finite."""
    settings, rng, liar = preset(name).filter, np.random.default_rng(0), np.random.default_rng(1)
    model = tiny_model()

    def make_up(poses: Array) -> Refined:
        made_up = liar.choice([0.0, 1e-300, 1.0, -1.0, LARGEST, -LARGEST], size=poses.shape)
        log_likelihood = liar.choice(
            [-np.inf, 0.0, -LARGEST_LOG_LIKELIHOOD, LARGEST_LOG_LIKELIHOOD], len(poses)
        )
        roots = liar.choice([1e-38, 1e-3, 0.2, -0.2], (len(poses), triangle_size(poses.shape[1])))
        diagonal = [triangle_size(n) - 1 for n in range(1, 1 + poses.shape[1])]
        roots[:, diagonal] = liar.choice([1e-38, 0.3], poses.shape)
        answer = Refined(
            made_up,
            log_likelihood,
            liar.choice([0.0, 1e300, np.inf], len(poses)),
            roots.astype(np.float32) if name == "default" else None,
        )
        return decode_refined(encode_refined(answer), poses.shape, covariance=name == "default")[0]

    belief = begin(model, POSES[0], settings)
    for _ in range(30):
        belief = advance("gepf", model, belief, make_up, settings, rng)
        assert np.all(np.isfinite(belief.reported))
        assert np.all(np.isfinite(belief.covariances))
