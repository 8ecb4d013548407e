"""What each clue is worth, as `python -m benchmarks.certainty --fit` found it and wrote it here.

Fitted to preset default: all actions of UTD-MHAD's subjects 1 and 2, where the depth does not contradict the
reference, and rendered people with exact truth (skinned, three_cameras, rooms), at 30, 15 and 10 frames a
second: the odds half-way between those of before and those of the fit. The deviation's weights are of an
earlier fit, to eight hard actions.
"""

from __future__ import annotations

PROBABILITY = 0.4637  # intercept of the log odds of being off
DEVIATION = 1.325  # and of the logarithm of its deviation in metres
UNSEEN = 0.46  # added to it where less than half of a joint is shown

FITTED: dict[str, tuple[float, float, float, float]] = {
    "shown": (0.07503, 1, -1.519, -0.5051),
    "covered": (0, 0.8984, 1.468, 1.061),
    "nearer": (0, 0.05932, 13.67, -2.829),
    "violated": (0, 0.1281, 2.204, 2.035),
    "limb_shown": (0.1584, 1, -0.8055, -0.7036),
    "limb_covered": (0, 0.8076, 0.7848, -1.537),
    "limb_nearer": (0, 0.05125, -15.28, 13.44),
    "limb_violated": (0, 0.1004, 11.05, 5.009),
    "off": (-4.273, -3.109, 0.3138, 0.4169),
    "limb_off": (-4.116, -2.949, -0.4504, 0.0971),
    "unexplained": (-6.215, -4.485, 0.01153, -0.06686),
    "spread": (-5.298, -1.527, 0.4701, 0.4706),
    "weak_spread": (-5.198, -1.067, 0.4137, 0.02289),
    "limb_spread": (-5.298, -1.16, 0.1433, -0.1132),
    "moved": (-5.186, -1.355, 0.2521, 0.09319),
    "bent": (0, 8.163, 0.2423, 0.06999),
    "lever": (0, 0.8495, 0.1088, -0.3067),
    "body_violated": (0, 0.05064, 35.64, 0),
    "folded": (0.0008847, 3.27, 0.4692, 0),
    "ahead": (0, 0.5158, 2.527, 0),
}
"""Of each clue the least and the most, and its weight in the one and in the other."""
