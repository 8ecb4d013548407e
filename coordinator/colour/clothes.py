"""The colour of clothes, which shows who returns after leaving the image, and who is somebody else.

The colour of the trunk counts. Legs are too narrow: between their keypoints, the image shows the background.
"""

from __future__ import annotations

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import Frame, SubjectFrame
from gepf.coordinator.colour.keypoints import trunk_pixels
from gepf.coordinator.settings import ClothesSettings


class Clothes(msgspec.Struct, frozen=True):
    """What is remembered about a person's clothes.

    colour: mean of the colours that were seen, see `clothes_in`. seen_s: time for which they were seen,
    seconds, at most `memory_s`.
    """

    colour: tuple[float, float, float]
    seen_s: float


def clothes_in(frame: Frame, subject: SubjectFrame) -> Array | None:
    """The colour (3,) of the trunk of a subject with keypoints: the mean of all cameras that show it.

    It is the square root of the brightness, red minus green, and yellow minus blue, from 0 or -1 to 1. Only
    the subject's own pixels count, not what is in front of them. None if no colour image shows most of the
    trunk.
    """
    seen, images = list[Array](), {view.camera: view for view in frame.views}
    for view in subject.views:
        image = images[view.image.camera]
        if image.colours is None or view.keypoints is None:
            continue
        places = np.rint(trunk_pixels(view.keypoints))
        inside = np.all((places >= 0) & (places < view.image.depth.shape[::-1]), axis=1)
        own = places[inside].astype(int)
        own = own[view.image.depth[*own.T[::-1]] > 0]
        if 2 * len(own) > len(places):
            scale = np.array(image.colours.shape[1::-1]) / image.depth.shape[::-1]
            columns, rows = ((own - view.extent[:2] + 0.5) * scale).astype(int).T
            red, green, blue = image.colours[rows, columns].T / 255.0
            opponent = np.sqrt((red + green + blue) / 3.0), red - green, 0.5 * (red + green) - blue
            seen.append(np.median(opponent, axis=1))
    return np.asarray(np.mean(seen, axis=0)) if seen else None


def alike_nats(clothes: Clothes | None, seen: Array | None, settings: ClothesSettings) -> float:
    """Evidence, in nats, that a colour (3,) is that of these clothes, not of somebody else's.

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


def remember(clothes: Clothes | None, seen: Array, interval_s: float, settings: ClothesSettings) -> Clothes:
    """What is remembered after a frame in which a colour (3,) was seen for `interval_s` seconds.

    Light and posture change colours slowly, so what was seen long ago counts less. A colour is weighted by
    the probability that it is that of the clothes, but at least by `unlike_weight`: the memory may be wrong.
    """
    if clothes is None:
        return Clothes(tuple(seen.tolist()), interval_s)
    hidden_prior = settings.hidden_odds / (1.0 + settings.hidden_odds)
    own_probability = 1.0 - hidden_prior * float(np.exp(-alike_nats(clothes, seen, settings)))
    weight_s = max(own_probability, settings.unlike_weight) * interval_s
    seen_s = min(clothes.seen_s + weight_s, settings.memory_s)
    colour = clothes.colour + min(weight_s / seen_s, 1.0) * (seen - clothes.colour)
    return Clothes(tuple(colour.tolist()), seen_s)
