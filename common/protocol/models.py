"""Messages with body models, identified by the hash of their content."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any

import msgspec
import numpy as np

from gepf.common.body import SHAPE, TRANSLATION, BodyModel
from gepf.common.bounds import LARGEST, MAX_DOFS
from gepf.common.errors import ProtocolError
from gepf.common.protocol.wire import Array, Dims, Hash, Message, decode, encode, pack, unpack

Name = Annotated[str, msgspec.Meta(max_length=200)]
Names = Annotated[tuple[Name, ...], msgspec.Meta(max_length=10_000)]
FEW = msgspec.Meta(max_length=50)  # fields of a map

# Arrays of a model: type, extents, smallest and largest value. As the largest value, a letter means the last
# index below that extent. Extents that are not numbers of names are set by the first array that has them.
MODEL_ARRAYS: dict[str, tuple[str, Dims, float, float | str]] = {
    "kinds": ("<i8", ("D",), TRANSLATION, SHAPE),
    "parents": ("<i8", ("D",), -1, "D"),
    "axes": ("<f8", ("D", 3), -LARGEST, LARGEST),
    "points": ("<f8", ("D", 3), -LARGEST, LARGEST),
    "limits": ("<f8", ("D", 2), -np.inf, np.inf),
    "rest_spreads": ("<f8", ("D",), -LARGEST, LARGEST),
    "balls": ("<i8", ("B",), 0, "D"),
    "link_dofs": ("<i8", ("L",), -1, "D"),
    "vertices": ("<f8", ("V", 3), -LARGEST, LARGEST),
    "triangles": ("<i8", ("T", 3), 0, "V"),
    "skin_links": ("<i8", ("V", "K"), 0, "L"),
    "skin_weights": ("<f8", ("V", "K"), -LARGEST, LARGEST),
    "joint_links": ("<i8", ("J",), 0, "L"),
    "joint_points": ("<f8", ("J", 3), -LARGEST, LARGEST),
    "keypoint_links": ("<i8", ("P",), 0, "L"),
    "keypoint_vertices": ("<i8", ("P", "W"), 0, "V"),
    "keypoint_shares": ("<f8", ("P", "W"), -LARGEST, LARGEST),
    "shape_vertices": ("<f8", ("S", "V", 3), -LARGEST, LARGEST),
    "shape_points": ("<f8", ("S", "D", 3), -LARGEST, LARGEST),
    "shape_joint_points": ("<f8", ("S", "J", 3), -LARGEST, LARGEST),
}


class ModelMessage(Message, frozen=True, tag="model"):
    """A BodyModel: its texts, lists of names and arrays by field."""

    hash: Hash
    texts: Annotated[dict[str, Name], FEW]
    names: Annotated[dict[str, Names], FEW]
    arrays: Annotated[dict[str, Array], FEW]


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
    """A model whose content has the hash in the message, or ProtocolError."""
    message = decode(payload, ModelMessage)
    values: dict[str, Any] = {**message.texts, **message.names, **message.arrays}
    if len(values) < len(message.texts) + len(message.names) + len(message.arrays):
        raise ProtocolError("the model has a field twice")
    expected = {field.name for field in fields(BodyModel)}
    if values.keys() != expected:
        missing, unknown = sorted(expected - values.keys()), sorted(values.keys() - expected)
        raise ProtocolError(f"the model lacks fields {missing} and has unknown fields {unknown[:10]}")
    extents = {
        letter: len(message.names.get(name, ()))
        for letter, name in (("D", "dof_names"), ("L", "link_names"), ("J", "joint_names"))
    }
    if not message.arrays.keys() == MODEL_ARRAYS.keys():
        raise ProtocolError("the model does not have the expected arrays")
    for name, (dtype, dims, least, most) in MODEL_ARRAYS.items():
        values[name] = unpack(f"the model's {name}", message.arrays[name], dtype, dims, least, most, extents)
    try:
        check_model(values, extents)
        model = BodyModel(**values)
    except (ValueError, TypeError, KeyError) as error:
        raise ProtocolError(f"the model contradicts itself: {error}") from error
    if model.hash != message.hash:
        raise ProtocolError(f"the model names the hash {message.hash}, but its content has {model.hash}")
    return model


def check_model(arrays: dict[str, Any], extents: dict[str, int]) -> None:
    """ProtocolError if a requirement of the kernels is violated, or limits or balls are invalid."""
    for letter, what in (("D", "degrees of freedom"), ("L", "links"), ("V", "vertices"), ("K", "skin links")):
        if extents[letter] == 0:
            raise ProtocolError(f"the model has no {what}")
    if extents["D"] > MAX_DOFS:
        raise ProtocolError(f"the model has {extents['D']} degrees of freedom, expected at most {MAX_DOFS}")
    lower, upper = arrays["limits"].T
    if np.any(lower > upper) or np.any(lower > LARGEST) or np.any(upper < -LARGEST):
        raise ProtocolError("the model's limits leave no room between them")
    if np.any(np.diff(arrays["balls"], append=extents["D"]) < 3):
        raise ProtocolError("the model's balls must be in ascending order and must not overlap")
