"""Messages are decoded to what was encoded; all else is refused with an error of our own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import msgpack  # type: ignore[import-untyped]
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from examples import live_publisher
from gepf.common.errors import ProtocolError
from gepf.common.frame import EMPTY, SUBJECT, UNMEASURED, SubjectView
from gepf.common.protocol import messages
from gepf.common.protocol.frames import decode_frame, decode_live, encode_frame
from gepf.common.protocol.models import decode_model, encode_model
from gepf.common.refinement import PosePrior
from gepf.worker.warm_up import tiny_frame, tiny_model
from tests.support.answers import sure
from tests.support.messages import COUNT, DOFS, KINDS, POSES, tiny_refined, tiny_request, tiny_sure

NAMES = {"sure-reply": "reply"}  # of messages on the wire, where that is not the name of the case


def changed(kind: str, change: Callable[[dict[str, Any]], object]) -> bytes:
    """The example of a kind with a change, written by another library than ours."""
    content = msgpack.unpackb(KINDS[kind].payload, strict_map_key=False)
    change(content)
    return bytes(msgpack.packb(content))


def refuse(kind: str, payload: bytes, match: str) -> None:
    """The payload must be refused with these words."""
    with pytest.raises(ProtocolError, match=match):
        KINDS[kind].decode(payload)


def set_to(*path: str | int, value: object) -> Callable[[dict[str, Any]], None]:
    """A change of one value."""

    def change(content: Any) -> None:
        for step in path[:-1]:
            content = content[step]
        content[path[-1]] = value

    return change


def packed(array: NDArray[Any]) -> list[object]:
    """An array as it travels."""
    return [array.dtype.str, list(array.shape), array.tobytes()]


def roots(diagonal: float, beside: float = 0.0) -> Callable[[dict[str, Any]], None]:
    """A change of those of a sure reply, the last with this on its diagonal and left of that."""
    changed_roots = sure(POSES)
    changed_roots[-1, -2:] = beside, diagonal
    return set_to("covariance_roots", value=packed(changed_roots))


DIAGONAL = PosePrior(POSES[0], np.linspace(0.0, 1e6, DOFS))
DENSE = PosePrior(POSES[0], np.eye(DOFS) + 0.5)


def with_prior(prior: PosePrior) -> messages.RefineRequest:
    """The tiny request with a prior."""
    return replace(tiny_request(), particles=replace(tiny_request().particles, prior=prior))


def of_prior(name: str, array: NDArray[Any]) -> Callable[[dict[str, Any]], None]:
    """A change of an array of the prior."""
    return set_to("prior", name, value=packed(array))


def same(one: object, other: object) -> bool:
    """Equal in all fields, arrays by type and bytes."""
    for field in fields(one):  # type: ignore[arg-type]
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            if (a.dtype, a.shape, a.tobytes()) != (b.dtype, b.shape, b.tobytes()):
                return False
        elif field.name == "views":
            if len(a) != len(b) or not all(map(same, a, b)):
                return False
        elif not (same(a, b) if hasattr(a, "__dataclass_fields__") else a == b):
            return False
    return True


FRAME = tiny_frame()
(SEEN,) = FRAME.views
COVARIANCES = replace(tiny_request().particles, covariance=True)
KEYPOINTS_SEEN = np.random.default_rng(0).uniform(0.0, 9.0, (17, 3)).astype(np.float32)
KINDS_OF_PIXELS = np.where(SEEN.image.depth > 0, SUBJECT, EMPTY).astype(np.uint8)
BESIDE_ALL = SubjectView(  # a crop that lies outside of the image and has no picked pixel
    replace(
        SEEN.image,
        depth=np.zeros((32, 32), np.uint16),
        intrinsics=msgspec.structs.replace(SEEN.image.intrinsics, cx=-100.0),
    ),
    np.zeros(0, np.uint32),
    (-50, -60, 10, 0),
)


LATER = replace(BESIDE_ALL, image=replace(BESIDE_ALL.image, time_s=0.01), delay_s=0.01)


@pytest.mark.parametrize(
    ("sent", "encode", "decode"),
    [
        (FRAME, encode_frame, decode_frame),
        (replace(FRAME, views=(replace(SEEN, labels=KINDS_OF_PIXELS),)), encode_frame, decode_frame),
        (replace(FRAME, views=(BESIDE_ALL,)), encode_frame, decode_frame),
        (replace(FRAME, views=(replace(SEEN, keypoints=KEYPOINTS_SEEN),)), encode_frame, decode_frame),
        (replace(FRAME, views=(SEEN, LATER)), encode_frame, decode_frame),
        (tiny_model(), encode_model, decode_model),
        (tiny_request(), messages.encode_request, messages.decode_request),
        (replace(tiny_request(), particles=COVARIANCES), messages.encode_request, messages.decode_request),
        *[
            (with_prior(prior), messages.encode_request, messages.decode_request)
            for prior in (DIAGONAL, DENSE, replace(DENSE, mean=POSES))
        ],
        (tiny_refined(), messages.encode_refined, KINDS["reply"].decode),
        (tiny_sure(), messages.encode_refined, KINDS["sure-reply"].decode),
    ],
)
def test_what_goes_in_comes_out(
    sent: object, encode: Callable[[Any], bytes], decode: Callable[[bytes], object]
) -> None:
    """All fields arrive as they were."""
    assert same(sent, decode(encode(sent)))


def test_covariances_come_where_they_are_requested_and_only_there() -> None:
    """A reply that holds more than was requested is refused, and one that holds less."""
    refuse("sure-reply", KINDS["reply"].payload, "the reply lacks covariance_roots")
    refuse("reply", KINDS["sure-reply"].payload, "the reply has covariance_roots")


def test_reply_may_be_infinite_but_for_its_poses() -> None:
    """A particle that nothing was observed of has no likelihood; a pose that is no pose is refused."""
    refined = tiny_refined()
    refined.log_likelihood[0] = -np.inf
    received, _ = messages.decode_refined(messages.encode_refined(refined), (COUNT, DOFS))
    assert received.log_likelihood[0] == -np.inf
    refined.poses[0, 0] = np.inf
    refuse("reply", messages.encode_refined(refined), "poses must be -100000 to 100000, not ")


def test_refusal_holds_nothing_that_a_terminal_acts_on() -> None:
    """The reason of an unknown peer is shown as plain text, shortened if it is too long."""
    assert len(messages.encode_refusal("x" * 5000)) < 2000
    assert (
        messages.decode_refusal(messages.encode_refusal("no\x1b[2J\r\nmore\u202e")).reason == "no [2J  more "
    )


@pytest.mark.parametrize("kind", KINDS)
def test_another_version_another_kind_and_unknown_fields_are_refused(kind: str) -> None:
    """Both versions are named; a message of another kind is not taken for it; unknown fields are refused."""
    own: int = msgpack.unpackb(KINDS[kind].payload, strict_map_key=False)["version"]
    newer, other = set_to("version", value=own + 1), "request" if kind == "refusal" else "refusal"
    refuse(kind, changed(kind, newer), f"protocol version {own + 1}, expected {own}")
    refuse(kind, changed(other, set_to("version", value=own)), f"not a .*{NAMES.get(kind, kind)}.* message")
    refuse(kind, changed(kind, set_to("surprise", value=1)), "surprise")


def test_the_example_speaks_as_documented_and_is_understood() -> None:
    """The live message has its own version, independent of that of coordinator and workers."""
    table = (Path(__file__).parents[2] / "docs" / "live.md").read_text()
    assert "| `version` | integer | 1 |" in table
    depth = np.full((2, 3), 1500, np.uint16)
    frame = decode_live(live_publisher.message(7, 0.25, depth))
    assert frame is not None
    assert (frame.number, frame.time_s, frame.depth_scale) == (7, 0.25, 1000.0)
    np.testing.assert_array_equal(frame.depth, depth)
    assert decode_live(live_publisher.END) is None
    assert all(f"| `{name}`" in table for name in msgpack.unpackb(live_publisher.message(7, 0.25, depth)))


def test_too_large_is_refused_unread() -> None:
    """A message above the size limit is refused before it is decoded."""
    refuse("frame", bytes(2**27), "134217728 bytes is above the limit of")


def of_view(name: str, value: object) -> Callable[[dict[str, Any]], None]:
    """A change of the first camera's part of a frame."""
    return set_to("views", 0, name, value=packed(value) if isinstance(value, np.ndarray) else value)


