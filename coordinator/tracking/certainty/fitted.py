"""What each clue is worth, as `python -m benchmarks.certainty --fit` found it and wrote it here.

Fitted to preset default: eight hard actions of UTD-MHAD's subjects 1 and 2, where the depth does not
contradict the reference, and rendered people with exact truth (skinned, three_cameras, rooms), at 30, 15 and
10 frames a second.
"""

from __future__ import annotations

PROBABILITY = 12.26  # intercept of the log odds of being off
DEVIATION = 1.325  # and of the logarithm of its deviation in metres
UNSEEN = 0.46  # added to it where less than half of a joint is shown

FITTED: dict[str, tuple[float, float, float, float]] = {
    "shown": (0.03867, 1, -1.282, -0.5051),
    "covered": (0, 0.9161, 1.261, 1.061),
    "nearer": (0, 0.07671, 3.932, -2.829),
    "violated": (0, 0.141, 4.447, 2.035),
    "limb_shown": (0.2079, 1, -0.6319, -0.7036),
    "limb_covered": (0, 0.7569, 0.6942, -1.537),
    "limb_nearer": (0, 0.07059, -1.877, 13.44),
    "limb_violated": (0, 0.09862, 13.26, 5.009),
    "off": (-4.259, -3.043, 1.032, 0.4169),
    "limb_off": (-4.097, -2.465, 0.4873, 0.0971),
    "unexplained": (-6.215, -4.469, 0.6581, -0.06686),
    "spread": (-4.724, -2.214, 0.7272, 0.4706),
    "weak_spread": (-4.494, -1.703, 0.6882, 0.02289),
    "limb_spread": (-4.634, -1.745, 0.1818, -0.1132),
    "moved": (-5.141, -1.252, 0.05468, 0.09319),
    "bent": (0, 8.53, 0.2482, 0.06999),
    "lever": (0, 0.8529, 0.1262, -0.3067),
}
"""Of each clue the least and the most, and its weight in the one and in the other."""
