"""Scores of a row from its runs, and tables of scores."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from rich.table import Table

from benchmarks.paper.runs import Row, Run
from gepf.common.arrays import Array, Mask
from gepf.common.camera import back_project
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.results.evaluation import THRESHOLDS, Errors, lost_from, to_the_end
from gepf.coordinator.synthesis.rendering import DepthRenderer
from gepf.coordinator.synthesis.scenes import Scene

SETTLED = {"clean": 10, "turn": 0}  # frames that do not count: tracking starts with a wrong pose
USUALLY_SETTLED = 30
NEAR_DEG = 10.0
AROUND_M = 0.08  # across the line of sight: the part of a limb that decides whether a joint is visible
HIDDEN_M = 0.005  # a surface that is nearer than the limb by more hides it
LIMBS = {
    "elbow": ("upper_arm", "forearm"),
    "wrist": ("forearm", "hand"),
    "knee": ("thigh", "shank"),
    "ankle": ("shank", "foot"),
}
"""Links that meet in a joint; the joints of the trunk are always taken as seen."""


class RowScore(msgspec.Struct, frozen=True):
    """Scores of a row: mean errors of angles in degrees, of joints in centimetres; seeds weigh the same."""

    row: Row
    evaluations: int  # a frame
    seeds: int
    from_frame: int  # on, errors count
    reported_deg: float
    reported_by_seed: list[float]
    best_deg: float
    by_angle_deg: dict[str, float]
    within_10_deg_percent: float  # frames with a reported pose of this mean error or less
    lost: int  # runs
    limb_lost: int  # runs in which an arm or a leg was not found again
    ms_per_frame: float
    joints_cm: float
    visible_cm: float
    hidden_cm: float


def score_row(row: Row, runs: Sequence[Run], visible: Mask | None) -> RowScore:
    """The score of a row; `visible` (F, J): joints that the camera sees, if known."""
    first = SETTLED.get(row.part, USUALLY_SETTLED)
    reported, best = (
        np.array([getattr(one, name)[first:] for one in runs]) for name in ("reported_deg", "best_deg")
    )
    joints = np.array([one.joint_m for one in runs])[:, first:]
    seen = np.ones(joints.shape[1:], dtype=bool) if visible is None else visible[first : row.frames]
    errors = [
        Errors(np.arange(row.frames), one.angles, one.reported_deg, one.best_deg, one.joint_m) for one in runs
    ]
    return RowScore(
        row=row,
        evaluations=row.evaluations,
        seeds=len(runs),
        from_frame=first,
        reported_deg=mean(reported),
        reported_by_seed=[mean(one) for one in reported],
        best_deg=mean(best),
        by_angle_deg=dict(zip(runs[0].angles, map(mean, np.moveaxis(reported, -1, 0)), strict=True)),
        within_10_deg_percent=100.0 * mean(reported.mean(axis=-1) <= NEAR_DEG),
        lost=sum(lost_from(one) is not None for one in errors),
        limb_lost=sum(limb_lost(runs[0].joints, one) for one in errors),
        ms_per_frame=mean([one.ms for one in runs]),
        joints_cm=100.0 * mean(joints),
        visible_cm=100.0 * mean(joints[:, seen]),
        hidden_cm=100.0 * mean(joints[:, ~seen]) if not seen.all() else float("nan"),
    )


def mean(values: Array | Sequence[float]) -> float:
    """Mean, rounded to five decimals."""
    return round(float(np.mean(values)), 5)


def limb_lost(joints: tuple[str, ...], errors: Errors) -> bool:
    """Whether the two joints of an arm or a leg have a large mean error from some frame to the end."""
    for side in ("right", "left"):
        for limb in (("elbow", "wrist"), ("knee", "ankle")):
            pair = [joints.index(f"{side}_{name}") for name in limb]
            if to_the_end(errors.frame, errors.joint_m[:, pair].mean(axis=1) > THRESHOLDS.lost_m) is not None:
                return True
    return False


def visible_joints(scene: Scene) -> Mask:
    """Whether the camera sees each joint (F, J).

    A joint lies inside its limb. It is visible if at least half of the limb's surface around it is visible.
    Surface that the limb itself hides does not count.
    """
    model = scene.model
    seen = np.ones((len(scene.poses), len(model.joint_names)), dtype=bool)
    vertices, joints = pose_vertices(model, scene.poses), joint_positions(model, scene.poses)
    with DepthRenderer(scene.camera) as renderer:
        for frame in range(len(scene.poses)):
            whole = renderer.depth(vertices[frame], model.triangles)
            for j, name in enumerate(model.joint_names):
                side, _, kind = name.partition("_")
                if kind not in LIMBS:
                    continue
                prefixes = tuple(f"{side[0]}_{link}" for link in LIMBS[kind])
                links = [k for k, link in enumerate(model.link_names) if link.startswith(prefixes)]
                limb = model.triangles[np.isin(model.skin_links[model.triangles[:, 0], 0], links)]
                alone = renderer.depth(vertices[frame], limb)
                points, joint = back_project(alone, scene.camera), joints[frame, j]
                near = np.hypot(points[..., 0] - joint[0], points[..., 1] - joint[1]) < AROUND_M
                near &= alone > 0.0
                seen[frame, j] = near.any() and np.mean(whole[near] > alone[near] - HIDDEN_M) >= 0.5
    return seen


def table(part: str, rows: Sequence[RowScore]) -> Table:
    """The table: a line for each row of a part."""
    shown = Table(title=part, caption=f"degrees and centimetres, errors from frame {rows[0].from_frame} on")
    for heading in (
        "row", "seeds", "reported deg", "from, to", "best deg", "within 10 deg", "lost", "limb lost",
        "joints cm", "visible cm", "hidden cm", "evaluations", "ms/frame",
    ):  # fmt: skip
        shown.add_column(heading, justify="left" if heading == "row" else "right", no_wrap=heading == "row")
    for one in rows:
        shown.add_row(
            one.row.name,
            str(one.seeds),
            f"{one.reported_deg:.2f}",
            f"{min(one.reported_by_seed):.2f}, {max(one.reported_by_seed):.2f}",
            f"{one.best_deg:.2f}",
            f"{one.within_10_deg_percent:.0f} %",
            str(one.lost),
            str(one.limb_lost),
            *(f"{value:.1f}" for value in (one.joints_cm, one.visible_cm, one.hidden_cm)),
            str(one.evaluations),
            f"{one.ms_per_frame:.0f}",
        )
    return shown
