"""Body models as they cross the wire, by the hash of their content."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import fields

import numpy as np

from common.body import BodyModel
from common.errors import ProtocolError
from common.protocol.arrays import Dims, pack, unpack
from common.protocol.checks import check_model
from common.protocol.wire import ModelMessage, decode, encode

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


def check_fields(what: str, given: AbstractSet[str], expected: AbstractSet[str]) -> None:
    """ProtocolError that names missing and unknown fields."""
    if given != expected:
        missing, unknown = sorted(expected - given), sorted(given - expected)
        raise ProtocolError(f"the {what} lacks fields {missing} and has unknown fields {unknown[:10]}")
