"""Two hosts that are network namespaces of this machine, with a cable or a bad wire between them, and certificates."""

import contextlib
import itertools
import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lossy_link import TUN, Ends, Quality, Wire
from real_runs import COMMAND

HERE, THERE = "10.213.7.1", "10.213.7.2"
# Every Linux has it, and none makes less of a bad link; what the machine of a test uses may be better.
CONGESTION_CONTROL = "reno"
_NUMBERS = itertools.count()
# The second host does not see these folders of the first: it has disks of its own.
_HIDING = 'for folder in $HIDDEN; do mount -t tmpfs none "$folder" || exit 99; done; exec "$@"'


@dataclass(frozen=True, kw_only=True)
class TwoHosts:
    """Two hosts: `here` is where runs are run, `there` is the other; `wire` is absent where a cable connects them."""

    here: str
    there: str
    wire: Wire | None

    @property
    def run_here(self) -> tuple[str, ...]:
        """What precedes a command that runs on the first host."""
        return ("ip", "netns", "exec", self.here)

    def start_there(
        self, *words: str | Path, cwd: Path, hidden: tuple[Path, ...] = (), **variables: str
    ) -> "subprocess.Popen[str]":
        """Start `gslcosim WORDS` on the second host, which does not see some folders; its output is captured."""
        call = ["ip", "netns", "exec", self.there, "sh", "-c", _HIDING, "sh", *COMMAND, *map(str, words)]
        variables |= {"HIDDEN": " ".join(map(str, hidden))}
        return subprocess.Popen(
            call,
            cwd=cwd,
            env=os.environ | variables,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )


def why_not(*, needs_wire: bool = False) -> str:
    """Return why this machine has no two hosts; empty where it has."""
    if shutil.which("ip") is None or os.geteuid() != 0:
        return "needs root and `ip` (Debian's iproute2) to make network namespaces"
    if needs_wire and not TUN.exists():
        return "needs /dev/net/tun (the kernel module tun)"
    name = f"gslcosim-{os.getpid()}-probe"
    made = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True, check=False)
    subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)
    return f"network namespaces cannot be made here: {made.stderr.strip()}" if made.returncode else ""


@contextlib.contextmanager
def two_hosts(quality: Quality | None = None, *, congestion_control: str = CONGESTION_CONTROL) -> Iterator[TwoHosts]:
    """Yield two hosts: with a cable between them, or with a wire of some quality."""
    number = next(_NUMBERS)
    here, there = (f"gslcosim-{os.getpid()}-{number}{side}" for side in "ab")
    with contextlib.ExitStack() as stack:
        for name in (here, there):
            _ip("netns", "add", name)
            stack.callback(_ip, "netns", "delete", name)
            _ip("-n", name, "link", "set", "lo", "up")
            setting = f"net.ipv4.tcp_congestion_control={congestion_control}"
            subprocess.run(["ip", "netns", "exec", name, "sysctl", "-qw", setting], check=True)
        if quality is None:
            _lay_cable((here, there), number)
            yield TwoHosts(here=here, there=there, wire=None)
        else:
            wire = stack.enter_context(Wire(Ends(namespaces=(here, there), addresses=(HERE, THERE)), quality))
            yield TwoHosts(here=here, there=there, wire=wire)


def make_certificates(folder: Path, *, address: str = HERE) -> None:
    """Write `ca.pem`, and `server` and `client`, each with `.pem` and `.key`, for which it vouches."""
    curve = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2"]
    ca = ["-keyout", "ca.key", "-out", "ca.pem", "-subj", "/CN=our CA", "-addext", "keyUsage=critical,keyCertSign"]
    _openssl(folder, "req", "-x509", *curve, *ca)
    for name, alternative in (("server", f"IP:{address}"), ("client", "DNS:client")):
        usage = "serverAuth" if name == "server" else "clientAuth"
        (folder / f"{name}.ext").write_text(
            f"subjectAltName={alternative}\nbasicConstraints=critical,CA:FALSE\nextendedKeyUsage={usage}\n"
        )
        request = ["-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}"]
        _openssl(folder, "req", *curve, *request)
        signing = ["-in", f"{name}.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2"]
        _openssl(folder, "x509", "-req", *signing, "-out", f"{name}.pem", "-extfile", f"{name}.ext")


def _lay_cable(names: tuple[str, str], number: int) -> None:
    ends = [f"gs{os.getpid() % 100000}{number}{side}" for side in "ab"]
    _ip("link", "add", ends[0], "netns", names[0], "type", "veth", "peer", "name", ends[1], "netns", names[1])
    for name, end, address in zip(names, ends, (HERE, THERE), strict=True):
        _ip("-n", name, "address", "add", f"{address}/24", "dev", end)
        _ip("-n", name, "link", "set", end, "up")


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], capture_output=True, text=True, check=True)


def _openssl(folder: Path, *words: str) -> None:
    subprocess.run(["openssl", *words], cwd=folder, capture_output=True, check=True)
