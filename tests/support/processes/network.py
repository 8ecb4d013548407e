"""Network hosts on one switch: namespaces of the kernel, each with an address and shared memory of its own.

It is not visible outside, and it disappears with the process that made it.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path

from gepf.common.closing import Closing
from tests.support.processes.warm_processes import start

HOLD = "echo made && mount -t tmpfs tmpfs /dev/shm && ip link set lo up && echo ready && exec cat"
SUBNET = "10.77.0"
NEW_NAMESPACES = {"mnt": 0x00020000, "net": 0x40000000}  # CLONE_NEWNS, CLONE_NEWNET


class NotAllowed(Exception):
    """This user may not create namespaces."""


class Host:
    """One host; it lives as long as a process that waits for the end of its standard input."""

    def __init__(self, name: str, address: str) -> None:
        self.name = name
        self.address = address
        self._holder = subprocess.Popen(
            ["unshare", "--net", "--mount", "sh", "-c", HOLD],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.pid = self._holder.pid
        self._await("made", NotAllowed)
        self._await("ready", RuntimeError)

    def ip(self, command: str) -> None:
        """Run `ip` there; RuntimeError if it fails."""
        done = subprocess.run(
            ["nsenter", f"--net=/proc/{self.pid}/ns/net", "ip", *command.split()],
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
        if done.returncode:
            raise RuntimeError(f"ip {command}: {done.stderr.strip()}")

    def start(self, do: Callable[..., None], *arguments: object, log: Path) -> BaseProcess:
        """Like `tests.support.processes.warm_processes.start`, on this host."""
        return start(run_on, self.pid, do, arguments, log=log)

    def end(self) -> None:
        """The host is gone once no process is on it."""
        self._holder.communicate()

    def _await(self, word: str, otherwise: type[Exception]) -> None:
        assert self._holder.stdout is not None
        if self._holder.stdout.readline().strip() != word:
            raise otherwise(self._holder.communicate()[1].strip())


class Network(Closing):
    """A switch with hosts; a context manager. NotAllowed where namespaces are."""

    def __init__(self) -> None:
        self._hosts: list[Host] = []
        self._switch = Host("switch", "")
        try:
            self._switch.ip("link add name bridge type bridge")
            self._switch.ip("link set dev bridge up")
        except BaseException:
            self._switch.end()
            raise

    def close(self) -> None:
        """End all hosts."""
        for host in (*reversed(self._hosts), self._switch):
            host.end()

    def host(self, name: str) -> Host:
        """A host on a cable."""
        host = Host(name, f"{SUBNET}.{len(self._hosts) + 1}")
        self._hosts.append(host)
        self._switch.ip(f"link add name {name} type veth peer name eth0 netns {host.pid}")
        self._switch.ip(f"link set dev {name} master bridge up")
        host.ip(f"addr add {host.address}/24 dev eth0")
        host.ip("link set dev eth0 up")
        return host

    def pull(self, host: Host) -> None:
        """Disconnect a host from the switch: no packet arrives, without notice."""
        self._switch.ip(f"link set dev {host.name} down")

    def put_back(self, host: Host) -> None:
        """Put the cable in again."""
        self._switch.ip(f"link set dev {host.name} up")


def run_on(pid: int, do: Callable[..., None], arguments: tuple[object, ...]) -> None:
    """Move this process, which has one thread as yet, to a host, and do something there."""
    here = Path.cwd()
    enter(pid, "net")
    enter(pid, "mnt")
    os.chdir(here)
    do(*arguments)


def enter(pid: int, kind: str) -> None:
    """Take on a namespace of another process."""
    libc = ctypes.CDLL(None, use_errno=True)
    namespace = os.open(f"/proc/{pid}/ns/{kind}", os.O_RDONLY)
    if libc.setns(namespace, NEW_NAMESPACES[kind]):
        raise OSError(ctypes.get_errno(), f"cannot enter the {kind} namespace")
    os.close(namespace)
