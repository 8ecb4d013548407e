"""What each clue is worth, as `python -m benchmarks.certainty --fit` found it and wrote it here.

Fitted to preset default: eight hard actions of UTD-MHAD's subjects 1 and 2, where the depth does not
contradict the reference, and rendered people with exact truth (skinned, three_cameras, rooms), at 30, 15 and
10 frames a second.
"""

from __future__ import annotations

PROBABILITY = 12.26  # intercept of the log odds of being off
DEVIATION = 3.706  # and of the logarithm of its deviation in metres

FITTED: dict[str, tuple[float, float, float, float]] = {
    "shown": (0.03867, 1, -1.282, -0.7079),
    "covered": (0, 0.9161, 1.261, 0.5418),
    "nearer": (0, 0.07671, 3.932, -1.985),
    "violated": (0, 0.141, 4.447, -0.05153),
    "limb_shown": (0.2079, 1, -0.6319, -1.139),
    "limb_covered": (0, 0.7569, 0.6942, -1.407),
    "limb_nearer": (0, 0.07059, -1.877, 2.646),
    "limb_violated": (0, 0.09862, 13.26, 5.421),
    "off": (-4.259, -3.043, 1.032, 0.3426),
    "limb_off": (-4.097, -2.465, 0.4873, 0.1406),
    "unexplained": (-6.215, -4.469, 0.6581, 0.2359),
    "spread": (-4.724, -2.214, 0.7272, 0.4023),
    "weak_spread": (-4.494, -1.703, 0.6882, -0.01627),
    "limb_spread": (-4.634, -1.745, 0.1818, -0.08339),
    "moved": (-5.141, -1.252, 0.05468, 0.2012),
    "bent": (0, 8.53, 0.2482, 0.0976),
    "lever": (0, 0.8529, 0.1262, -0.1833),
}
"""Of each clue the least and the most, and its weight in the one and in the other."""
