"""What each clue is worth, as `python -m benchmarks.certainty --fit` found it and wrote it here.

Fitted to preset default: eight hard actions of UTD-MHAD's subjects 1 and 2, where the depth does not
contradict the reference, and rendered people with exact truth (skinned, three_cameras, rooms), at 30, 15 and
10 frames a second: the odds half-way between those of before and those of the fit, the deviation's weights as
they were.
"""

from __future__ import annotations

PROBABILITY = 6.7  # intercept of the log odds of being off
DEVIATION = 1.325  # and of the logarithm of its deviation in metres
UNSEEN = 0.46  # added to it where less than half of a joint is shown

FITTED: dict[str, tuple[float, float, float, float]] = {
    "shown": (0.01858, 1, -1.23, -0.5051),
    "covered": (0, 0.9655, 1.226, 1.061),
    "nearer": (0, 0.06981, 7.432, -2.829),
    "violated": (0, 0.1685, 4.961, 2.035),
    "limb_shown": (0.1375, 1, -0.6484, -0.7036),
    "limb_covered": (0, 0.8433, 0.7148, -1.537),
    "limb_nearer": (0, 0.06024, -3.644, 13.44),
    "limb_violated": (0, 0.1152, 9.733, 5.009),
    "off": (-4.307, -3.017, 0.6389, 0.4169),
    "limb_off": (-4.169, -2.465, 0.1973, 0.0971),
    "unexplained": (-6.215, -4.486, 0.2251, -0.06686),
    "spread": (-4.876, -1.878, 0.6457, 0.4706),
    "weak_spread": (-4.715, -1.486, 0.5465, 0.02289),
    "limb_spread": (-4.806, -1.548, 0.2373, -0.1132),
    "moved": (-5.237, -1.176, 0.1156, 0.09319),
    "bent": (0, 8.792, 0.1933, 0.06999),
    "lever": (0, 0.8485, 0.09338, -0.3067),
    "body_violated": (0, 0.05341, 17.01, 0),
    "folded": (0.0007386, 4.556, 0.2072, 0),
    "ahead": (0, 0.5231, 1.134, 0),
}
"""Of each clue the least and the most, and its weight in the one and in the other."""
