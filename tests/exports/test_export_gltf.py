"""glTF: valid by Khronos' validator, and the skinned surface is the tracked one in every frame."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gepf.common.kinematics import pose_vertices
from gepf.coordinator.exports.axes import CAMERA_TO_Y_UP
from tests.support.bodies import person, random_body
from tests.support.export_readers import array_of, read_gltf, world_matrices
from tests.support.runs import RATE, write_and_export

MILLIMETRE = 1e-3
BODIES = {"person": person(), "random": random_body(np.random.default_rng(5))}
VALIDATOR = Path(sys.prefix) / "node_modules" / "gltf-validator"
VALIDATE = """
const validator = require(process.argv[1]);
const data = new Uint8Array(require("fs").readFileSync(process.argv[2]));
validator.validateBytes(data).then((report) => console.log(JSON.stringify(report)));
"""


@pytest.mark.skipif(
    not (shutil.which("node") and VALIDATOR.is_dir()) and "CI" not in os.environ,
    reason="node or npm's gltf-validator is not in the environment; where CI is set, that is a failure",
)
@pytest.mark.parametrize("form", ["glb", "gltf"])
@pytest.mark.parametrize("body", BODIES)
def test_khronos_validator_has_nothing_to_say(tmp_path: Path, body: str, form: str) -> None:
    """No error and no warning, for one frame and for several."""
    model = BODIES[body]
    for frames in (1, 5):
        _, file = write_and_export(tmp_path / str(frames), form, model, frames)
        done = subprocess.run(
            ["node", "-e", VALIDATE, str(VALIDATOR), str(file)], capture_output=True, text=True, check=True
        )
        issues = json.loads(done.stdout)["issues"]
        assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"][:3]


@pytest.mark.parametrize("body", BODIES)
def test_joints_and_skin_lie_where_the_track_has_them(tmp_path: Path, body: str) -> None:
    """Skinning by glTF's own rule: joints and every vertex within a tenth of a millimetre."""
    model = BODIES[body]
    track, file = write_and_export(tmp_path, "glb", model, 4)
    gltf = read_gltf(file)
    surface = pose_vertices(model, track.pose) @ CAMERA_TO_Y_UP
    parts = gltf.meshes[0].primitives[0].attributes
    corners = array_of(gltf, gltf.meshes[0].primitives[0].indices)
    assert np.array_equal(corners.ravel(), model.triangles.ravel())
    rest = np.pad(array_of(gltf, parts.POSITION), ((0, 0), (0, 1)), constant_values=1.0)
    joints, weights = array_of(gltf, parts.JOINTS_0), array_of(gltf, parts.WEIGHTS_0)
    back = array_of(gltf, gltf.skins[0].inverseBindMatrices).reshape(-1, 4, 4).swapaxes(1, 2)
    for f in range(4):
        world = world_matrices(gltf, f)
        read = np.array([world[name][:3, 3] for name in model.joint_names])
        assert np.abs(read - track.joint_positions[f] @ CAMERA_TO_Y_UP).max() < 0.1 * MILLIMETRE
        bones = np.array([world[gltf.nodes[n].name] for n in gltf.skins[0].joints]) @ back
        posed = np.einsum("vk,vkij,vj->vi", weights, bones[joints], rest)[:, :3]
        assert np.abs(posed - surface[f]).max() < 0.1 * MILLIMETRE


def test_times_status_and_frames_are_written(tmp_path: Path) -> None:
    """Seconds from zero at the run's rate; lost frames are listed in `extras`."""
    gltf = read_gltf(write_and_export(tmp_path, "glb", person(), 4, lost=(1,))[1])
    animation = gltf.animations[0]
    times = array_of(gltf, animation.samplers[0].input).ravel()
    np.testing.assert_allclose(times, np.arange(4) / RATE, atol=1e-6)
    assert animation.extras == {
        "frame": [100, 101, 102, 103],
        "status": ["tracked", "lost", *["tracked"] * 2],
    }
