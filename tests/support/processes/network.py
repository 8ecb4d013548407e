"""Network hosts on one switch: namespaces of the kernel, each with an address and shared memory of its own.

Nothing of it is visible outside, and all of it goes with the process that made it, however that ends.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import random
import select
import struct
import subprocess
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.support.processes.warm_processes import start

HOLD = "echo made && mount -t tmpfs tmpfs /dev/shm && ip link set lo up && echo ready && exec cat"
SUBNET = "10.77.0"
NEW_NAMESPACES = {"mnt": 0x00020000, "net": 0x40000000}  # CLONE_NEWNS, CLONE_NEWNET
TUNSETIFF, TAP_WITHOUT_HEADER = 0x400454CA, 0x0002 | 0x1000  # <linux/if_tun.h>
LARGEST_PACKET = 2048  # bytes; a TAP device's are at most 1514


class NotAllowed(Exception):
    """Whoever runs this may not make namespaces."""


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

    @property
    def segments_sent_again(self) -> int:
        """How often TCP did not hear of the other side in time, as the kernel counts it."""
        names, values = (
            line.split()
            for line in Path(f"/proc/{self.pid}/net/snmp").read_text().splitlines()
            if "Tcp:" in line
        )
        return int(values[names.index("RetransSegs")])

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


@dataclass(frozen=True, slots=True)
class Weather:
    """What a bad cable does to packets, either way."""

    loss: float  # share
    delay: float  # seconds


class Network:
    """A switch with hosts; a context manager. NotAllowed where namespaces are."""

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

    def host(self, name: str, weather: Weather | None = None) -> Host:
        """A host on a cable, which is good if there is no weather."""
        host = Host(name, f"{SUBNET}.{len(self._hosts) + 1}")
        self._stack.callback(host.end)
        self._hosts.append(host)
        if weather is None:
            self._switch.ip(f"link add name {name} type veth peer name eth0 netns {host.pid}")
        else:
            self._switch.ip(f"tuntap add dev {name} mode tap")
            host.ip("tuntap add dev eth0 mode tap")
        self._switch.ip(f"link set dev {name} master bridge up")
        host.ip(f"addr add {host.address}/24 dev eth0")
        host.ip("link set dev eth0 up")
        if weather is not None:  # both devices are up: they would take no packet before
            self._lay_cable(host, weather)
        return host

    def pull(self, host: Host) -> None:
        """Take a host's cable out of the switch: no packet arrives, and nobody gets to know."""
        self._switch.ip(f"link set dev {host.name} down")

    def put_back(self, host: Host) -> None:
        """Put the cable in again."""
        self._switch.ip(f"link set dev {host.name} up")

    def _lay_cable(self, host: Host, weather: Weather) -> None:
        ends = (self._switch.pid, host.name), (host.pid, "eth0")
        cable = start(carry, ends, weather, len(self._hosts), log=self._log)
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


def carry(ends: tuple[tuple[int, str], tuple[int, str]], weather: Weather, seed: int) -> None:
    """Be a cable between two devices on two hosts, until killed."""
    one, other = (open_tap(*end) for end in ends)
    leads_to = {one: other, other: one}
    rng = random.Random(seed)
    under_way: deque[tuple[float, int, bytes]] = deque()  # since when, where to, packet
    while True:
        due = under_way[0][0] + weather.delay - time.monotonic() if under_way else None
        for device in select.select([one, other], [], [], due and max(0.0, due))[0]:
            packet = os.read(device, LARGEST_PACKET)
            if rng.random() >= weather.loss:
                under_way.append((time.monotonic(), leads_to[device], packet))
        while under_way and under_way[0][0] + weather.delay <= time.monotonic():
            _, device, packet = under_way.popleft()
            os.write(device, packet)


def open_tap(pid: int, device: str) -> int:
    """The side of a host's virtual network device where its packets come out."""
    enter(pid, "net")
    tap = os.open("/dev/net/tun", os.O_RDWR)
    fcntl.ioctl(tap, TUNSETIFF, struct.pack("16sH22x", device.encode(), TAP_WITHOUT_HEADER))
    return tap
