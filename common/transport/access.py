"""Who may do what on the bus: rules for the side that listens, in the form that Zenoh reads.

What no rule allows is denied, and dropped without a word to who tried it. A rule is for the name that a
certificate is made out to:

    worker      its own keys; the frames and models of runs, to read
    coordinator, router     everything under `gepf/`
    any other   nothing
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from common.protocol import keys

COORDINATOR = "coordinator"
ROUTER = "router"

IN, OUT = "ingress", "egress"
READ = ("declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query")
SERVE = ("declare_queryable", "reply", "liveliness_token")
PUBLISH = ("put", "delete")

Rules = dict[str, Any]


def access_control(workers: Sequence[str]) -> Rules:
    """Rules that let in these workers, coordinators and routers, and our own workers through a socket."""
    everything = ["everything of ours"]
    rules = [
        allow(everything[0], (IN, OUT), (*READ, *SERVE, *PUBLISH), keys.ALL),
        allow("ask a run", (IN,), READ, keys.READABLE),
        allow("be sent to by a run", (OUT,), (*SERVE, *PUBLISH), keys.READABLE),
    ]
    subjects = [
        {"id": "our own", "link_protocols": ["unixsock-stream"]},
        {"id": "the same side", "cert_common_names": [COORDINATOR, ROUTER]},
    ]
    policies = [{"rules": everything, "subjects": ["our own", "the same side"]}]
    for worker in workers:
        be, hear = f"be {worker}", f"hear as {worker}"
        own = (keys.worker_all(worker),)
        rules.append(allow(be, (IN,), (*SERVE, "declare_liveliness_subscriber", "liveliness_query"), own))
        rules.append(allow(hear, (OUT,), ("query", "liveliness_token", "reply"), own))
        subjects.append({"id": worker, "cert_common_names": [worker]})
        policies.append({"rules": [be, hear, "ask a run", "be sent to by a run"], "subjects": [worker]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def allow(name: str, flows: Iterable[str], messages: Iterable[str], key_expressions: Iterable[str]) -> Rules:
    """One rule."""
    return {
        "id": name,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": list(key_expressions),
    }
