"""Key expressions: where on the bus things are found."""

from __future__ import annotations

import re

from common.errors import InputError

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
GUARDED = "gepf/live/"
STREAM = re.compile(rf"{NAME.pattern}(/{NAME.pattern}){{0,15}}")

ANY_WORKER_ALIVE = "gepf/worker/*/alive"
ANY_WORKER_LANES = "gepf/worker/*/lanes/*"
ANY_RUN_FRAMES = "gepf/run/*/frame"
ANY_RUN_ALIVE = "gepf/run/*/alive"
ANY_RUN_PRESENT = "gepf/run/*/present"

# For access rules: a wildcard does not stand for what begins with @, where late joiners find history.
HISTORY = "gepf/run/*/frame/@adv/**"
ALL = ("gepf/**", HISTORY)
READABLE = (
    ANY_RUN_ALIVE,
    ANY_RUN_PRESENT,
    "gepf/run/*/frame",
    "gepf/run/*/frame/*",
    "gepf/run/*/model/*",
    HISTORY,
)


def check_name(kind: str, name: str) -> str:
    """A worker's or run's name, if it can be part of a key; InputError otherwise."""
    if not NAME.fullmatch(name):
        raise InputError(
            f"{kind} '{name}' cannot be used; give at most 64 letters, digits, dots, dashes and underscores"
        )
    return name


def check_stream(key: str, *, guarded: bool = False) -> str:
    """The key of a stream of depth images, if it names one place; InputError otherwise.

    Where access is guarded it must be one of ours, or the stream would be dropped without a word.
    """
    if not STREAM.fullmatch(key):
        raise InputError(
            f"key '{key}' cannot be used; give names between slashes, such as camera/depth, "
            "of letters, digits, dots, dashes and underscores"
        )
    if guarded and not key.startswith(GUARDED):
        raise InputError(f"with certificates only our own keys are let through; use {GUARDED}{key}")
    return key


def worker_refine(worker: str) -> str:
    """Queryable of one worker: a batch in, refined particles out."""
    return f"gepf/worker/{worker}/refine"


def worker_alive(worker: str) -> str:
    """Liveliness token of one worker, declared when it is ready for work."""
    return f"gepf/worker/{worker}/alive"


def worker_lanes(worker: str, lanes: int) -> str:
    """Liveliness token that says how many particles a worker refines at once; declared before the other."""
    return f"gepf/worker/{worker}/lanes/{lanes}"


def lanes_of(key: str) -> int:
    """The number of lanes that a worker's token says; 1 for one that makes no sense."""
    number = last_of(key)
    return max(1, int(number)) if re.fullmatch("[0-9]{1,4}", number) else 1


def worker_admission(worker: str) -> str:
    """Token by which a worker finds out whether its certificate allows its name."""
    return f"gepf/worker/{worker}/admission"


def worker_all(worker: str) -> str:
    """All keys of one worker."""
    return f"gepf/worker/{worker}/**"


def worker_of(key: str) -> str:
    """The worker that a key of its own belongs to."""
    return key.split("/")[2]


def run_alive(run: str) -> str:
    """Liveliness token of one run, for as long as its coordinator is there."""
    return f"gepf/run/{run}/alive"


def run_present(run: str) -> str:
    """Queryable that answers with nothing: the token of a run that is gone may stay where a link does."""
    return f"gepf/run/{run}/present"


def run_frames(run: str) -> str:
    """Where a run publishes its frames."""
    return f"gepf/run/{run}/frame"


def run_frame(run: str, number: int | str) -> str:
    """Queryable for one frame, for who missed its publication; number `*` for all of them."""
    return f"gepf/run/{run}/frame/{number}"


def run_model(run: str, model_hash: str) -> str:
    """Queryable for one model by its content hash; `*` for all of them."""
    return f"gepf/run/{run}/model/{model_hash}"


def run_of(key: str) -> str:
    """The run that a key of its own belongs to."""
    return key.split("/")[2]


def last_of(key: str) -> str:
    """The last part of a key: a frame's number or a model's hash."""
    return key.rsplit("/", 1)[1]
