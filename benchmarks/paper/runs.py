"""The rows of the tables (method, particles, noise, seeds), and one run of a row.

The scenes are rendered once for all seeds; their frames are the same as those of `gepf synth`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks.running import settings_with
from benchmarks.tracking import follow
from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, BodyModel
from gepf.common.errors import InputError
from gepf.common.frame import Frame, View
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.choice import choose_bodies
from gepf.coordinator.filters.baselines import Annealed
from gepf.coordinator.results.evaluation import angle_error_deg, best_hypothesis, positions
from gepf.coordinator.scene.noise import NO_NOISE, SensorNoise, assume_noise
from gepf.coordinator.settings import Settings
from gepf.coordinator.sources.source import to_units
from gepf.coordinator.synthesis.noise import add_noise
from gepf.coordinator.synthesis.scenes import ARM_DOFS, SCENES, Scene
from gepf.coordinator.synthesis.sequence import DEPTH_SCALE, render
from gepf.coordinator.tracking.estimate import Estimate
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner

NONE, HEAVY, STEREO = NO_NOISE, SensorNoise(0.15, 0.01), SensorNoise(0.02, 0.003)


@dataclass(frozen=True, slots=True)
class Row:
    """Runs that differ only in their seed, which is used for the noise and for the tracker."""

    name: str
    part: str  # the table that contains it
    method: str
    preset: str
    particles: int | None
    noise: SensorNoise
    seeds: int
    frames: int
    scene: str = "arm"
    changes: tuple[str, ...] = ()  # of settings, `key=value`

    def settings(self, seed: int) -> Settings:
        """The settings, as `gepf track` uses them."""
        changes = (f"method={self.method}", f"preset={self.preset}", *self.changes)
        return settings_with(changes, self.particles, seed)

    @property
    def evaluations(self) -> int:
        """Number of poses that are evaluated: one per iteration, and one for the likelihood.

        Those of the representatives of particles that are merged early are not counted.
        """
        settings = self.settings(0)
        particles = settings.filter.particles
        if self.method == "condensation":
            return particles
        if self.method == "annealed":
            return particles * Annealed().layers
        is_soft, iterations = (
            assume_noise(settings.refine, self.noise).is_soft,
            settings.refine.icp_iterations,
        )
        if is_soft:
            iterations *= 2
        elif settings.filter.explore and settings.filter.early_share > 0.0:
            iterations = round(settings.filter.early_share * iterations)
        return particles * (iterations + 1)


GRADIENT = Row("gradient-paper", "heavy", "gradient", "paper", None, HEAVY, 10, 176)
CURVE = replace(GRADIENT, part="curves", seeds=2, frames=110, changes=("points=1000", "soft_points_factor=1"))
TURN = replace(GRADIENT, part="turn", noise=STEREO, seeds=1, frames=180, scene="turn")
ROWS = [
    *(
        replace(GRADIENT, name=f"clean-gradient-{preset}", part="clean", preset=preset, noise=NONE, seeds=1)
        for preset in ("paper", "default")
    ),
    GRADIENT,
    replace(GRADIENT, name="gradient-default", preset="default"),
    replace(GRADIENT, name="gepf-20-paper", method="gepf", particles=20),
    replace(GRADIENT, name="gepf-20-default", method="gepf", preset="default", particles=20),
    *(
        replace(CURVE, name=f"curve-{method}-{preset}-{n}", method=method, preset=preset, particles=n)
        for method, preset, particles in (
            ("gepf", "paper", (5, 20, 60)),
            ("gepf", "default", (2, 5, 10, 20, 50)),
            ("condensation", "default", (100, 300, 1000, 2000)),
            ("annealed", "default", (10, 30, 100, 200)),
        )
        for n in particles
    ),
    *(
        replace(TURN, name=f"turn-{method}-{preset}", method=method, preset=preset, particles=particles)
        for preset in ("paper", "default")
        for method, particles in (("gradient", None), ("gepf", 100))
    ),
]


def choose(only: Sequence[str] | None, seeds: int | None) -> list[Row]:
    """All rows, or those with a name or part, with at most this number of seeds. InputError if unknown."""
    for name in only or ():
        if not any(name in (row.name, row.part) for row in ROWS):
            parts = ", ".join(dict.fromkeys(row.part for row in ROWS))
            raise InputError(f"no row '{name}'; name a part ({parts}) or a row such as {ROWS[0].name}")
    wanted = [row for row in ROWS if only is None or row.name in only or row.part in only]
    return wanted if seeds is None else [replace(row, seeds=min(row.seeds, seeds)) for row in wanted]


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """A scene and the exact depth (F, H, W) in metres of all its frames."""

    scene: Scene
    exact: NDArray[np.float32]

    def frames(self, noise: SensorNoise, seed: int, count: int) -> Iterator[Frame]:
        """The first `count` frames with noise, as read from the files of `gepf synth`."""
        camera, fps = self.scene.camera, self.scene.fps
        for number, depth_m in enumerate(self.exact[:count]):
            rng = np.random.default_rng([seed, number])
            noisy = to_units(add_noise(depth_m.astype(np.float64), camera, noise, rng), DEPTH_SCALE)
            yield Frame.of(View(number, number / fps, noisy, DEPTH_SCALE, camera))


def shoot(scene: str) -> Footage:
    """Render all frames of a scene."""
    found = SCENES[scene]()
    return Footage(found, np.array([depth.astype(np.float32) for depth in render(found)]))


@dataclass(frozen=True, slots=True)
class Job:
    """A row of the table with one seed."""

    row: Row
    seed: int


class Run(msgspec.Struct, frozen=True):
    """The result of a job: errors (F, A) of angles in degrees and (F, J) of joints in metres."""

    angles: tuple[str, ...]
    joints: tuple[str, ...]
    reported_deg: Array
    best_deg: Array  # of the hypothesis with the smallest mean error
    joint_m: Array  # of the reported pose
    ms: float  # processor time per frame, without rendering


def run(job: Job, footage: Footage) -> Run:
    """Track the frames of a row from the scene's start pose."""
    row, scene = job.row, footage.scene
    settings = row.settings(job.seed)
    bodies = choose_bodies(ARM_DOFS if row.scene == "arm" else None, settings.preset)
    begun = scene.poses[0] if scene.start is None else scene.start
    start = dict(zip(scene.model.dof_names, begun.tolist(), strict=True))
    tracker = Tracker(DirectRefiner(), settings, bodies, start=start)
    found, seconds = follow(tracker, footage.frames(row.noise, job.seed, row.frames))
    estimates = [one.estimate for one in found]
    return compare(found[-1].state.body, estimates, scene, 1e3 * float(seconds.mean()))


def compare(model: BodyModel, estimates: Sequence[Estimate], scene: Scene, ms: float) -> Run:
    """Compare the estimates with the scene's true poses."""
    full, poses = scene.model, scene.poses[: len(estimates)]
    angles = tuple(name for name in model.dof_names if name not in ROOT_DOFS[:3])
    mine, theirs = positions(model.dof_names, angles), positions(full.dof_names, angles)
    joints = np.array([e.joint_positions for e in estimates])
    best = [
        best_hypothesis(e.hypothesis_pose[None][..., mine], truth[None])[0]
        for e, truth in zip(estimates, poses[:, theirs], strict=True)
    ]
    return Run(
        angles=angles,
        joints=full.joint_names,
        reported_deg=angle_error_deg(np.array([e.pose for e in estimates])[:, mine], poses[:, theirs]),
        best_deg=np.array(best),
        joint_m=np.linalg.norm(joints - joint_positions(full, poses), axis=-1),
        ms=ms,
    )
