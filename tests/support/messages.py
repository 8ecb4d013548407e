"""Every kind of message with an example, and a mutator that makes hostile messages of honest ones."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import msgpack  # type: ignore[import-untyped]
import numpy as np

from gepf.common.protocol import messages
from gepf.common.protocol.frames import LIVE_END, decode_frame, decode_live, encode_frame, encode_live
from gepf.common.protocol.models import decode_model, encode_model
from gepf.common.refinement import Particles, PosePrior, Refined
from gepf.common.settings import RefineSettings
from gepf.worker.warm_up import tiny_frame, tiny_model
from tests.support.answers import sure

COUNT, DOFS = 3, 6
POSES = np.linspace(-1.0, 1.0, COUNT * DOFS).reshape(COUNT, DOFS)


def tiny_request() -> messages.RefineRequest:
    """A request as a coordinator sends it."""
    prior = PosePrior(POSES, np.eye(DOFS))
    particles = Particles(POSES, RefineSettings(damping=0.25), prior=prior)
    return messages.RefineRequest("room-1/run-1", 7, tiny_model().hash, particles)


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
    "live-frame": Kind(encode_live(tiny_frame().largest.image), decode_live),
    "live-end": Kind(LIVE_END, decode_live),
    "model": Kind(encode_model(tiny_model()), decode_model),
    "request": Kind(messages.encode_request(tiny_request()), messages.decode_request),
    "reply": Kind(
        messages.encode_refined(tiny_refined()),
        lambda payload: messages.decode_refined(payload, (COUNT, DOFS))[0],
    ),
    "sure-reply": Kind(
        messages.encode_refined(tiny_sure()),
        lambda payload: messages.decode_refined(payload, (COUNT, DOFS), covariance=True)[0],
    ),
    "refusal": Kind(messages.encode_refusal("no"), messages.decode_refusal),
}


INTEGERS = (0, 1, -1, 2**7, 2**31 - 1, -(2**31), 2**53, 2**63 - 1, 2**64 - 1)
FLOATS = (0.0, -0.0, 1e-320, 1e-300, -1.0, 1e6, 1e300, float("inf"), float("-inf"), float("nan"))
TEXTS = ("", "*", "**", "a/b", "\x00", "é" * 40, "<f8", "|O", "<f4", "x" * 300, "gepf", "__class__")
HUGE = (b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xdb\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff")


T = TypeVar("T")


class Mutator:
    """Makes hostile messages of honest ones; the same seed makes the same ones."""

    def __init__(self, seed: int, others: Sequence[bytes]) -> None:
        self._others = others
        self._rng = random.Random(seed)

    def mutate(self, payload: bytes) -> bytes:
        """A message, mutated once or a few times."""
        for _ in range(self._rng.randrange(1, 4)):
            payload = self._one_of((self._splice, self._alter))(payload)
        return payload

    def _splice(self, payload: bytes) -> bytes:
        """Replace some bytes, mostly near the beginning, where the structure is; or the whole rest."""
        other = self._one_of(self._others)
        start, end = sorted(self._rng.randint(0, len(other)) for _ in range(2))
        deep = self._one_of((b"\x91", b"\x81\xa1x")) * self._rng.randrange(1, 20_000)
        piece = self._one_of((other[start:end], self._one_of(HUGE), deep, self._rng.randbytes(1), b""))
        at = self._rng.randint(0, self._one_of((len(payload), min(len(payload), 400))))
        rest = payload[at + self._one_of((0, len(piece), self._rng.randrange(40))) :]
        return payload[:at] + piece + self._one_of((rest, rest, rest, b""))

    def _alter(self, payload: bytes) -> bytes:
        """Change a value of a message that stays well formed: another type, size, shape or number."""
        try:
            content = msgpack.unpackb(payload, strict_map_key=False)
            holder, key = self._one_of(list(places_of(content)))
            holder[key] = self._other(holder[key])
            return bytes(msgpack.packb(content))
        except (ValueError, TypeError, IndexError, RecursionError):  # it has been mutated before
            return self._splice(payload)

    def _other(self, value: Any) -> object:
        """Another value, mostly of the same type."""
        if self._rng.random() < 0.15 or value is None:
            return self._one_of((None, True, [], {}, b"", "", 0, 0.5, [1, 2], {"a": 1}, b"\x00" * 24))
        choices: Sequence[object] = (0,)
        match value:
            case bytes():
                choices = (self._other_bytes(value),)
            case int():
                choices = (*INTEGERS, max(value - 1, -(2**63)), min(value + 1, 2**64 - 1))
            case float():
                choices = (*FLOATS, value * 1e3, -value)
            case str():
                choices = (*TEXTS, value + "x", value[:-1])
            case list():
                choices = (value[:-1], value + value[:1])
            case dict():  # a field less, or one more
                choices = (dict([*value.items()][1:]), {**value, self._one_of(TEXTS): 0})
        return self._one_of(choices)

    def _other_bytes(self, value: bytes) -> bytes:
        """An array's bytes with a number in it that is none, or huge, or an index beyond."""
        numbers = struct.pack("<d", self._one_of(FLOATS)), struct.pack("<Q", self._one_of(INTEGERS) % 2**64)
        at = 8 * self._rng.randrange(max(1, len(value) // 8))
        changed = value[:at] + self._one_of(numbers) + value[at + 8 :]
        return changed[: len(value)] if self._rng.random() < 0.9 else changed + numbers[0]

    def _one_of(self, choices: Sequence[T]) -> T:
        return self._rng.choice(choices)


def places_of(content: Any) -> Iterator[tuple[Any, Any]]:
    """Every (holder, key) within lists and maps, so that holder[key] is a value."""
    items = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in list(items):
        yield content, key
        if isinstance(value, dict | list):
            yield from places_of(value)
