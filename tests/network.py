"""Network hosts on one switch: namespaces of the kernel, each with an address and shared memory of its own.

Nothing of it is visible outside, and all of it goes with the process that made it, however that ends.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import time
from collections.abc import Callable
from contextlib import ExitStack
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.warm_processes import start

HOLD = "mount -t tmpfs tmpfs /dev/shm && ip link set lo up && echo && exec cat"
SUBNET = "10.77.0"
NEW_NAMESPACES = {"mnt": 0x00020000, "net": 0x40000000}  # CLONE_NEWNS, CLONE_NEWNET
TUNSETIFF, TAP_WITHOUT_HEADER = 0x400454CA, 0x0002 | 0x1000  # <linux/if_tun.h>
LARGEST_PACKET = 2048  # bytes; a TAP device's are at most 1514


class NotAllowed(Exception):
    """This kernel or this user may not make namespaces, bridges or virtual cables."""


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
        )
        self.pid = self._holder.pid
        assert self._holder.stdout is not None
        if not self._holder.stdout.readline():
            raise NotAllowed(self._holder.communicate()[1].decode().strip())

    def ip(self, command: str) -> None:
        """Run `ip` there."""
        done = subprocess.run(
            ["nsenter", f"--net=/proc/{self.pid}/ns/net", "ip", *command.split()],
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
        if done.returncode:
            raise NotAllowed(f"ip {command}: {done.stderr.strip()}")

    def start(self, do: Callable[..., None], *arguments: object, log: Path) -> BaseProcess:
        """Like `tests.warm_processes.start`, on this host."""
        return start(run_on, self.pid, do, arguments, log=log)

    def end(self) -> None:
        """The host is gone once no process is on it."""
        self._holder.communicate()


class Network:
    """A switch with hosts; a context manager. NotAllowed where the kernel or the user's rights forbid it."""

    def __init__(self, log: Path) -> None:
        self._stack = ExitStack()
        self._log = log
        self._hosts: list[Host] = []
        self._switch = Host("switch", "")
        self._stack.callback(self._switch.end)

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.push(self._stack.pop_all())
            self._switch.ip("link add name bridge type bridge")
            self._switch.ip("link set dev bridge up")
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def host(self, name: str, *, loss: float = 0.0, delay: float = 0.0) -> Host:
        """A host on a cable that loses a share of the packets and delays them (seconds), either way."""
        host = Host(name, f"{SUBNET}.{len(self._hosts) + 1}")
        self._stack.callback(host.end)
        self._hosts.append(host)
        if loss or delay:
            self._connect_badly(host, loss, delay)
        else:
            self._switch.ip(f"link add name {name} type veth peer name eth0 netns {host.pid}")
        self._switch.ip(f"link set dev {name} master bridge up")
        host.ip(f"addr add {host.address}/24 dev eth0")
        host.ip("link set dev eth0 up")
        return host

    def pull(self, host: Host) -> None:
        """Take a host's cable out of the switch: no packet arrives, and nobody is told."""
        self._switch.ip(f"link set dev {host.name} down")

    def put_back(self, host: Host) -> None:
        """Put the cable in again."""
        self._switch.ip(f"link set dev {host.name} up")

    def _connect_badly(self, host: Host, loss: float, delay: float) -> None:
        ends = (self._switch.pid, host.name), (host.pid, "eth0")
        for end, (_, device) in zip((self._switch, host), ends, strict=True):
            end.ip(f"tuntap add dev {device} mode tap")
        seed = len(self._hosts)
        cable = start(carry, ends, loss, delay, seed, log=self._log)
        self._stack.callback(cable.join)
        self._stack.callback(cable.kill)


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


def carry(ends: tuple[tuple[int, str], tuple[int, str]], loss: float, delay: float, seed: int) -> None:
    """Be a cable between two devices on two hosts, until killed."""
    one, other = (open_tap(*end) for end in ends)
    leads_to = {one: other, other: one}
    rng = random.Random(seed)
    under_way: list[tuple[float, int, int, bytes]] = []  # when it arrives, number, where, packet
    number = 0
    while True:
        wait = max(0.0, under_way[0][0] - time.monotonic()) if under_way else None
        for device in select.select([one, other], [], [], wait)[0]:
            packet = os.read(device, LARGEST_PACKET)
            number += 1
            if rng.random() >= loss:
                heapq.heappush(under_way, (time.monotonic() + delay, number, leads_to[device], packet))
        while under_way and under_way[0][0] <= time.monotonic():
            _, _, device, packet = heapq.heappop(under_way)
            os.write(device, packet)


def open_tap(pid: int, device: str) -> int:
    """The side of a host's virtual network device where its packets come out."""
    enter(pid, "net")
    tap = os.open("/dev/net/tun", os.O_RDWR)
    fcntl.ioctl(tap, TUNSETIFF, struct.pack("16sH22x", device.encode(), TAP_WITHOUT_HEADER))
    return tap
