"""What each clue is worth, as `python -m benchmarks.certainty --fit` found it and wrote it here.

Fitted to preset default: eight hard actions of UTD-MHAD's subjects 1 and 2, where the depth does not
contradict the reference, and rendered people with exact truth (skinned, three_cameras, rooms), at 30, 15 and
10 frames a second: the odds half-way between those of before and those of the fit, the deviation's weights as
they were.
"""

from __future__ import annotations

PROBABILITY = 3.802  # intercept of the log odds of being off
DEVIATION = 1.325  # and of the logarithm of its deviation in metres
UNSEEN = 0.46  # added to it where less than half of a joint is shown

FITTED: dict[str, tuple[float, float, float, float]] = {
    "shown": (0.01572, 1, -1.256, -0.5051),
    "covered": (0, 0.9649, 1.232, 1.061),
    "nearer": (0, 0.0729, 7.7, -2.829),
    "violated": (0, 0.1652, 5.317, 2.035),
    "limb_shown": (0.1361, 1, -0.6931, -0.7036),
    "limb_covered": (0, 0.8486, 0.7151, -1.537),
    "limb_nearer": (0, 0.06438, -3.197, 13.44),
    "limb_violated": (0, 0.1121, 9.451, 5.009),
    "off": (-4.316, -3.004, 0.4671, 0.4169),
    "limb_off": (-4.164, -2.465, 0.04563, 0.0971),
    "unexplained": (-6.215, -4.526, 0.06281, -0.06686),
    "spread": (-5.267, -1.473, 0.5314, 0.4706),
    "weak_spread": (-5.015, -1.049, 0.4309, 0.02289),
    "limb_spread": (-5.245, -1.188, 0.2251, -0.1132),
    "moved": (-5.257, -1.182, 0.1455, 0.09319),
    "bent": (0, 8.491, 0.1721, 0.06999),
    "lever": (0, 0.847, 0.06796, -0.3067),
    "body_violated": (0, 0.05161, 20.86, 0),
    "folded": (0.0006589, 4.636, 0.3217, 0),
    "ahead": (0, 0.522, 1.873, 0),
}
"""Of each clue the least and the most, and its weight in the one and in the other."""
