"""What one particle costs, as a multiple of a rigid ICP on the same points: python -m benchmarks.kernel.

One particle is all of steps 4a-4d and 5: pose, visibility, closest points, solve, likelihood. Its 10 000
observed points and the visible model points are also what the peers get. Processor time on one core, so that
what else the machine does counts little; calls in turns; medians.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks.peers import open3d_icp, small_gicp_icp, small_gicp_icp_prepared
from benchmarks.standing import Case, standing
from benchmarks.timing import machine, stay_on_one_core, take_turns
from common.settings import RefineSettings, preset
from coordinator.scenes.noise import SensorNoise
from worker.icp import refine

POINTS, ITERATIONS, ROUNDS, SEED = 10_000, 3, 101, 0
NOISES = {"clean": SensorNoise(), "15 cm noise": SensorNoise(depth=0.15, lateral=0.01)}
YARDSTICK = "small_gicp ICP"
RESULT = Path(__file__).parent / "results" / "kernel.json"


def main() -> int:
    """Measure, print the table, keep the numbers."""
    stay_on_one_core()
    cases = [
        measure(standing(POINTS, noise, SEED), label, name)
        for label, noise in NOISES.items()
        for name in ("default",)
    ]
    result = {
        "machine": machine("numpy", "scipy", "numba", "small_gicp"),
        "points": POINTS,
        "icp_iterations": ITERATIONS,
        "rounds": ROUNDS,
        "seed": SEED,
        "yardstick": YARDSTICK,
        "cases": cases,
    }
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print(table(result))
    return 0


def measure(case: Case, data: str, preset_name: str) -> dict[str, Any]:
    """Times of all calls on one case; medians and quartiles in ms, and ratios to the yardstick."""
    settings = msgspec.structs.replace(preset(preset_name).refine, icp_iterations=ITERATIONS)
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
    return {
        "data": data,
        "preset": preset_name,
        "model_vertices": len(case.model.vertices),
        "visible_vertices": len(visible),
        "joint_error_before_cm": round(100 * case.joint_error(case.start), 2),
        "joint_error_after_cm": round(100 * refined_error(case, settings), 2),
        "calls": {name: figures(spent, times[YARDSTICK]) for name, spent in times.items()},
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
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
