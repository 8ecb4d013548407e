"""Cost of a particle, relative to rigid ICP on the same points: python -m benchmarks.costs.kernel.

One particle is steps 4a to 4d and 5: pose, visibility, closest points, solve, likelihood. The other programs
get its 10 000 observed points and the visible model points. The plain path is the same algorithm in numpy and
scipy. Medians of processor time on one core; the calls alternate.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

import msgspec
import numpy as np
import small_gicp

from benchmarks.costs.standing import Case, standing
from benchmarks.running import command_line, keep, processor
from gepf.common.arrays import Array
from gepf.common.refinement import Particles
from gepf.common.settings import RefineSettings
from gepf.coordinator.filters.priors import pose_prior
from gepf.coordinator.scene.noise import NO_NOISE, SensorNoise
from gepf.coordinator.settings import preset
from gepf.worker.kernel.icp import refine
from tests.support.kernel import plain_path

POINTS, ITERATIONS, ROUNDS, PLAIN_ROUNDS = 10_000, 3, 51, 3
NOISES = {"clean": NO_NOISE, "15 cm noise": SensorNoise(depth=0.15, lateral=0.01)}
OURS, YARDSTICK = "gepf particle", "small_gicp ICP"
REACH_M = 10.0  # every observed point has a correspondence, as in the paper


def main() -> int:
    """Measure, print the table, write the numbers."""
    chosen = command_line("costs.kernel", __doc__).parse_args()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # before libraries start their threads
    cases = [
        measure(standing(POINTS, noise), label, name)
        for label, noise in NOISES.items()
        for name in ("default", "paper")
    ]
    print(f"{processor()}, {POINTS} points, {ITERATIONS} iterations, medians of {ROUNDS}, ms of one core")
    for case in cases:
        off = f"{case['joint_error_before_cm']:.1f} -> {case['joint_error_after_cm']:.1f} cm"
        print(f"\n{case['data']}, preset {case['preset']}: mean joint error {off}")
        for name, ms in case["ms"].items():
            print(f"  {name:<24}{ms:8.2f} ms, {ms / case['ms'][YARDSTICK]:.2f} of {YARDSTICK}")
    keep(cases, chosen.out)
    return 0


def measure(case: Case, data: str, preset_name: str) -> dict[str, Any]:
    """Median milliseconds of all calls on one case; checks that the refinement reduces the error."""
    settings = msgspec.structs.replace(preset(preset_name).refine, icp_iterations=ITERATIONS)
    particles = Particles(case.start, settings, prior=pose_prior(case.model, settings))
    observed, visible = case.observed, case.visible()

    def ours() -> Array:
        return refine(case.model, case.observation, particles).poses

    calls = {
        OURS: ours,
        YARDSTICK: small_gicp_icp(observed, visible),
        "Open3D ICP": open3d_icp(observed, visible),
    }
    times = take_turns(calls, ROUNDS) | take_turns(
        {"plain numpy and scipy": plainly(case, settings)}, PLAIN_ROUNDS
    )
    return {
        "data": data,
        "preset": preset_name,
        "joint_error_before_cm": 100 * case.joint_error(case.start),
        "joint_error_after_cm": 100 * case.joint_error(ours()),
        "ms": times,
    }


def take_turns(calls: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Median processor time (ms) of each call; the calls alternate, the first round does not count."""
    spent: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(1 + rounds):
        for name, call in calls.items():
            began = time.process_time()
            call()
            spent[name].append(1e3 * (time.process_time() - began))
    return {name: float(np.median(times[1:])) for name, times in spent.items()}


def plainly(case: Case, settings: RefineSettings) -> Callable[[], object]:
    """Refine the particle with the plain path."""
    return lambda: plain_path.refine(case.model, case.subject, case.start[0], settings)


def small_gicp_icp(observed: Array, model: Array) -> Callable[[], object]:
    """small_gicp's ICP of points (P, 3) onto (Q, 3); point clouds and the k-d tree are part of it."""

    def align() -> object:
        target = small_gicp.PointCloud(model)
        result = small_gicp.align(
            target,
            small_gicp.PointCloud(observed),
            small_gicp.KdTree(target),
            registration_type="ICP",
            max_correspondence_distance=REACH_M,
            num_threads=1,
            max_iterations=ITERATIONS,
            rotation_epsilon=0.0,
            translation_epsilon=0.0,
        )
        if result.iterations != ITERATIONS - 1:  # the last one's number, from 0
            raise RuntimeError(f"small_gicp stopped after {result.iterations + 1} of {ITERATIONS} iterations")
        return result

    return align


def open3d_icp(observed: Array, model: Array) -> Callable[[], object]:
    """Open3D's ICP on existing point clouds; it builds its k-d tree every time."""
    import open3d

    registration = open3d.pipelines.registration
    target = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(model))
    source = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(observed))
    estimation = registration.TransformationEstimationPointToPoint()
    criteria = registration.ICPConvergenceCriteria(0.0, 0.0, ITERATIONS)
    return lambda: registration.registration_icp(source, target, REACH_M, np.eye(4), estimation, criteria)


if __name__ == "__main__":
    sys.exit(main())