def of_model(name: str, array: NDArray[Any]) -> Callable[[dict[str, Any]], None]:
    """A change of one of a model's arrays."""
    return set_to("arrays", name, value=packed(array))


def of_settings(name: str, value: object) -> Callable[[dict[str, Any]], None]:
    """A change of a setting."""
    return set_to("settings", name, value=value)


def no_columns(content: dict[str, Any]) -> None:
    """Let a frame be of no width."""
    content["views"][0]["intrinsics"].update(width=0)
    content["views"][0].update(depth=["<u2", [32, 0], b""])


MANY = {str(k): "" for k in range(51)}
KINDS_5 = np.full((32, 32), UNMEASURED + 1, np.uint8)
MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0])
INFINITE = packed(np.repeat([0.0, np.inf, 0.1], [COUNT * DOFS, COUNT, COUNT]))
NEGATIVE = packed(np.repeat([0.0, -1.0, -1.0], [COUNT * DOFS, COUNT, COUNT]))
CONTRARY = np.tile([1.0, -1.0], (6, 1))

BAD = [  # kind, fault, what is said
    ("request", set_to("poses", 2, value=b"123"), "has 3 bytes, expected 144"),
    ("request", set_to("poses", 1, value=[-3, -6]), "Expected `int` >= 0"),
    ("request", set_to("poses", 0, value="|O"), "Invalid enum value '|O'"),
    ("request", set_to("poses", value=packed(POSES * np.nan)), "poses must be .*not nan"),
    ("request", set_to("run", value="a/**"), "matching regex"),
    ("request", set_to("model", value="abc"), "matching regex"),
    ("request", of_settings("icp_iterations", 10**9), "icp_iterations must be 0 to 100, not 1000000000"),
    ("request", of_settings("descent", "fast"), "Invalid enum value 'fast'"),
    ("request", of_settings("noise_depth", 0.0), "noise_depth must be .*not 0"),
    ("request", of_prior("mean", POSES[:, :2]), r"mean has shape \(3, 2\), expected \(3, 6\)"),
    ("request", of_prior("mean", POSES[0] * np.inf), "the prior's mean must be -100000 to 100000"),
    ("request", of_prior("precision", np.eye(DOFS)[:2]), r"precision has shape \(2, 6\), expected \(6, 6\)"),
    ("request", of_prior("precision", -np.ones(DOFS)), "precision must be 0 to 1e.12, not -1"),
    ("request", of_prior("precision", np.full((DOFS, DOFS), np.nan)), "precision must be .*not nan"),
    ("request", of_prior("precision", np.tri(DOFS)), "precision is not symmetric"),
    ("request", of_prior("precision", np.eye(DOFS) - 0.5), "precision is not positive semidefinite"),
    ("frame", of_view("picked", np.array([5000], np.uint32)), "picked must be 0 to 1023, not 5000"),
    ("frame", of_view("picked", np.array([5, 5], np.uint32)), "ascending order"),
    ("frame", set_to("views", 0, "intrinsics", "width", value=31), r"expected \(32, 31\)"),
    ("frame", set_to("views", 0, "intrinsics", "fx", value=0.0), "focal lengths must be .* not 0"),
    ("frame", of_view("kinds", KINDS_5), "kinds must be 0 to 4, not 5"),
    ("frame", of_view("kinds", np.full((32, 32), EMPTY, np.uint8)), "kinds and depth"),
    ("frame", of_view("T_rig_camera", MIRRORED), "T_rig_camera is not a rotation"),
    ("frame", of_view("view", [3, 0, 2, 9]), "ends before it begins"),
    ("frame", no_columns, "a frame has 1 to 8388608 pixels, not 0 by 32"),
    ("model", of_model("triangles", np.full((4, 3), 4)), "triangles must be 0 to 3, not 4"),
    ("model", of_model("skin_links", np.full((4, 1), -1)), "skin_links must be 0"),
    ("model", of_model("balls", np.array([4])), "balls must be in"),
    ("model", of_model("parents", np.arange(6)), "contradicts itself: .*parent"),
    ("model", of_model("vertices", np.ones((4, 3))), "names the hash"),
    ("model", of_model("limits", CONTRARY), "no room"),
    ("model", lambda content: content["arrays"].pop("axes"), r"lacks fields \['axes'\]"),
    ("model", set_to("texts", value=MANY), "Expected `object` of length <= 50"),
    ("reply", set_to("values", value=INFINITE), "log_likelihood must be .*not inf"),
    ("reply", set_to("values", value=packed(np.zeros(16))), r"expected \(24\)"),
    ("reply", set_to("values", value=NEGATIVE), "residual must be 0 to inf, not -1"),
    ("sure-reply", roots(np.nan), "covariance_roots must be -1 to 1, not nan"),
    ("sure-reply", roots(0.0), "must have positive diagonals"),
    ("sure-reply", roots(0.1, 3.0), "covariance_roots must be -1 to 1, not 0 to 3"),
]


@pytest.mark.parametrize(("kind", "change", "match"), BAD, ids=range(len(BAD)))
def test_nonsense_is_refused_and_named(
    kind: str, change: Callable[[dict[str, Any]], object], match: str
) -> None:
    """Each fault is refused with a message that says what is wrong."""
    refuse(kind, changed(kind, change), match)
