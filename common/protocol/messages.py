"""Messages for refinement: requests, replies and refusals."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Annotated, Any

import msgspec
import numpy as np

from gepf.common.bounds import (
    LARGEST,
    LARGEST_LOG_LIKELIHOOD,
    LARGEST_PRECISION,
    MAX_DOFS,
    MAX_ITERATIONS,
    MAX_PARTICLES,
    POSITIVE_SETTINGS,
    SMALLEST,
)
from gepf.common.checks import check_range
from gepf.common.errors import ProtocolError
from gepf.common.protocol.keys import RUN
from gepf.common.protocol.wire import Array, Hash, Message, Natural, decode, encode, pack, unpack
from gepf.common.refinement import Particles, PosePrior, Refined, triangle_size
from gepf.common.settings import RefineSettings

ROUNDING = 1e-9  # relative, of the smallest eigenvalue of a precision

RunName = Annotated[str, msgspec.Meta(pattern=rf"^{RUN.pattern}\Z")]


class PriorMessage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A PosePrior."""

    mean: Array
    precision: Array


class RequestMessage(Message, frozen=True, tag="request"):
    """A RefineRequest."""

    run: RunName
    frame: Natural
    model: Hash
    settings: RefineSettings
    poses: Array
    covariance: bool = False
    spare: bool = False
    velocity: Array | None = None
    prior: PriorMessage | None = None


class ReplyMessage(Message, frozen=True, tag="reply"):
    """Refined particles (N, D): all their poses, then log likelihoods, then residuals, in one row.

    Where covariances were requested, also the lower triangles of their roots. And the time for which the
    request waited for others at the worker, seconds.
    """

    values: Array
    waited_s: Annotated[float, msgspec.Meta(ge=0.0, le=LARGEST)]
    covariance_roots: Array | None = None


class RefusalMessage(Message, frozen=True, tag="refusal"):
    """Reason why a request was not served; retryable if only its frame or model is missing."""

    reason: Annotated[str, msgspec.Meta(max_length=1000)]
    retryable: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class RefineRequest:
    """One batch: particles of a model, to be refined on a frame of a run, `<coordinator>/<run>`."""

    run: str
    frame: int
    model: str
    particles: Particles


def encode_request(request: RefineRequest) -> bytes:
    """A batch for one worker."""
    values = {field.name: getattr(request.particles, field.name) for field in fields(Particles)}
    packed: dict[str, Any] = {name: pack(v) if isinstance(v, np.ndarray) else v for name, v in values.items()}
    if request.particles.prior is not None:
        prior = request.particles.prior
        packed["prior"] = PriorMessage(pack(prior.mean), pack(prior.precision))
    return encode(RequestMessage(request.run, request.frame, request.model, **packed))


def decode_request(payload: bytes) -> RefineRequest:
    """A batch, or ProtocolError."""
    message = decode(payload, RequestMessage)
    poses = unpack("poses", message.poses, "<f8", ("N", "D"), -LARGEST, LARGEST)
    check_range("the number of poses", poses.shape[0], 1, MAX_PARTICLES)
    check_range("the number of a pose's values", poses.shape[1], 1, MAX_DOFS)
    check_settings(message.settings)
    velocity = None
    if message.velocity is not None:
        velocity = unpack("velocity", message.velocity, "<f8", poses.shape[1:], -LARGEST, LARGEST)
    prior = None if message.prior is None else unpack_prior(message.prior, poses.shape)
    particles = Particles(poses, message.settings, message.covariance, message.spare, velocity, prior)
    return RefineRequest(message.run, message.frame, message.model, particles)


def unpack_prior(message: PriorMessage, shape: tuple[int, ...]) -> PosePrior:
    """A prior of poses of a shape (N, D), or ProtocolError."""
    dofs = shape[1:]
    of_each, dense = len(message.mean.shape) == 2, len(message.precision.shape) == 2
    mean = unpack("the prior's mean", message.mean, "<f8", shape if of_each else dofs, -LARGEST, LARGEST)
    least = -LARGEST_PRECISION if dense else 0.0
    size, what = dofs * 2 if dense else dofs, "the prior's precision"
    precision = unpack(what, message.precision, "<f8", size, least, LARGEST_PRECISION)
    if dense and not np.array_equal(precision, precision.T):
        raise ProtocolError(f"{what} is not symmetric")
    if dense and np.linalg.eigvalsh(precision)[0] < -ROUNDING * np.abs(precision).max():
        raise ProtocolError(f"{what} is not positive semidefinite")
    return PosePrior(mean, precision)


@lru_cache(maxsize=64)  # the settings of a run are always the same
def check_settings(settings: RefineSettings) -> None:
    """ProtocolError for invalid settings."""
    for name, value in msgspec.structs.asdict(settings).items():
        if not isinstance(value, str):
            least = SMALLEST if name in POSITIVE_SETTINGS else 0.0
            check_range(
                f"setting {name}", value, least, MAX_ITERATIONS if isinstance(value, int) else LARGEST
            )


def encode_refined(refined: Refined, waited_s: float = 0.0) -> bytes:
    """Refined particles for the coordinator, and the time for which the request waited at the worker."""
    values = pack(np.concatenate((refined.poses.ravel(), refined.log_likelihood, refined.residual)))
    roots = refined.covariance_roots
    packed = None if roots is None else pack(roots)
    return encode(ReplyMessage(values=values, waited_s=min(waited_s, LARGEST), covariance_roots=packed))


def decode_refined(
    payload: bytes, shape: tuple[int, ...], *, covariance: bool = False
) -> tuple[Refined, float]:
    """Refined particles for requested poses of a shape (N, D), with covariances if those were requested.

    Also the time for which the request waited at the worker, seconds. Poses are finite; log likelihoods and
    residuals may be infinite if nothing was observed. Raises ProtocolError for anything else.
    """
    count, dofs = shape
    message = decode(payload, ReplyMessage)
    if (message.covariance_roots is not None) != covariance:
        raise ProtocolError(f"the reply {'lacks' if covariance else 'has'} covariance_roots")
    values = unpack("the reply", message.values, "<f8", (count * (dofs + 2),))
    end = count * dofs
    poses, log_likelihood, residual = values[:end], values[end : end + count], values[end + count :]
    check_range("the reply's poses", poses, -LARGEST, LARGEST)
    explained = log_likelihood[log_likelihood != -np.inf]
    check_range("the reply's log_likelihood", explained, -LARGEST_LOG_LIKELIHOOD, LARGEST_LOG_LIKELIHOOD)
    check_range("the reply's residual", residual, 0.0, np.inf)
    roots = None
    if message.covariance_roots is not None:  # no deviation is above 1 m or rad
        packed, what = (count, triangle_size(dofs)), "the reply's covariance_roots"
        roots = unpack(what, message.covariance_roots, "<f4", packed, -1.0, 1.0)
        if not np.all(roots[:, np.cumsum(np.arange(1, dofs + 1)) - 1] > 0.0):
            raise ProtocolError(f"{what} must have positive diagonals")
    return Refined(poses.reshape(shape), log_likelihood, residual, roots), message.waited_s


def encode_refusal(reason: str, *, retryable: bool = False) -> bytes:
    """Encode the reason why a request cannot be served."""
    return encode(RefusalMessage(reason=reason[:1000], retryable=retryable))


def decode_refusal(payload: bytes) -> RefusalMessage:
    """A refusal, its reason without control characters, or ProtocolError."""
    refusal = decode(payload, RefusalMessage)
    plain = "".join(letter if letter.isprintable() else " " for letter in refusal.reason)
    return RefusalMessage(reason=plain, retryable=refusal.retryable)
