"""Key expressions on the bus.

Keys of a worker, below `gepf/worker/<worker>/`:

    offer/<kind>/<processor>/<lanes>/<batch>    liveliness token, declared last, when the worker is ready
    refine/<coordinator>    queryable: a batch of particles of a coordinator in, refined particles out
    admission   liveliness token by which a worker finds out whether its certificate allows its name

Keys of a run, below `gepf/run/<coordinator>/<run>/`. The name of a run is `<coordinator>/<run>`:

    frame       published frames, for workers that have had requests of the run
    frame/<n>   queryable: one frame, for workers that missed its publication
    model/<h>   queryable: one model by the hash of its content
    alive       liveliness token of the coordinator
    present     queryable with an empty answer: a token may exist longer than its run

Keys of live input of other programs with certificates are below `gepf/live/<coordinator>/`.
"""

from __future__ import annotations

import re

from gepf.common.errors import InputError, ProtocolError
from gepf.common.offer import Offer

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
RUN = re.compile(rf"{NAME.pattern}/{NAME.pattern}")
STREAM = re.compile(rf"{NAME.pattern}(/{NAME.pattern}){{0,15}}")
COUNT = re.compile("[1-9][0-9]{0,3}")

ANY_RUN = "*/*"
ALL_RUNS = "gepf/run/**"
ALL_WORKERS = "gepf/worker/**"


def of_worker(worker: str, what: str) -> str:
    """A key of a worker; `*` for any worker."""
    return f"gepf/worker/{worker}/{what}"


def of_run(run: str, what: str) -> str:
    """A key of a run; ANY_RUN for any run."""
    return f"gepf/run/{run}/{what}"


def of_live(coordinator: str, stream: str) -> str:
    """A key of live input with certificates."""
    return f"gepf/live/{coordinator}/{stream}"


def offer_key(worker: str, offer: Offer) -> str:
    """The liveliness token by which a worker announces its offer."""
    return of_worker(worker, f"offer/{offer.kind}/{offer.processor}/{offer.lanes}/{offer.batch}")


def read_offer(key: str) -> Offer:
    """The offer in a worker's token; ProtocolError if it is invalid."""
    match key.split("/")[3:]:
        case ["offer", kind, processor, lanes, batch] if COUNT.fullmatch(lanes) and COUNT.fullmatch(batch):
            return Offer(kind, processor, int(lanes), int(batch))
    raise ProtocolError(f"{key} is not an offer of this version; install the same version of gepf there")


def worker_of(key: str) -> str:
    """The worker that a key belongs to."""
    return key.split("/")[2]


def run_of(key: str) -> str:
    """The run that a key belongs to."""
    return "/".join(key.split("/")[2:4])


def coordinator_of(run: str) -> str:
    """The coordinator in the name of a run."""
    return run.partition("/")[0]


def last_of(key: str) -> str:
    """The last part of a key: a frame's number, a model's hash or a coordinator."""
    return key.rsplit("/", 1)[1]


def check_name(what: str, name: str) -> str:
    """The name of a worker, coordinator, run or kind, if it can be part of a key; InputError otherwise."""
    if not NAME.fullmatch(name):
        raise InputError(f"{what} '{name}' cannot be used; choose at most 64 letters, digits and . - _")
    return name


def check_stream(key: str, holder: str | None = None) -> str:
    """The key of a stream of depth images, if it has no wildcards; InputError otherwise.

    With the certificate of a holder it must be below `gepf/live/<holder>/`: everything else is dropped
    without a message.
    """
    if not STREAM.fullmatch(key):
        names = "names of letters, digits and . - _ between slashes, such as camera/depth"
        raise InputError(f"key '{key}' cannot be used; give {names}")
    if holder is not None and not key.startswith(of_live(holder, "")):
        raise InputError(f"the certificate of '{holder}' allows other keys only; use {of_live(holder, key)}")
    return key
