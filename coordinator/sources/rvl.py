"""RVL, lossless compression of depth (Wilson, Fast Lossless Depth Image Compression, 2017)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Indices
from gepf.common.compiling import numba


@numba.njit(cache=True, nogil=True)
def decode_rvl(words: Indices, out: NDArray[np.uint16]) -> bool:
    """Fill out (P,) from words (W,) of 32 bits; returns whether these hold exactly the pixels.

    A word has eight nibbles, the first in the highest bits. A number has three bits per nibble, the lowest
    first, and the fourth bit says that it goes on. Numbers are runs: of pixels without depth, then of others,
    followed by the difference of each of these to the one before, twice its amount, less 1 if it is negative.
    """
    nibbles, k, at, left, previous, is_depth = 8 * len(words), 0, 0, 0, 0, True
    while at < len(out) or left:
        value, shift, goes_on = 0, 0, True
        while goes_on:
            if k == nibbles or shift > 30:
                return False
            nibble = int(words[k >> 3] >> (28 - 4 * (k & 7))) & 15
            value |= (nibble & 7) << shift
            goes_on = nibble > 7
            k, shift = k + 1, shift + 3
        if left:
            previous += (value >> 1) ^ -(value & 1)
            out[at] = previous & 0xFFFF
            at, left = at + 1, left - 1
            continue
        is_depth = not is_depth
        if value > len(out) - at:
            return False
        if is_depth:
            left = value
        else:
            at += value
    return True
