"""The kernel stays within its arrays for any frame and pose: compiled code checks no index."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gepf.common.frame import EMPTY, SUBJECT, UNMEASURED, SubjectFrame, SubjectView, View
from gepf.common.refinement import Particles, PosePrior
from gepf.common.settings import RefineSettings
from gepf.coordinator.settings import preset
from gepf.worker.kernel.gauss_newton import fill_covariance_root
from gepf.worker.kernel.icp import pack_batch, refine, refine_particle
from gepf.worker.kernel.observation import observe
from gepf.worker.kernel.workspace import Workspaces, make_workspaces
from tests.support.bodies import puppet
from tests.support.kernel import plain_path
from tests.support.kernel.kernel_cases import CAMERA, TRUTH, near
from tests.support.people import alone

ROOT = Path(__file__).parents[2]
GUARD = 64  # entries on each side of an array
SETTINGS = {
    "default": preset("default").refine,
    "paper": preset("paper").refine,
    "soft": RefineSettings(noise_depth=0.15, noise_lateral=0.01),
}
FRAMES = {  # left, top, width and height of the crop
    "odd sizes": (57, 31, 83, 97),
    "at the top left corner": (0, 0, 99, 81),
    "at the bottom right corner": (101, 79, 99, 81),
    "one column": (99, 20, 1, 120),
    "one row": (20, 80, 150, 1),
    "one pixel": (99, 80, 1, 1),
}
FAR_OFF = {  # what is added to the pose before refinement
    "near": {},
    "partly behind the camera": {2: -1.9},
    "at the camera": {2: -2.0},
    "behind the camera": {2: -4.0},
    "beside the image": {0: 3.0},
    "far away": {2: 9e4},
    "as far as a pose may be": {0: -9.9e4, 1: 9.9e4, 2: 9.9e4},
    "turned": {3: 3.0, 12: -2.5},
}


def cropped(name: str, *, kinds: bool) -> SubjectFrame:
    """The puppet in a part of the camera's image, of which every second pixel is picked."""
    left, top, width, height = FRAMES[name]
    (whole,) = plain_path.render(puppet(), TRUTH, CAMERA).views
    depth = whole.depth[top : top + height, left : left + width].copy()
    if not depth.any():
        depth[:] = 2000
    image = View(0, 0.0, depth, 1000.0, CAMERA.crop(left, top, width, height))
    marks = np.where(depth > 0, SUBJECT, EMPTY).astype(np.uint8)
    marks[::3][depth[::3] == 0] = UNMEASURED
    picked = np.flatnonzero(depth)[::2].astype(np.uint32)
    extent = (-left, -top, CAMERA.width - left, CAMERA.height - top)
    return alone(SubjectView(image, picked, extent, marks if kinds else None))


def guarded(array: NDArray[Any], guards: list[NDArray[np.uint8]]) -> NDArray[Any]:
    """An array of the same shape between two regions that are appended to the guards."""
    margin = GUARD * array.itemsize
    whole = np.full(array.nbytes + 2 * margin, 0xA5, dtype=np.uint8)
    guards += [whole[:margin], whole[len(whole) - margin :]]
    inner = whole[margin : len(whole) - margin].view(array.dtype).reshape(array.shape)
    inner[:] = array
    return inner


def guarded_workspaces(workspaces: Workspaces, guards: list[NDArray[np.uint8]]) -> Workspaces:
    """The same workspaces with a guard on both sides of each of their arrays."""

    def each(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return guarded(value, guards)
        return type(value)(*map(each, value))

    made: Workspaces = each(workspaces)
    return made


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("name", SETTINGS)
def test_nothing_is_written_beside_an_array(name: str, frame: str) -> None:
    """For any crop and pose: guards around all written arrays are unchanged."""
    settings, model = SETTINGS[name], puppet()
    observation = observe(cropped(frame, kinds=name != "paper"))
    dofs = len(model.dof_names)
    prior = PosePrior(np.zeros(dofs), np.eye(dofs))
    problem = pack_batch(model, observation, Particles(near()[None], settings, prior=prior)).problem
    guards: list[NDArray[np.uint8]] = []
    workspaces = guarded_workspaces(make_workspaces(*problem[:3]), guards)
    pose = guarded(np.zeros(dofs), guards)
    root = guarded(np.zeros(dofs * (dofs + 1) // 2, np.float32), guards)
    for moved in FAR_OFF.values():
        pose[:] = near()
        for dof, by in moved.items():
            pose[dof] += by
        refine_particle(pose, prior.mean, problem, workspaces)
        fill_covariance_root(problem, workspaces.shared.equations, root)
        assert all(np.all(guard == 0xA5) for guard in guards)


def test_a_pose_that_is_no_number_is_rejected_before_anything_is_searched() -> None:
    """No index is computed of it; the particles beside it are refined as without it."""
    observation, settings = observe(cropped("odd sizes", kinds=True)), SETTINGS["default"]
    poses = np.stack([near(), np.full(len(TRUTH), np.nan), np.full(len(TRUTH), np.inf), near()])
    found = refine(puppet(), observation, Particles(poses, settings))
    assert np.isfinite(found.log_likelihood).tolist() == [True, False, False, True]
    assert found.poses[0].tobytes() == found.poses[3].tobytes()


def test_pixels_outside_of_a_frame_are_refused() -> None:
    """As when the pixels of one frame are picked in another, smaller one."""
    subject = cropped("odd sizes", kinds=False)
    view = subject.largest
    smaller = replace(view, image=replace(view.image, depth=view.image.depth[:40]))
    with pytest.raises(ValueError, match="outside of the depth image"):
        observe(alone(smaller))


@pytest.mark.slow
def test_every_index_is_within_its_array(tmp_path: Path) -> None:
    """The same under numba's own check of every index, for which all kernels are compiled anew."""
    environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__]
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=1800.0, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:]
