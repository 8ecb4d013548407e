"""By what a run knows its sequence again: a hash of the first frame, and where it was."""

from __future__ import annotations

import hashlib

import msgspec

from common.frame import DepthFrame

PATH = "path"  # where the sequence was, for who looks at the run later; it decides nothing
LETTERS = 12  # of a hash


def digest_frame(frame: DepthFrame) -> str:
    """A hash of a frame: of its depth and its camera."""
    camera = repr((*msgspec.structs.astuple(frame.intrinsics), frame.depth_scale, frame.time_s))
    return digest(camera.encode() + frame.depth.tobytes())


def digest(content: bytes) -> str:
    """A few letters that stand for the content."""
    return hashlib.sha256(content).hexdigest()[:LETTERS]
