"""Requests to refine particles, what is replied, and refusals, as they cross the wire: checked on arrival.

Every decoder raises ProtocolError, and its message says what is wrong. Nothing is unpickled or evaluated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.errors import ProtocolError
from common.protocol.arrays import pack, unpack
from common.protocol.checks import (
    check_covariance_roots,
    check_poses,
    check_refined,
    check_reply,
    check_settings,
    check_sizes,
)
from common.protocol.wire import (
    MAX_REASON,
    RefusalMessage,
    ReplyMessage,
    RequestMessage,
    SureReplyMessage,
    decode,
    encode,
)
from common.refinement import Refined
from common.settings import RefineSettings
from common.triangles import triangle_size


@dataclass(frozen=True, slots=True, eq=False)
class OfSizes:
    """The sizes (N, 2) of particles, between their model and another of the same body, thicker."""

    thick_hash: str
    sizes: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RefineRequest:
    """One batch: refine `poses` (N, D) of a model, or of that model in some sizes, on a frame of a run."""

    run: str
    frame: int
    model_hash: str
    settings: RefineSettings
    poses: NDArray[np.float64]  # (N, D)
    of_sizes: OfSizes | None = None
    covariance: bool = False  # whether each particle's is asked for: a worker gives it then, and only then

    def batch(self, start: int, stop: int) -> RefineRequest:
        """The request for particles start..stop-1."""
        if stop - start == len(self.poses):
            return self
        of = self.of_sizes
        sizes = None if of is None else OfSizes(of.thick_hash, of.sizes[start:stop])
        return replace(self, poses=self.poses[start:stop], of_sizes=sizes)


def encode_request(request: RefineRequest) -> bytes:
    """A batch for one worker."""
    of = request.of_sizes
    message = RequestMessage(
        run=request.run,
        frame=request.frame,
        model=request.model_hash,
        thick=None if of is None else of.thick_hash,
        sizes=None if of is None else pack(of.sizes),
        settings=request.settings,
        poses=pack(request.poses),
        covariance=request.covariance,
    )
    return encode(message)


def decode_request(payload: bytes) -> RefineRequest:
    """A batch, or ProtocolError."""
    message = decode(payload, RequestMessage)
    poses = unpack("poses", message.poses, "<f8", ("N", "D"), {})
    check_poses(poses)
    check_settings(message.settings)
    if message.covariance:
        check_reply(poses.shape)
    return RefineRequest(
        message.run,
        message.frame,
        message.model,
        message.settings,
        poses,
        decode_sizes(message, len(poses)),
        message.covariance,
    )


def decode_sizes(message: RequestMessage, particles: int) -> OfSizes | None:
    """The sizes of so many particles in a request, if it has any."""
    if message.thick is None and message.sizes is None:
        return None
    if message.thick is None or message.sizes is None:
        raise ProtocolError("a request for sizes names a thicker model, and the sizes")
    sizes = unpack("sizes", message.sizes, "<f8", (particles, 2), {})
    check_sizes(sizes)
    return OfSizes(message.thick, sizes)


def encode_refined(refined: Refined) -> bytes:
    """Refined particles for the coordinator."""
    values = pack(np.concatenate((refined.poses.ravel(), refined.log_likelihood, refined.residual)))
    if refined.covariance_roots is None:
        return encode(ReplyMessage(values=values))
    return encode(SureReplyMessage(values=values, covariance_roots=pack(refined.covariance_roots)))


def decode_refined(payload: bytes, asked: tuple[int, ...], *, covariance: bool = False) -> Refined:
    """Refined particles for poses of shape `asked` (N, D), with covariances if those were asked for.

    Poses are finite; log likelihoods and residuals may be infinite where nothing was observed. Raises
    ProtocolError for anything else.
    """
    count, dofs = asked
    message: ReplyMessage | SureReplyMessage = (
        decode(payload, SureReplyMessage) if covariance else decode(payload, ReplyMessage)
    )
    values = unpack("the reply", message.values, "<f8", (count * (dofs + 2),), {})
    end = count * dofs
    refined = Refined(values[:end].reshape(asked), values[end : end + count], values[end + count :])
    check_refined(refined)
    if isinstance(message, ReplyMessage):
        return refined
    shape = (count, triangle_size(dofs))
    roots = unpack("the reply's covariance_roots", message.covariance_roots, "<f4", shape, {})
    check_covariance_roots(roots, dofs)
    return replace(refined, covariance_roots=roots)


def encode_refusal(reason: str, *, retryable: bool = False) -> bytes:
    """Why a request cannot be served."""
    return encode(RefusalMessage(reason=reason[:MAX_REASON], retryable=retryable))


def decode_refusal(payload: bytes) -> RefusalMessage:
    """A refusal, its reason without what a terminal would act on, or ProtocolError."""
    refusal = decode(payload, RefusalMessage)
    plain = "".join(letter if letter.isprintable() else " " for letter in refusal.reason)
    return RefusalMessage(reason=plain, retryable=refusal.retryable)
