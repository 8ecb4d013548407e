"""The colour of a person's clothes: tells who returns after leaving the image, and who is somebody else.

The colour of the trunk counts. Legs are too narrow: between their keypoints, the image shows the background.
"""

from __future__ import annotations

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import Frame
from gepf.coordinator.colour.keypoints import trunk_pixels
from gepf.coordinator.colour.matching import Keypoints
from gepf.coordinator.settings import ClothesSettings


class Clothes(msgspec.Struct, frozen=True):
    """What is remembered about a person's clothes.

    colour: mean of the colours that were seen, see `clothes_in`. seen_s: time for which they were seen,
    seconds, at most `memory_s`.
    """

    colour: tuple[float, float, float]
    seen_s: float


def clothes_in(frame: Frame, keypoints: Keypoints) -> Array | None:
    """The colour (3,) of the trunk of a person with these keypoints: the mean of all cameras that show it.

    It is the square root of the brightness, red minus green, and yellow minus blue, from 0 or -1 to 1. None
    if no colour image shows most of the trunk.
    """
    seen = list[Array]()
    for view in frame.views:
        if view.colours is None or view.camera not in keypoints:
            continue
        shape = np.array(view.colours.shape[1::-1])
        pixels = trunk_pixels(keypoints[view.camera]) * shape / np.array(view.depth.shape[::-1])
        inside = np.all((pixels >= 0.0) & (pixels < shape), axis=1)
        columns, rows = pixels[inside].astype(int).T
        colours = view.colours[rows, columns]
        colours = colours[colours.any(axis=1)] / 255.0  # black: registered colour has gaps there
        if 2 * len(colours) > len(pixels):
            red, green, blue = colours.T
            opponent = np.sqrt(colours.mean(axis=1)), red - green, 0.5 * (red + green) - blue
            seen.append(np.median(opponent, axis=1))
    return np.asarray(np.mean(seen, axis=0)) if seen else None


def alike_nats(clothes: Clothes | None, seen: Array | None, settings: ClothesSettings) -> float:
    """How much a colour (3,) speaks for the person in these clothes, and against somebody else, nats.

    It is the logarithm of a likelihood ratio: the colours of one person's clothes differ less than those of
    two people's. Something else may have been seen, such as an arm in front of the trunk. 0 if nothing is
    remembered, or nothing is seen.
    """
    if clothes is None or seen is None:
        return 0.0
    squared = (seen - clothes.colour) ** 2
    same = np.array([settings.brightness_deviation, settings.hue_deviation, settings.hue_deviation])
    other = np.array(
        [settings.other_brightness_deviation, settings.other_hue_deviation, settings.other_hue_deviation]
    )
    log_ratio = np.sum(0.5 * squared * (other**-2.0 - same**-2.0) + np.log(other / same))
    return float(np.logaddexp(log_ratio, np.log(settings.hidden_odds)) - np.log1p(settings.hidden_odds))


def remember(
    clothes: Clothes | None, seen: Array | None, interval_s: float, settings: ClothesSettings
) -> Clothes | None:
    """What is remembered after a frame in which a colour (3,) was seen for `interval_s` seconds.

    Light and posture change colours slowly, so what was seen long ago counts less. A colour counts as much
    as it is likely to be that of the clothes, but never nothing: what is remembered may be wrong.
    """
    if seen is None:
        return clothes
    if clothes is None:
        return Clothes(tuple(seen.tolist()), interval_s)
    hidden_prior = settings.hidden_odds / (1.0 + settings.hidden_odds)
    own_probability = 1.0 - hidden_prior * float(np.exp(-alike_nats(clothes, seen, settings)))
    weight_s = max(own_probability, settings.unlike_weight) * interval_s
    seen_s = min(clothes.seen_s + weight_s, settings.memory_s)
    colour = clothes.colour + min(weight_s / seen_s, 1.0) * (seen - clothes.colour)
    return Clothes(tuple(colour.tolist()), seen_s)
