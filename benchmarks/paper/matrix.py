"""What is run: methods, particles, noise and seeds, a row of the table each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from benchmarks.choices import settings_with
from common.errors import InputError
from common.settings import Settings
from coordinator.filters.baselines import Annealed
from coordinator.synthesis.scenes import ARM_DOFS
from coordinator.tracking.observing.sensor_noise import SensorNoise, assume_noise
from worker.kernel.parameters import pack_parameters

NONE, HEAVY, STEREO = SensorNoise(), SensorNoise(0.15, 0.01), SensorNoise(0.02, 0.003)
SEEDS = 10
CURVE_SEEDS, CURVE_FRAMES, CURVE_POINTS = 2, 110, 1000
ARM_FRAMES, TURN_FRAMES = 176, 180
POINTS = 10_000  # observed points a frame, in the paper


@dataclass(frozen=True, slots=True)
class Row:
    """Runs that differ by their seed alone."""

    name: str
    part: str  # the table that it stands in
    method: str
    preset: str
    particles: int | None
    noise: SensorNoise
    seeds: int
    frames: int
    scene: str = "arm"
    active: tuple[str, ...] | None = ARM_DOFS
    changes: tuple[str, ...] = ()  # settings in place of the preset's, `key=value`
    limits: bool = True  # of the body's joints

    def settings(self, seed: int) -> Settings:
        """What `gepf track` computes with."""
        wish = (f"method={self.method}", f"preset={self.preset}", f"seed={seed}", *self.changes)
        return settings_with(wish, self.particles)

    @property
    def evaluations(self) -> int:
        """Poses that are held against the points in a frame: one each iteration, and one to weigh."""
        settings = self.settings(0)
        particles = settings.filter.particles
        if self.method == "condensation":
            return particles
        if self.method == "annealed":
            return particles * Annealed().layers
        rounds = 2 if pack_parameters(assume_noise(settings.refine, self.noise)).soft else 1
        return particles * (rounds * settings.refine.icp_iterations + 1)


GRADIENT = Row("gradient", "heavy", "gradient", "default", None, HEAVY, SEEDS, ARM_FRAMES)

CLEAN = [
    replace(GRADIENT, name=f"clean-gradient-{preset}", part="clean", preset=preset, noise=NONE, seeds=1)
    for preset in ("paper", "default")
]

HEAVY_ROWS = [
    replace(GRADIENT, name=f"gradient-{preset}", preset=preset) for preset in ("paper", "default")
] + [
    replace(GRADIENT, name=f"gepf-20-{preset}", method="gepf", preset=preset, particles=20)
    for preset in ("paper", "default")
]

LETTER_ROWS = [
    replace(
        row,
        name=row.name.replace("paper", "letter"),
        part="letter",
        seeds=3,
        changes=("measure_noise=false",),
        limits=False,
    )  # nothing that the paper does not name
    for row in HEAVY_ROWS
    if row.preset == "paper"
]

MODERATE_ROWS = [
    replace(row, name=f"moderate-{row.name}", part="moderate", noise=SensorNoise(0.05, 0.005), seeds=3)
    for row in HEAVY_ROWS
]

CURVE = replace(
    GRADIENT,
    part="curves",
    seeds=CURVE_SEEDS,
    frames=CURVE_FRAMES,
    changes=(f"points={CURVE_POINTS}",),
)

CURVES = [
    replace(
        CURVE, name=f"curve-{method}-{preset}-{particles}", method=method, preset=preset, particles=particles
    )
    for method, preset, choices in (
        ("gepf", "paper", (5, 20, 60)),
        ("gepf", "default", (2, 5, 10, 20, 50)),
        ("condensation", "default", (100, 300, 1000, 2000)),
        ("annealed", "default", (10, 30, 100, 200)),
    )
    for particles in choices
]

TURN = replace(GRADIENT, part="turn", noise=STEREO, seeds=1, frames=TURN_FRAMES, scene="turn", active=None)
TURNS = [
    replace(TURN, name=f"turn-{method}-{preset}", method=method, preset=preset, particles=particles)
    for preset in ("paper", "default")
    for method, particles in (("gradient", None), ("gepf", 100))
]

ROWS = [*CLEAN, *HEAVY_ROWS, *LETTER_ROWS, *MODERATE_ROWS, *CURVES, *TURNS]


def choose(only: Sequence[str] | None, seeds: int | None) -> list[Row]:
    """All rows, or those of a name or part, with so many seeds at the most. InputError if unknown."""
    for name in only or ():
        if not any(name in (row.name, row.part) for row in ROWS):
            parts = ", ".join(dict.fromkeys(row.part for row in ROWS))
            raise InputError(f"no row '{name}'; name a part ({parts}) or a row such as {ROWS[0].name}")
    wanted = [row for row in ROWS if only is None or row.name in only or row.part in only]
    return wanted if seeds is None else [replace(row, seeds=min(row.seeds, seeds)) for row in wanted]
