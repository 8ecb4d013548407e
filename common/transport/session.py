"""The configuration of a session in Zenoh's format, which its router also reads.

The listening side also defines access control. Everything that no rule allows is dropped without a message. A
rule is for the name in a certificate:

    worker      its own keys; the frames and models of runs, to read
    coordinator     its own runs and its own live input; the workers, to ask
    router      everything under `gepf/`
    any other   nothing
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from gepf.common.bounds import MAX_BYTES
from gepf.common.protocol import keys
from gepf.common.transport.credentials import Credentials, holder_of

LEASE_MS = 1_000  # a peer that is silent for this time is disconnected
RETRY_MS = (100, 1_000)  # between attempts to connect, first and longest
SHARED_MEMORY_BYTES = 4 * 2**20  # for frames on this host: half of what users but root may lock
COORDINATOR = "coordinator"  # name of a coordinator without certificates, and of the first one with them
ROUTER = "router"
IN, OUT = "ingress", "egress"
READ = ("declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query")
SERVE = ("declare_queryable", "reply", "liveliness_token")
PUBLISH = ("put", "delete")
Rules = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Security:
    """A certificate, and on the listening side who is admitted."""

    credentials: Credentials
    workers: tuple[str, ...] | None = None  # None for no access control
    coordinators: tuple[str, ...] = (COORDINATOR,)


def holder_name(security: Security | None) -> str | None:
    """The name in the certificate; None without one."""
    return None if security is None else holder_of(security.credentials)


def session_settings(
    mode: str, listen: Sequence[str], connect: Sequence[str], security: Security | None = None
) -> dict[str, Any]:
    """Only explicit endpoints: no multicast, no gossip. Retries for ever; a peer, in the background."""
    first, longest = RETRY_MS
    above_lease_us = 3 * LEASE_MS * 1000 // 2  # otherwise a lost worker's token stays
    settings: dict[str, Any] = {
        "mode": mode,
        "listen": {"endpoints": list(listen)},
        "connect": {
            "endpoints": list(connect),
            "timeout_ms": -1,  # for ever
            "exit_on_failure": False,
            "retry": {"period_init_ms": first, "period_max_ms": longest, "period_increase_factor": 2},
        },
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "link": {
                "tx": {
                    "lease": LEASE_MS,
                    "queue": {"congestion_control": {"block": {"wait_before_close": above_lease_us}}},
                },
                "rx": {"max_message_size": MAX_BYTES},
            },
            # For frames only: shared memory of replies is never released.
            "shared_memory": {
                "transport_optimization": {"pool_size": SHARED_MEMORY_BYTES, "messages": ["put"]}
            },
        },
    }
    if security is not None:
        settings["transport"]["link"] |= encryption(security.credentials)
        if security.workers is not None:
            settings["access_control"] = access_control(security.workers, security.coordinators)
    return settings


def encryption(credentials: Credentials) -> dict[str, Any]:
    """Certificates on both sides; without TLS only sockets of this host are allowed."""
    cert, key = str(credentials.cert), str(credentials.key)
    return {
        "protocols": ["tls", "unixsock-stream"],
        "tls": {
            "root_ca_certificate": str(credentials.ca),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
            "listen_certificate": cert,
            "listen_private_key": key,
            "connect_certificate": cert,
            "connect_private_key": key,
        },
    }


def access_control(workers: Sequence[str], coordinators: Sequence[str]) -> Rules:
    """Rules that admit these workers and coordinators, routers, and local programs over a socket."""
    everything = ["everything of ours"]
    rules = [
        allow(everything[0], (IN, OUT), (*READ, *SERVE, *PUBLISH), "gepf/**"),
        allow("ask a run", (IN,), READ, keys.ALL_RUNS),
        allow("be sent to by a run", (OUT,), (*SERVE, *PUBLISH), keys.ALL_RUNS),
        allow("see workers", (IN,), ("declare_liveliness_subscriber", "liveliness_query"), keys.ALL_WORKERS),
        allow("be seen by coordinators", (OUT,), SERVE, keys.ALL_WORKERS),
    ]
    subjects = [
        {"id": "our own", "link_protocols": ["unixsock-stream"]},
        {"id": "the same side", "cert_common_names": [ROUTER]},
    ]
    policies = [{"rules": everything, "subjects": ["our own", "the same side"]}]
    for coordinator in coordinators:
        run, ask = f"run as {coordinator}", f"ask as {coordinator}"
        own = [keys.of_run(coordinator, "**"), keys.of_live(coordinator, "**")]
        rules.append(allow(run, (IN, OUT), (*READ, *SERVE, *PUBLISH), *own))
        rules.append(allow(ask, (IN,), ("query",), keys.of_worker("*", f"refine/{coordinator}")))
        subjects.append({"id": coordinator, "cert_common_names": [coordinator]})
        granted = [run, ask, "see workers", "be seen by coordinators"]
        policies.append({"rules": granted, "subjects": [coordinator]})
    for worker in workers:
        be, hear = f"be {worker}", f"hear as {worker}"
        own = [keys.of_worker(worker, "**")]
        rules.append(allow(be, (IN,), (*SERVE, "declare_liveliness_subscriber", "liveliness_query"), *own))
        rules.append(allow(hear, (OUT,), ("query", "liveliness_token", "reply"), *own))
        subjects.append({"id": worker, "cert_common_names": [worker]})
        policies.append({"rules": [be, hear, "ask a run", "be sent to by a run"], "subjects": [worker]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def allow(name: str, flows: Iterable[str], messages: Iterable[str], *key_expressions: str) -> Rules:
    """One rule."""
    return {
        "id": name,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": list(key_expressions),
    }
