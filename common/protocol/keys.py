"""Key expressions on the bus.

Keys of a worker, below `gepf/worker/<worker>/`:

    refine      queryable: a batch of particles in, refined particles out
    lanes/<n>   liveliness token: number of particles that it refines in parallel; declared before `alive`
    alive       liveliness token, declared last, when the worker is ready
    admission   liveliness token by which a worker finds out whether its certificate allows its name

Keys of a run, below `gepf/run/<run>/`:

    frame       published frames
    frame/<n>   queryable: one frame, for workers that missed its publication
    model/<h>   queryable: one model by the hash of its content
    alive       liveliness token of the coordinator
    present     queryable with an empty answer: a token may exist longer than its run
"""

from __future__ import annotations

import re

from gepf.common.errors import InputError

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
GUARDED = "gepf/live/"
STREAM = re.compile(rf"{NAME.pattern}(/{NAME.pattern}){{0,15}}")

ALL_RUNS = "gepf/run/**"


def of_worker(worker: str, what: str) -> str:
    """A key of a worker; `*` for any worker."""
    return f"gepf/worker/{worker}/{what}"


def of_run(run: str, what: str) -> str:
    """A key of a run; `*` for any run."""
    return f"gepf/run/{run}/{what}"


def owner_of(key: str) -> str:
    """The worker or run that a key belongs to."""
    return key.split("/")[2]


def last_of(key: str) -> str:
    """The last part of a key: a frame's number, a model's hash or a number of lanes."""
    return key.rsplit("/", 1)[1]


def lanes_of(key: str) -> int:
    """The number of lanes in a worker's token; 1 if it is invalid."""
    number = last_of(key)
    return max(1, int(number)) if re.fullmatch("[0-9]{1,4}", number) else 1


def check_name(kind: str, name: str) -> str:
    """The name of a worker or run, if it can be part of a key; InputError otherwise."""
    if not NAME.fullmatch(name):
        raise InputError(f"{kind} '{name}' cannot be used; give up to 64 letters, digits and . - _")
    return name


def check_stream(key: str, *, guarded: bool = False) -> str:
    """The key of a stream of depth images, if it has no wildcards; InputError otherwise.

    With access control it must be below `gepf/live/`: everything else is dropped without a message.
    """
    if not STREAM.fullmatch(key):
        names = "names of letters, digits and . - _ between slashes, such as camera/depth"
        raise InputError(f"key '{key}' cannot be used; give {names}")
    if guarded and not key.startswith(GUARDED):
        raise InputError(f"with certificates only keys of gepf are allowed; use {GUARDED}{key}")
    return key
