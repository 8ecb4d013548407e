"""What a particle costs, as a multiple of a rigid ICP on the same points: python -m benchmarks.costs.kernel.

One particle is all of steps 4a-4d and 5: pose, visibility, closest points, solve, likelihood. Its 10 000
observed points and the visible model points are also what the peers get; the plain path is the same
algorithm in numpy and scipy. Processor time on one core, so that what else the machine does counts little;
calls in turns; medians. Then each stage by itself, and how it grows with points, degrees of freedom, model
vertices and noise.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import msgspec
import numpy as np

from benchmarks.command_line import RESULTS
from benchmarks.costs.peers import open3d_icp, small_gicp_icp, small_gicp_icp_prepared
from benchmarks.costs.stages import STAGES, stage_times
from benchmarks.costs.standing import CAMERA, Case, standing
from benchmarks.costs.timing import machine, stay_on_one_core, take_turns
from common.camera import Intrinsics
from common.settings import RefineSettings, preset
from coordinator.tracking.observing.sensor_noise import SensorNoise
from tests.support.kernel import plain_path
from worker.kernel.icp import refine

POINTS, ITERATIONS, ROUNDS, PLAIN_ROUNDS, SEED = 10_000, 3, 51, 3, 0
LARGE = Intrinsics(1920, 1440, 3 * CAMERA.fx, 3 * CAMERA.fy, 959.5, 719.5)
GROWTH: dict[str, list[dict[str, Any]]] = {
    "points": [{"points": n, "camera": LARGE} for n in (1_000, 3_000, 10_000, 30_000, 100_000)],
    "dofs": [{"dofs": n} for n in (4, 12, 24, 48, 96, 180)],
    "vertices": [{"halvings": n} for n in (0, 1)],
    "noise_cm": [{"noise": SensorNoise(depth=d / 100, lateral=min(d, 1) / 100)} for d in (0, 1, 5, 10, 15)],
}
GROWTH_ROUNDS = 15
NOISES = {"clean": SensorNoise(), "15 cm noise": SensorNoise(depth=0.15, lateral=0.01)}
YARDSTICK = "small_gicp ICP"
RESULT = RESULTS / "kernel.json"


def main() -> int:
    """Measure, print the table, keep the numbers."""
    stay_on_one_core()
    cases = [
        measure(standing(POINTS, noise, SEED), label, name)
        for label, noise in NOISES.items()
        for name in ("default", "paper")
    ]
    result = {
        "machine": machine("numpy", "scipy", "numba", "small_gicp"),
        "points": POINTS,
        "icp_iterations": ITERATIONS,
        "rounds": ROUNDS,
        "seed": SEED,
        "yardstick": YARDSTICK,
        "cases": cases,
        "growth": {of: [grow(**change) for change in changes] for of, changes in GROWTH.items()},
    }
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print(table(result))
    return 0


def measure(case: Case, data: str, preset_name: str) -> dict[str, Any]:
    """Times of all calls on one case; medians and quartiles in ms, and ratios to the yardstick."""
    settings = three_iterations(preset_name)
    observed, visible = case.observed, case.visible()
    times = take_turns(
        {
            "gepf particle": lambda: refine(case.model, case.observation, case.start, settings),
            YARDSTICK: small_gicp_icp(observed, visible, ITERATIONS),
            "small_gicp ICP, tree ready": small_gicp_icp_prepared(observed, visible, ITERATIONS),
            "Open3D ICP": open3d_icp(observed, visible, ITERATIONS),
        },
        ROUNDS,
    )
    plainly = {"plain numpy and scipy": lambda: plainly_refined(case, settings)}
    times |= take_turns(plainly, PLAIN_ROUNDS)
    return {
        "data": data,
        "preset": preset_name,
        "model_vertices": len(case.model.vertices),
        "visible_vertices": len(visible),
        "joint_error_before_cm": round(100 * case.joint_error(case.start), 2),
        "joint_error_after_cm": round(100 * refined_error(case, settings), 2),
        "calls": {name: figures(spent, times[YARDSTICK]) for name, spent in times.items()},
        "stages_ms": stage_times(case, settings, ROUNDS),
    }


def three_iterations(name: str) -> RefineSettings:
    """A preset's settings with as many ICP iterations as are measured."""
    return msgspec.structs.replace(preset(name).refine, icp_iterations=ITERATIONS)


def plainly_refined(case: Case, settings: RefineSettings) -> object:
    """The particle refined by the plain path."""
    return plain_path.refine(case.model, case.subject, case.start[0], settings)


def grow(points: int = POINTS, noise: SensorNoise = NOISES["clean"], **change: Any) -> dict[str, Any]:
    """Stage times of another case."""
    case = standing(points, noise, SEED, **change)
    return {
        "points": points,
        "dofs": len(case.model.dof_names),
        "vertices": len(case.model.vertices),
        "noise_cm": 100 * noise.depth,
        "stages_ms": stage_times(case, three_iterations("default"), GROWTH_ROUNDS),
    }


def refined_error(case: Case, settings: RefineSettings) -> float:
    """Mean joint error in metres after the descent: a kernel that does nothing would be fast too."""
    return case.joint_error(refine(case.model, case.observation, case.start, settings).poses)


def figures(spent: np.ndarray, yardstick: np.ndarray) -> dict[str, float]:
    """Median and quartiles of times (rounds,) in ms, and the ratio of the medians."""
    low, median, high = np.percentile(spent, [25, 50, 75])
    return {
        "median_ms": round(float(median), 3),
        "quartile_1_ms": round(float(low), 3),
        "quartile_3_ms": round(float(high), 3),
        "ratio": round(float(median / np.median(yardstick)), 3),
    }


def table(result: dict[str, Any]) -> str:
    """The numbers for a person to read."""
    lines = [
        f"{result['machine']['processor']}, processor time on one core",
        f"{result['points']} points, {result['icp_iterations']} ICP iterations, median of {result['rounds']}",
        f"ratio to {result['yardstick']} (point clouds and k-d tree included)",
    ]
    for case in result["cases"]:
        lines.append(
            f"\n{case['data']}, preset {case['preset']}: {case['visible_vertices']} of "
            f"{case['model_vertices']} vertices visible; mean joint error "
            f"{case['joint_error_before_cm']} -> {case['joint_error_after_cm']} cm"
        )
        lines.extend(
            f"  {name:<28}{call['median_ms']:8.2f} ms  ({call['quartile_1_ms']:.2f} to "
            f"{call['quartile_3_ms']:.2f}){call['ratio']:8.2f}"
            for name, call in case["calls"].items()
        )
        lines.append("  stages: " + stage_line(case["stages_ms"]))
    for of, rows in result["growth"].items():
        lines.append(f"\n{of:<10}" + "".join(f"{stage:>16}" for stage in (*STAGES, "all")) + "  ms")
        lines.extend(f"{row[of]:<10g}" + stage_columns(row["stages_ms"]) for row in rows)
    return "\n".join(lines)


def stage_line(stages: dict[str, float]) -> str:
    """Stages in one line."""
    return ", ".join(f"{stage} {spent:.2f}" for stage, spent in stages.items()) + " ms"


def stage_columns(stages: dict[str, float]) -> str:
    """Stages side by side, and their sum."""
    return "".join(f"{spent:16.3f}" for spent in (*stages.values(), sum(stages.values())))


if __name__ == "__main__":
    sys.exit(main())
