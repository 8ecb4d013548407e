"""What crosses the wire: msgpack maps with a protocol version, limited in size, checked on arrival.

Every decoder raises ProtocolError, and its message says what is wrong. Nothing is unpickled or evaluated.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.errors import ProtocolError
from common.frame import SUBJECT, UNMEASURED, DepthFrame, SubjectFrame
from common.protocol.arrays import Dims, check_finite, check_indices, pack, unpack
from common.protocol.checks import (
    check_camera,
    check_covariance_roots,
    check_model,
    check_poses,
    check_refined,
    check_reply,
    check_settings,
    check_sizes,
)
from common.protocol.wire import (
    MAX_REASON,
    FrameMessage,
    LiveEndMessage,
    LiveFrameMessage,
    ModelMessage,
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

# Of the arrays of a model; a field that is not named here is checked less closely.
MODEL_ARRAYS: dict[str, tuple[str, Dims]] = {
    "kinds": ("<i8", ("D",)),
    "parents": ("<i8", ("D",)),
    "axes": ("<f8", ("D", 3)),
    "points": ("<f8", ("D", 3)),
    "limits": ("<f8", ("D", 2)),
    "rest_spreads": ("<f8", ("D",)),
    "balls": ("<i8", ("B",)),
    "link_dofs": ("<i8", ("L",)),
    "vertices": ("<f8", ("V", 3)),
    "triangles": ("<i8", ("T", 3)),
    "skin_links": ("<i8", ("V", "K")),
    "skin_weights": ("<f8", ("V", "K")),
    "joint_links": ("<i8", ("J",)),
    "joint_points": ("<f8", ("J", 3)),
}


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


def encode_frame(subject: SubjectFrame) -> bytes:
    """A frame for the workers."""
    frame = subject.frame
    message = FrameMessage(
        number=frame.number,
        time_s=frame.time_s,
        depth_scale=frame.depth_scale,
        intrinsics=frame.intrinsics,
        depth=pack(frame.depth),
        picked=pack(subject.picked),
        view=subject.view,
        kinds=None if subject.kinds is None else pack(subject.kinds),
        emptiness=subject.emptiness,
    )
    return encode(message)


def decode_frame(payload: bytes) -> SubjectFrame:
    """A frame, or ProtocolError."""
    message = decode(payload, FrameMessage)
    frame = depth_frame(message)
    picked = unpack("picked", message.picked, "<u4", ("P",), {})
    check_picked(picked, frame.depth)
    left, top, right, bottom = message.view
    if left > right or top > bottom:
        raise ProtocolError(f"view {message.view} ends before it begins")
    if not 0.0 <= message.emptiness <= 1.0:
        raise ProtocolError(f"an emptiness of {message.emptiness} is not between 0 and 1")
    kinds = None
    if message.kinds is not None:
        kinds = unpack("kinds", message.kinds, "|u1", frame.depth.shape, {})
        check_kinds(kinds, frame.depth)
    return SubjectFrame(frame, picked, message.view, kinds, message.emptiness)


def check_kinds(kinds: NDArray[np.uint8], depth: NDArray[np.uint16]) -> None:
    """ProtocolError unless these are kinds of pixels, the subject's those with depth."""
    if kinds.size and kinds.max() > UNMEASURED:
        raise ProtocolError(f"kinds go up to {kinds.max()}, not {UNMEASURED}")
    if not np.array_equal(kinds == SUBJECT, depth > 0):
        raise ProtocolError("kinds and depth differ in what is the subject's")


def check_picked(picked: NDArray[np.uint32], depth: NDArray[np.uint16]) -> None:
    """ProtocolError unless these are pixels with depth, in ascending order."""
    if np.any(picked[1:] <= picked[:-1]):
        raise ProtocolError("picked must be in ascending order")
    check_indices("picked", picked[-1:], 0, depth.size)  # and so all of them
    if not np.all(depth.ravel()[picked]):
        raise ProtocolError("picked points at pixels without depth")


def encode_live(frame: DepthFrame) -> bytes:
    """A whole depth image for whoever tracks."""
    message = LiveFrameMessage(
        number=frame.number,
        time_s=frame.time_s,
        depth_scale=frame.depth_scale,
        intrinsics=frame.intrinsics,
        depth=pack(frame.depth),
    )
    return encode(message)


def encode_live_end() -> bytes:
    """The end of a stream of depth images."""
    return encode(LiveEndMessage())


def decode_live(payload: bytes) -> DepthFrame | None:
    """A whole depth image, None at the end of the stream, or ProtocolError."""
    message = decode(payload, LiveFrameMessage, LiveEndMessage)
    return depth_frame(message) if isinstance(message, LiveFrameMessage) else None


def depth_frame(message: FrameMessage | LiveFrameMessage) -> DepthFrame:
    """The depth image in a message, of the size that its camera has."""
    camera = message.intrinsics
    check_camera(camera, message.depth_scale)
    check_finite("the frame's time", message.time_s)
    depth = unpack("depth", message.depth, "<u2", (camera.height, camera.width), {})
    return DepthFrame(message.number, message.time_s, depth, message.depth_scale, camera)


def encode_model(model: BodyModel) -> bytes:
    """A model for the workers, with its hash."""
    values = {field.name: getattr(model, field.name) for field in fields(model)}
    message = ModelMessage(
        hash=model.hash,
        texts={name: value for name, value in values.items() if isinstance(value, str)},
        names={name: value for name, value in values.items() if isinstance(value, tuple)},
        arrays={name: pack(value) for name, value in values.items() if isinstance(value, np.ndarray)},
    )
    return encode(message)


def decode_model(payload: bytes) -> BodyModel:
    """A model whose content has the hash that it names, or ProtocolError."""
    message = decode(payload, ModelMessage)
    values = {**message.texts, **message.names, **message.arrays}
    if len(values) < len(message.texts) + len(message.names) + len(message.arrays):
        raise ProtocolError("the model has a field twice")
    check_fields("model", values.keys(), {field.name for field in fields(BodyModel)})
    sizes = {
        letter: len(message.names.get(name, ()))
        for letter, name in (("D", "dof_names"), ("L", "link_names"), ("J", "joint_names"))
    }
    for name, array in message.arrays.items():
        dtype, dims = MODEL_ARRAYS.get(name, (array.dtype, array.shape))
        values[name] = unpack(f"the model's {name}", array, dtype, dims, sizes)
    try:
        check_model({name: v for name, v in values.items() if isinstance(v, np.ndarray)}, sizes)
        model = BodyModel(**values)  # type: ignore[arg-type]
    except (ValueError, TypeError, KeyError) as error:
        raise ProtocolError(f"the model contradicts itself: {error}") from error
    if model.hash != message.hash:
        raise ProtocolError(f"the model names the hash {message.hash} and has {model.hash}")
    return model


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


def check_fields(what: str, given: AbstractSet[str], expected: AbstractSet[str]) -> None:
    """ProtocolError that names missing and unknown fields."""
    if given != expected:
        missing, unknown = sorted(expected - given), sorted(given - expected)
        raise ProtocolError(f"the {what} lacks fields {missing} and has unknown fields {unknown[:10]}")
