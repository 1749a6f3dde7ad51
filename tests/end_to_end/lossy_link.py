"""A wire between two network namespaces that delays, loses, reorders and cuts: real packets, without a kernel module.

Each end is a TUN device in its namespace; this process carries the packets from one to the other. What it does to them
is TCP's to repair, as on a real link. As a script it is that process: `python wire.py OPTIONS-AS-JSON` says `ready`,
obeys lines on standard input (`cut SECONDS`, `cut inf`, `mend`), and prints what it has done when its input ends.
"""

import fcntl
import heapq
import itertools
import json
import math
import os
import random
import selectors
import struct
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

TUN = Path("/dev/net/tun")
_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_MOST_BYTES = 65536
# As much as a router of a slow link holds.
_MOST_WAITING_S = 1.0


@dataclass(frozen=True, kw_only=True)
class Ends:
    """The namespaces and addresses of both ends."""

    namespaces: tuple[str, str]
    addresses: tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Quality:
    """What a wire does to packets, in each direction.

    `delay_s` [s] each way; `loss_frac` of packets vanish; `reorder_frac` come `reorder_s` later than they should, after
    those behind them; `rate_b_s` [bytes/s] is how much passes (0: all). `seed` decides which packets it meets.
    """

    delay_s: float = 0.0
    loss_frac: float = 0.0
    reorder_frac: float = 0.0
    reorder_s: float = 0.02
    rate_b_s: float = 0.0
    seed: int = 1


@dataclass
class Tally:
    """What a wire has done, in both directions together."""

    packets: int = 0
    bytes: int = 0
    lost: int = 0
    reordered: int = 0
    cut: int = 0


@dataclass
class _Carrier:
    ends: Ends
    quality: Quality
    tally: Tally = field(default_factory=Tally)

    def __post_init__(self) -> None:
        self._random = random.Random(self.quality.seed)
        self._due: list[tuple[float, int, int, bytes]] = []
        self._order = itertools.count()
        self._is_free_at_s = [0.0, 0.0]
        self._is_cut_until_s = 0.0
        self._unread = b""
        self._devices = [self._open(side) for side in (0, 1)]

    def _open(self, side: int) -> int:
        device = os.open(TUN, os.O_RDWR | os.O_NONBLOCK)
        name = f"gw{os.getpid() % 1000000}{'ab'[side]}"
        fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH14x", name.encode(), _IFF_TUN | _IFF_NO_PI))
        here, there = self.ends.addresses[side], self.ends.addresses[1 - side]
        namespace = self.ends.namespaces[side]
        for words in (
            ("link", "set", name, "netns", namespace),
            ("-n", namespace, "address", "add", here, "peer", there, "dev", name),
            ("-n", namespace, "link", "set", name, "txqueuelen", "10000"),
            ("-n", namespace, "link", "set", name, "up"),
        ):
            subprocess.run(["ip", *words], check=True)
        return device

    def run(self) -> None:
        """Carry packets until standard input ends."""
        with selectors.DefaultSelector() as selector:
            selector.register(0, selectors.EVENT_READ, None)
            for side, device in enumerate(self._devices):
                selector.register(device, selectors.EVENT_READ, side)
            print("ready", flush=True)  # noqa: T201
            while True:
                wait_s = max(0.0, self._due[0][0] - time.monotonic()) if self._due else None
                for key, _ in selector.select(wait_s):
                    if key.data is None and not self._obey():
                        return
                    if key.data is not None:
                        self._take(key.data)
                self._deliver()

    def _obey(self) -> bool:
        read = os.read(0, 4096)
        *lines, self._unread = (self._unread + read).split(b"\n")
        for line in lines:
            word, *amount = line.decode().split()
            self._is_cut_until_s = time.monotonic() + float(amount[0]) if word == "cut" else 0.0
        return bool(read)

    def _take(self, side: int) -> None:
        quality = self.quality
        for _ in range(64):
            try:
                packet = os.read(self._devices[side], _MOST_BYTES)
            except BlockingIOError:
                return
            self.tally.packets += 1
            self.tally.bytes += len(packet)
            now_s = time.monotonic()
            if now_s < self._is_cut_until_s:
                self.tally.cut += 1
                continue
            if self._random.random() < quality.loss_frac:
                self.tally.lost += 1
                continue
            due_s = now_s + quality.delay_s
            if quality.rate_b_s:
                start_s = max(now_s, self._is_free_at_s[side])
                if start_s - now_s > _MOST_WAITING_S:
                    self.tally.lost += 1
                    continue
                self._is_free_at_s[side] = start_s + len(packet) / quality.rate_b_s
                due_s += self._is_free_at_s[side] - now_s
            if self._random.random() < quality.reorder_frac:
                self.tally.reordered += 1
                due_s += quality.reorder_s
            heapq.heappush(self._due, (due_s, next(self._order), 1 - side, packet))

    def _deliver(self) -> None:
        now_s = time.monotonic()
        while self._due and self._due[0][0] <= now_s:
            _, _, side, packet = heapq.heappop(self._due)
            if now_s < self._is_cut_until_s:
                self.tally.cut += 1
                continue
            try:
                os.write(self._devices[side], packet)
            except OSError:
                self.tally.lost += 1


class Wire:
    """A wire whose packets a process of its own carries; leaving the context ends it."""

    def __init__(self, ends: Ends, quality: Quality) -> None:
        options = json.dumps([asdict(ends), asdict(quality)])
        self._process = subprocess.Popen(
            [sys.executable, __file__, options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.tally = Tally()

    def __enter__(self) -> "Wire":
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line == "ready\n", f"the wire could not be laid: {line!r}"
        return self

    def __exit__(self, *_: object) -> None:
        output, _ = self._process.communicate()
        self.tally = Tally(**json.loads(output))

    def cut(self, duration_s: float = math.inf) -> None:
        """Let nothing pass for some time [s], by default for ever."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"cut {duration_s}\n")
        self._process.stdin.flush()


def main(options: str) -> None:
    """Be the process that carries the packets."""
    ends, quality = json.loads(options)
    carrier = _Carrier(Ends(**ends), Quality(**quality))
    carrier.run()
    print(json.dumps(asdict(carrier.tally)), flush=True)  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1])
