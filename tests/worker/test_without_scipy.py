"""Workers do without scipy, which the base install does not bring."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from tests.support.processes.programs import CACHE, fresh_python

CODE = """
import importlib, json, pkgutil, sys
sys.modules["scipy"] = None  # so that its import fails
import numpy as np
import gepf.common, gepf.worker
for package in (gepf.common, gepf.worker):
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        importlib.import_module(module.name)
from gepf.worker.kernel.soft import turn_twists
T_camera_rig, twists = map(np.array, json.loads(INPUT))
turn_twists(T_camera_rig, twists)
print(json.dumps(twists.tolist()))
"""


def test_all_of_a_worker_is_imported_and_its_twists_are_turned_without_scipy(tmp_path: Path) -> None:
    """In a process where scipy cannot be imported, with nothing compiled yet; the twists are numpy's.

    A twist about the camera has the turned rotation w, and the turned velocity plus t x w.
    """
    random = np.random.default_rng(0)
    turn, shift = np.linalg.qr(random.normal(size=(3, 3)))[0], random.normal(size=3)
    T_camera_rig, twists = np.column_stack([turn, shift]), random.normal(size=(4, 6))
    given = json.dumps([T_camera_rig.tolist(), twists.tolist()])
    root = Path(__file__).parents[2]
    done = fresh_python(root, f"INPUT = {given!r}\n{CODE}", **{CACHE: str(tmp_path)})
    assert done.returncode == 0, done.stderr
    w, u = twists[:, :3] @ turn.T, twists[:, 3:] @ turn.T
    np.testing.assert_allclose(json.loads(done.stdout), np.hstack([w, u + np.cross(shift, w)]), atol=1e-14)
