"""What processes that are not started here need to join a run: endpoints, and files that hold their join data."""

import ipaddress
import json
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gslcosim.bus.port import Certificate, Join
from gslcosim.errors import UsageError
from gslcosim.safe_files import read_regular_file

NEW_CERTIFICATE = (
    "A new pair: openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 365 -keyout key.pem "
    "-out certificate.pem -subj /CN=HOST -addext subjectAltName=DNS:HOST -addext basicConstraints=critical,CA:FALSE"
)

JOIN_LIMIT_S = 180.0
# A link that is cut for 3 s is silent for up to 6 s, since TCP tries again after ever longer times; for 12 s where the
# first packet afterwards is lost as well.
LEASE_S = 15.0
SHORTEST_LEASE_S, LONGEST_LEASE_S = 1.0, 3600.0
# Agents tell their progress every 64 ticks.
FEWEST_WINDOW_TICKS, MOST_WINDOW_TICKS = 128, 1 << 16
EVERY_SERVICE = "all"


@dataclass(frozen=True, kw_only=True)
class Network:
    """How the run's processes reach its router.

    By default a private unix socket, and the supervisor starts everything. `listen` adds endpoints for other hosts;
    the services that `elsewhere` names, or `all`, are started by someone else. Who is not started here finds its join
    data in `join_dir` (by default `join` in the run directory): `services/<name>.json` or `agents/<name>.json`, and is
    given up after `lease_s` [s] without a sign of life.
    Endpoints that begin with `tls/` need a certificate; who joins from elsewhere gets it with its join data.
    Others are for this machine alone, unless `is_insecure` says that everybody on the way may read and write.
    `window_ticks` is how far a writer may run ahead of its slowest reader; absent: as far as the reader says.
    """

    listen: tuple[str, ...] = ()
    elsewhere: tuple[str, ...] = ()
    join_dir: Path | None = None
    tls: Certificate | None = None
    lease_s: float = LEASE_S
    is_insecure: bool = False
    window_ticks: int | None = None

    def is_elsewhere(self, service: str) -> bool:
        """Return whether a service is started by someone else."""
        return EVERY_SERVICE in self.elsewhere or service in self.elsewhere

    def check(self, services: Sequence[str], *, is_one_process: bool = False) -> None:
        """Refuse what cannot be, or would be open to everybody.

        Args:
            services: Those of the run.
            is_one_process: Whether the run is flown in one process.

        Raises:
            UsageError: not a Zenoh endpoint, TLS without a certificate, a certificate that is not there, no TLS beyond
                this machine, services elsewhere that the run does not have, or a lease or window out of range.
        """
        for endpoint in self.listen:
            if endpoint.split("/")[0] not in ("tcp", "tls", "unixsock-stream"):
                raise UsageError(
                    f"--listen: expected an endpoint such as tcp/127.0.0.1:7447 or tls/…, was {endpoint!r}."
                )
            if endpoint.startswith("tls/") and self.tls is None:
                raise UsageError(
                    f"--listen {endpoint}: expected --tls-certificate and --tls-key with it. {NEW_CERTIFICATE}"
                )
            if not (self.is_insecure or endpoint.startswith("tls/") or is_of_this_machine(endpoint)):
                raise UsageError(
                    f"--listen {endpoint}: expected tls/… beyond this machine, was not encrypted: whoever is on the "
                    "way can read and change the run. Give tls/… with --tls-certificate and --tls-key, or --insecure."
                )
        self._check_certificate()
        self._check_elsewhere(services, is_one_process=is_one_process)
        if not SHORTEST_LEASE_S <= self.lease_s <= LONGEST_LEASE_S:
            raise UsageError(
                f"--lease-s: expected seconds from {SHORTEST_LEASE_S:g} to {LONGEST_LEASE_S:g}, was {self.lease_s:g}."
            )
        if self.window_ticks is not None:
            if is_one_process:
                raise UsageError("--window-ticks: expected --processes separate or grouped with it, was one.")
            if not FEWEST_WINDOW_TICKS <= self.window_ticks <= MOST_WINDOW_TICKS:
                raise UsageError(
                    f"--window-ticks: expected ticks from {FEWEST_WINDOW_TICKS} to {MOST_WINDOW_TICKS}, "
                    f"was {self.window_ticks}."
                )

    def check_gateway(self, agent: str) -> None:
        """Refuse to let an agent attach from elsewhere by the gateway's TCP, which is never encrypted.

        Raises:
            UsageError: nobody has said `--insecure`.
        """
        if self.is_beyond_this_machine and not self.is_insecure:
            raise UsageError(
                f"agents: {agent}: start: expected door: zenoh, or --insecure, with --listen beyond this machine: the "
                "gateway's TCP is not encrypted."
            )

    def _check_certificate(self) -> None:
        if self.tls is None:
            return
        if not any(endpoint.startswith("tls/") for endpoint in self.listen):
            raise UsageError("--tls-certificate: expected --listen tls/… with it, was without.")
        for path in (self.tls.certificate, self.tls.private_key, self.tls.ca, self.tls.client_ca):
            if path is not None and not path.is_file():
                raise UsageError(f"expected a PEM file, found none. {NEW_CERTIFICATE}\nFile: {path}")

    def _check_elsewhere(self, services: Sequence[str], *, is_one_process: bool) -> None:
        wrong = [name for name in self.elsewhere if name not in (*services, EVERY_SERVICE)]
        if wrong:
            raise UsageError(
                f"--elsewhere: expected services of the run, of {', '.join(services)}, or {EVERY_SERVICE}, "
                f"was {wrong[0]!r}."
            )
        if self.elsewhere and is_one_process:
            raise UsageError("--elsewhere: expected --processes separate or grouped with it, was one.")

    @property
    def is_beyond_this_machine(self) -> bool:
        """Whether other machines can reach the run."""
        return any(not is_of_this_machine(endpoint) for endpoint in self.listen)

    @property
    def public_endpoint(self) -> str | None:
        """The endpoint that processes on other hosts use: the first of `listen`, with this host's name for `any`."""
        if not self.listen:
            return None
        # What follows a # is about this host alone.
        first = self.listen[0].partition("#")[0]
        return first.replace("0.0.0.0", socket.gethostname()).replace("[::]", socket.gethostname())

    def write_join(self, kind: str, join: Join, run_path: Path) -> Path:
        """Write the join data of a process that somebody else starts and that joins the bus; return the file."""
        join = join.model_copy(update={"lease_s": self.lease_s})
        if endpoint := self.public_endpoint:
            join = join.model_copy(update={"endpoint": endpoint})
            if self.tls is not None and endpoint.startswith("tls/"):
                ca = read_regular_file(self.tls.ca or self.tls.certificate).decode()
                needs_client = self.tls.client_ca is not None
                join = join.model_copy(update={"tls_root_ca": ca, "needs_tls_client": needs_client})
        fields = join.model_dump(exclude_none=True)
        if not join.needs_tls_client:
            del fields["needs_tls_client"]
        return self.write_join_file(kind, join.name, fields, run_path)

    def write_join_file(self, kind: str, name: str, fields: Mapping[str, Any], run_path: Path) -> Path:
        """Write a join file at once, never half, and return it. It holds a secret: only the owner may read it."""
        folder = (self.join_dir or run_path / "join") / kind
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        written = folder / f".{name}.json"
        written.touch(mode=0o600)
        written.write_text(json.dumps(fields))
        return written.replace(folder / f"{name}.json")


def is_of_this_machine(endpoint: str) -> bool:
    """Return whether nobody on another machine can reach a Zenoh endpoint."""
    protocol, _, address = endpoint.partition("/")
    if protocol == "unixsock-stream":
        return True
    host = address.partition("?")[0].partition("#")[0].rpartition(":")[0].strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
