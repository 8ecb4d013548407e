"""Requests to refine particles, the replies to them, and refusals, as they cross the wire."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.bounds import (
    LARGEST_DEVIATION,
    LARGEST_LOG_LIKELIHOOD,
    LARGEST_POSE,
    LARGEST_SETTING,
    MAX_DOFS,
    MAX_ITERATIONS,
    MAX_PARTICLES,
    POSITIVE_SETTINGS,
    SMALLEST_POSITIVE,
    most_covariances,
)
from common.errors import ProtocolError
from common.protocol.keys import NAME
from common.protocol.wire import (
    Array,
    Hash,
    Message,
    Natural,
    check_finite,
    check_magnitude,
    check_numbers,
    check_range,
    decode,
    encode,
    pack,
    unpack,
)
from common.refinement import Refined, row_starts, triangle_size
from common.settings import RefineSettings

MAX_REASON = 1_000  # characters

RunName = Annotated[str, msgspec.Meta(pattern=rf"^{NAME.pattern}\Z")]


class RequestMessage(Message, frozen=True, tag="request"):
    """A RefineRequest."""

    run: RunName
    frame: Natural
    model: Hash
    settings: RefineSettings
    poses: Array
    covariance: bool = False


class ReplyMessage(Message, frozen=True, tag="reply"):
    """Refined particles (N, D): all their poses, then log likelihoods, then residuals, in one row."""

    values: Array


class SureReplyMessage(Message, frozen=True, tag="sure-reply"):
    """The same, and how sure each of them is: the lower triangles of roots of covariances."""

    values: Array
    covariance_roots: Array


class RefusalMessage(Message, frozen=True, tag="refusal"):
    """Why a request was not served; retryable if only its frame or model was not found."""

    reason: Annotated[str, msgspec.Meta(max_length=MAX_REASON)]
    retryable: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class RefineRequest:
    """One batch: refine `poses` (N, D) of a model on a frame of a run."""

    run: str
    frame: int
    model_hash: str
    settings: RefineSettings
    poses: NDArray[np.float64]  # (N, D)
    covariance: bool = False  # whether each particle's is requested: a worker gives it then, and only then

    def batch(self, start: int, stop: int) -> RefineRequest:
        """The request for particles start..stop-1."""
        return replace(self, poses=self.poses[start:stop])


def encode_request(request: RefineRequest) -> bytes:
    """A batch for one worker."""
    message = RequestMessage(
        run=request.run,
        frame=request.frame,
        model=request.model_hash,
        settings=request.settings,
        poses=pack(request.poses),
        covariance=request.covariance,
    )
    return encode(message)


def decode_request(payload: bytes) -> RefineRequest:
    """A batch, or ProtocolError."""
    message = decode(payload, RequestMessage)
    poses = unpack("poses", message.poses, "<f8", ("N", "D"), {})
    count, dofs = poses.shape
    if not 0 < count <= MAX_PARTICLES:
        raise ProtocolError(f"a batch has 1 to {MAX_PARTICLES} poses, this one {count}")
    if not 0 < dofs <= MAX_DOFS:
        raise ProtocolError(f"a pose has 1 to {MAX_DOFS} values, these {dofs}")
    check_magnitude("poses", poses, LARGEST_POSE)
    check_settings(message.settings)
    most = most_covariances(dofs)
    if message.covariance and count > most:
        raise ProtocolError(
            f"covariances of {count} poses of {dofs} values are too many, expected up to {most}"
        )
    return RefineRequest(
        message.run, message.frame, message.model, message.settings, poses, message.covariance
    )


@lru_cache(maxsize=64)  # a run's are always the same
def check_settings(settings: RefineSettings) -> None:
    """ProtocolError for numbers that no refinement can be done with."""
    for name, value in msgspec.structs.asdict(settings).items():
        if isinstance(value, float):
            check_finite(f"setting {name}", value)
            least = SMALLEST_POSITIVE if name in POSITIVE_SETTINGS else 0.0
            check_range(f"setting {name}", value, least, LARGEST_SETTING)
        elif isinstance(value, int) and not 0 <= value <= MAX_ITERATIONS:
            raise ProtocolError(f"setting {name} is {value}, expected 0 to {MAX_ITERATIONS}")


def encode_refined(refined: Refined) -> bytes:
    """Refined particles for the coordinator."""
    values = pack(np.concatenate((refined.poses.ravel(), refined.log_likelihood, refined.residual)))
    if refined.covariance_roots is None:
        return encode(ReplyMessage(values=values))
    return encode(SureReplyMessage(values=values, covariance_roots=pack(refined.covariance_roots)))


def decode_refined(payload: bytes, shape: tuple[int, ...], *, covariance: bool = False) -> Refined:
    """Refined particles for requested poses of a shape (N, D), with covariances if those were requested.

    Poses are finite; log likelihoods and residuals may be infinite where nothing was observed. Raises
    ProtocolError for anything else.
    """
    count, dofs = shape
    message: ReplyMessage | SureReplyMessage = (
        decode(payload, SureReplyMessage) if covariance else decode(payload, ReplyMessage)
    )
    values = unpack("the reply", message.values, "<f8", (count * (dofs + 2),), {})
    end = count * dofs
    refined = Refined(values[:end].reshape(shape), values[end : end + count], values[end + count :])
    check_refined(refined)
    if isinstance(message, ReplyMessage):
        return refined
    packed = (count, triangle_size(dofs))
    roots = unpack("the reply's covariance_roots", message.covariance_roots, "<f4", packed, {})
    check_covariance_roots(roots, dofs)
    return replace(refined, covariance_roots=roots)


def check_refined(refined: Refined) -> None:
    """ProtocolError unless these can be refined particles; where nothing was observed some are infinite."""
    log_likelihood, residual = refined.log_likelihood, refined.residual
    check_magnitude("the reply's poses", refined.poses, LARGEST_POSE)
    check_magnitude(
        "the reply's log_likelihood", log_likelihood[log_likelihood != -np.inf], LARGEST_LOG_LIKELIHOOD
    )
    if not residual.min(initial=0.0) >= 0.0:  # nor for a NaN
        check_numbers("the reply's residual", residual)
        raise ProtocolError("the reply's residual holds values below zero")


def check_covariance_roots(roots: NDArray[np.float32], dofs: int) -> None:
    """ProtocolError unless these (N, D (D + 1) / 2) are factors of covariances, none of them too wide."""
    rows = row_starts(dofs)
    if not roots[:, rows + np.arange(dofs)].min(initial=1.0) > 0.0:  # nor for a NaN
        check_finite("the reply's covariance_roots", roots)
        raise ProtocolError("the reply's covariance_roots have a diagonal that is not above zero")
    largest = np.sqrt(np.add.reduceat(np.square(roots, dtype=np.float64), rows, axis=1).max(initial=0.0))
    if not largest <= LARGEST_DEVIATION:
        check_finite("the reply's covariance_roots", roots)
        raise ProtocolError(
            f"the reply's covariance has a deviation of {largest:g}, expected {LARGEST_DEVIATION:g}"
        )


def encode_refusal(reason: str, *, retryable: bool = False) -> bytes:
    """Why a request cannot be served."""
    return encode(RefusalMessage(reason=reason[:MAX_REASON], retryable=retryable))


def decode_refusal(payload: bytes) -> RefusalMessage:
    """A refusal, its reason without what a terminal would act on, or ProtocolError."""
    refusal = decode(payload, RefusalMessage)
    plain = "".join(letter if letter.isprintable() else " " for letter in refusal.reason)
    return RefusalMessage(reason=plain, retryable=refusal.retryable)
