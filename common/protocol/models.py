"""Body models on the wire, by the hash of their content."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, TRANSLATION, BodyModel
from common.bounds import LARGEST_LENGTH, LARGEST_POSE, MAX_DOFS
from common.errors import ProtocolError
from common.protocol.wire import (
    Array,
    Dims,
    Hash,
    Message,
    check_indices,
    check_magnitude,
    check_numbers,
    decode,
    encode,
    pack,
    unpack,
)

Name = Annotated[str, msgspec.Meta(max_length=200)]
Names = Annotated[tuple[Name, ...], msgspec.Meta(max_length=10_000)]
FEW = msgspec.Meta(max_length=50)  # fields of a map

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
    """A model whose content has the hash that it names, or ProtocolError."""
    message = decode(payload, ModelMessage)
    values = {**message.texts, **message.names, **message.arrays}
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
    for name, array in message.arrays.items():
        dtype, dims = MODEL_ARRAYS.get(name, (array.dtype, array.shape))
        values[name] = unpack(f"the model's {name}", array, dtype, dims, extents)
    try:
        check_model({name: v for name, v in values.items() if isinstance(v, np.ndarray)}, extents)
        model = BodyModel(**values)  # type: ignore[arg-type]
    except (ValueError, TypeError, KeyError) as error:
        raise ProtocolError(f"the model contradicts itself: {error}") from error
    if model.hash != message.hash:
        raise ProtocolError(f"the model names the hash {message.hash} and has {model.hash}")
    return model


def check_model(arrays: dict[str, NDArray[Any]], extents: dict[str, int]) -> None:
    """ProtocolError where an index would leave its array, or a number is none or beyond computing with."""
    for letter, what in (("D", "degrees of freedom"), ("L", "links"), ("V", "vertices"), ("K", "skin links")):
        if extents[letter] == 0:
            raise ProtocolError(f"the model has no {what}")
    dofs = extents["D"]
    if dofs > MAX_DOFS:
        raise ProtocolError(f"the model has {dofs} degrees of freedom, expected at most {MAX_DOFS}")
    for name, array in arrays.items():
        check_numbers(f"the model's {name}", array)
        if array.dtype.kind == "f" and name != "limits":
            check_magnitude(f"the model's {name}", array, LARGEST_LENGTH)
    lower, upper = arrays["limits"].T
    if np.any(lower > upper) or np.any(lower > LARGEST_POSE) or np.any(upper < -LARGEST_POSE):
        raise ProtocolError("the model's limits leave no room between them")
    ranges = {
        "kinds": (TRANSLATION, ROTATION + 1),
        "parents": (-1, dofs),
        "balls": (0, dofs - 2),
        "link_dofs": (-1, dofs),
        "triangles": (0, extents["V"]),
        "skin_links": (0, extents["L"]),
        "joint_links": (0, extents["L"]),
    }
    for name, (least, end) in ranges.items():
        check_indices(f"the model's {name}", arrays[name], least, end)
    if np.any(np.diff(arrays["balls"]) < 3):
        raise ProtocolError("the model's balls must be in ascending order and share nothing")
