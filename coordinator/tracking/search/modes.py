"""How people hold arms, legs and trunk: what the library of poses is drawn around. Degrees.

Angles have the signs of `coordinator.bodies.human.skeleton`. A mode is where a posture is typical; the
library spreads around it, within the joints' limits.
"""

from __future__ import annotations

from dataclasses import dataclass

Angles = tuple[float, float, float, float]

ARM = ("shoulder_flexion", "shoulder_abduct", "shoulder_twisting", "elbow_flexion")
ARMS: tuple[Angles, ...] = (
    (0, 8, 0, 10),  # hangs
    (85, 5, 0, 10),  # points forward
    (0, 85, 0, 10),  # stretched sideways
    (165, 10, 0, 15),  # overhead
    (-15, 45, 40, 80),  # hand on the hip
    (10, 10, 0, 90),  # forearm forward
    (40, 10, 60, 100),  # before the chest
    (70, 30, 0, 130),  # hand at the face
    (0, 90, -80, 85),  # hands up
)

LEG = ("hip_flexion", "hip_abduct", "hip_twisting", "knee_flexion")
STRAIGHT: Angles = (0, 3, 0, 5)
LEGS: tuple[tuple[Angles, Angles], ...] = (
    (STRAIGHT, STRAIGHT),
    ((0, 20, 0, 5), (0, 20, 0, 5)),  # wide
    ((30, 3, 0, 15), (-15, 3, 0, 20)),  # a stride
    ((80, 5, 0, 90), STRAIGHT),  # a knee lifted
    ((70, 3, 0, 10), STRAIGHT),  # a kick
    ((70, 5, 0, 75), (-15, 3, 0, 35)),  # a lunge
    ((85, 10, 0, 90), (0, 5, 0, 95)),  # down on one knee
    ((85, 8, 0, 85), (85, 8, 0, 85)),  # sits
    ((110, 15, 0, 120), (110, 15, 0, 120)),  # squats
    ((0, 5, 0, 100), (0, 5, 0, 100)),  # kneels
    ((95, 8, 0, 140), (95, 8, 0, 140)),  # sits on the heels
    ((90, 5, 0, 10), (90, 5, 0, 10)),  # sits with the legs stretched out
)
USUAL_LEGS = 5  # the first of these are for everybody who stands

TILT = ("vl3_tilt",)
TILTS = (0.0, 25.0, 55.0)


@dataclass(frozen=True, slots=True)
class Spread:
    """How far the library goes from the modes, standard deviations in degrees."""

    arm: float = 18.0
    leg: float = 12.0
    trunk: float = 10.0


SPREAD = Spread()
