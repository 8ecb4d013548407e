"""Every kind of message with an example."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from common.protocol.frames import decode_frame, decode_live, encode_frame, encode_live, encode_live_end
from common.protocol.messages import (
    RefineRequest,
    decode_refined,
    decode_refusal,
    decode_request,
    encode_refined,
    encode_refusal,
    encode_request,
)
from common.protocol.models import decode_model, encode_model
from common.refinement import Refined
from common.settings import RefineSettings
from tests.support.refined import sure
from worker.warm_up import tiny_frame, tiny_model

COUNT, DOFS = 3, 6
POSES = np.linspace(-1.0, 1.0, COUNT * DOFS).reshape(COUNT, DOFS)


def tiny_request() -> RefineRequest:
    """A request as a coordinator sends it."""
    return RefineRequest("run-1", 7, tiny_model().hash, RefineSettings(damping=0.25), POSES)


def tiny_refined() -> Refined:
    """A reply of the right shape."""
    rng = np.random.default_rng(0)
    return Refined(rng.random((COUNT, DOFS)), rng.random(COUNT), rng.random(COUNT))


def tiny_sure() -> Refined:
    """The same, with roots of covariances."""
    return replace(tiny_refined(), covariance_roots=sure(POSES))


@dataclass(frozen=True)
class Kind:
    """One kind of message with an example."""

    payload: bytes
    decode: Callable[[bytes], object]


KINDS = {
    "frame": Kind(encode_frame(tiny_frame()), decode_frame),
    "live-frame": Kind(encode_live(tiny_frame().frame), decode_live),
    "live-end": Kind(encode_live_end(), decode_live),
    "model": Kind(encode_model(tiny_model()), decode_model),
    "request": Kind(encode_request(tiny_request()), decode_request),
    "reply": Kind(encode_refined(tiny_refined()), lambda payload: decode_refined(payload, (COUNT, DOFS))),
    "sure-reply": Kind(
        encode_refined(tiny_sure()),
        lambda payload: decode_refined(payload, (COUNT, DOFS), covariance=True),
    ),
    "refusal": Kind(encode_refusal("no"), decode_refusal),
}
