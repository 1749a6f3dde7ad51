"""Network of a run: endpoints of its router, and the join files of processes that are started elsewhere."""

import ipaddress
import json
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gslcosim.base.errors import UsageError
from gslcosim.base.files import read_regular_file
from gslcosim.bus.interface import Certificate, JoinData, MemberName, Secret, describe_problem, read_join_file

CERTIFICATE_REMEDY = (
    "A new pair: openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 365 -keyout key.pem "
    "-out certificate.pem -subj /CN=HOST -addext subjectAltName=DNS:HOST -addext basicConstraints=critical,CA:FALSE"
)

JOIN_TIMEOUT_S = 180.0
# After a cut of 3 s a link is silent for up to 6 s, because TCP retries at growing intervals; for 12 s if the first
# packet afterwards is lost as well.
DEFAULT_LEASE_S = 15.0
MIN_LEASE_S, MAX_LEASE_S = 1.0, 3600.0
# Agents report their progress every 64 ticks.
MIN_WINDOW_TICKS, MAX_WINDOW_TICKS = 128, 1 << 16
ALL_SERVICES = "all"


def describe_absence() -> str:
    """Return the fault of a participant that has not joined in time."""
    return f"expected to join within {JOIN_TIMEOUT_S:g} s, did not."


@dataclass(frozen=True, kw_only=True)
class Network:
    """Ways in which the run's processes reach its router.

    By default a private unix socket, and the supervisor starts everything. `listen` adds endpoints for other hosts;
    the supervisor does not start the services that `elsewhere` names, or with `all` any service. The join data of
    participants not started here are in `join_dir` (by default `join` in the run directory), as `services/<name>.json`
    or `agents/<name>.json`; such a participant is given up after `lease_s` [s] without a sign of life.
    Endpoints that begin with `tls/` need a certificate, which is part of the join data. Other endpoints are for this
    machine alone, unless `is_insecure` permits unencrypted traffic, which any host on the way can read and write.
    `window_ticks` is the lead that a writer may have over its slowest reader; absent: the one that the reader states.
    """

    listen: tuple[str, ...] = ()
    elsewhere: tuple[str, ...] = ()
    join_dir: Path | None = None
    tls: Certificate | None = None
    lease_s: float = DEFAULT_LEASE_S
    is_insecure: bool = False
    window_ticks: int | None = None

    def is_remote(self, service: str) -> bool:
        """Return whether the supervisor does not start a service."""
        return ALL_SERVICES in self.elsewhere or service in self.elsewhere

    def check(self, services: Sequence[str], *, is_one_process: bool = False) -> None:
        """Refuse impossible settings, and those that open the run to any host."""
        for endpoint in self.listen:
            if endpoint.split("/")[0] not in ("tcp", "tls", "unixsock-stream"):
                raise UsageError(
                    f"--listen: expected an endpoint such as tcp/127.0.0.1:7447 or tls/…, was {endpoint!r}."
                )
            if endpoint.startswith("tls/") and self.tls is None:
                raise UsageError(
                    f"--listen {endpoint}: expected --tls-certificate and --tls-key with it. {CERTIFICATE_REMEDY}"
                )
            if not (self.is_insecure or endpoint.startswith("tls/") or is_local_endpoint(endpoint)):
                raise UsageError(
                    f"--listen {endpoint}: expected tls/… beyond this machine, was not encrypted: whoever is on the "
                    "way can read and change the run. Give tls/… with --tls-certificate and --tls-key, or --insecure."
                )
        self._check_certificate()
        self._check_elsewhere(services, is_one_process=is_one_process)
        if not MIN_LEASE_S <= self.lease_s <= MAX_LEASE_S:
            raise UsageError(
                f"--lease-s: expected seconds from {MIN_LEASE_S:g} to {MAX_LEASE_S:g}, was {self.lease_s:g}."
            )
        if self.window_ticks is not None:
            if is_one_process:
                raise UsageError("--window-ticks: expected --processes separate or grouped with it, was one.")
            if not MIN_WINDOW_TICKS <= self.window_ticks <= MAX_WINDOW_TICKS:
                raise UsageError(
                    f"--window-ticks: expected ticks from {MIN_WINDOW_TICKS} to {MAX_WINDOW_TICKS}, "
                    f"was {self.window_ticks}."
                )

    def check_gateway(self, agent: str) -> None:
        """Refuse to let an agent attach from elsewhere by the gateway's TCP, which is never encrypted."""
        if not (self.is_insecure or all(map(is_local_endpoint, self.listen))):
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
                raise UsageError(f"expected a PEM file, found none. {CERTIFICATE_REMEDY}\nFile: {path}")

    def _check_elsewhere(self, services: Sequence[str], *, is_one_process: bool) -> None:
        wrong = [name for name in self.elsewhere if name not in (*services, ALL_SERVICES)]
        if wrong:
            raise UsageError(
                f"--elsewhere: expected services of the run, of {', '.join(services)}, or {ALL_SERVICES}, "
                f"was {wrong[0]!r}."
            )
        if self.elsewhere and is_one_process:
            raise UsageError("--elsewhere: expected --processes separate or grouped with it, was one.")

    @property
    def public_endpoint(self) -> str | None:
        """The endpoint that processes on other hosts use: the first of `listen`, with this host's name for `any`."""
        if not self.listen:
            return None
        # The part after a # concerns this host alone.
        first = self.listen[0].partition("#")[0]
        return first.replace("0.0.0.0", socket.gethostname()).replace("[::]", socket.gethostname())

    def write_join(self, kind: str, join: JoinData, run_path: Path) -> Path:
        """Write the join data of a process that joins the bus and is not started here; return the file."""
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


def is_local_endpoint(endpoint: str) -> bool:
    """Return whether a Zenoh endpoint is out of reach of other machines."""
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


class GatewayJoinData(BaseModel):
    """Connection data of an agent behind the gateway: address, the token that it sends first, and its frames.

    `agents` names the agents that its process flies where they are several.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    name: MemberName
    gateway: str = Field(max_length=4102, pattern=r"^(tcp:[A-Za-z0-9_.:%\[\]-]{1,300}:[0-9]{1,5}|unix:/[^\x00-\x1f]+)$")
    token: Secret
    format: Literal["msgpack", "json"] = "msgpack"
    agents: Annotated[tuple[MemberName, ...], Field(min_length=1, max_length=1000)] | None = None


@dataclass(frozen=True, kw_only=True)
class JoinFile:
    """Content of a join file: how to join the bus, or how an agent behind the gateway connects."""

    path: Path
    join: JoinData | None
    gateway: GatewayJoinData | None

    @classmethod
    def read(
        cls, path: Path, *, wait_s: float = 0.0, endpoint: str | None = None, client: Certificate | None = None
    ) -> "JoinFile":
        """Read a join file.

        Args:
            endpoint: Endpoint at which this host reaches the run; absent: the one in the file.
        """
        text = read_join_file(path, place="join file", wait_s=wait_s)
        place = f"join file {path}"
        try:
            fields: Any = json.loads(text)
        except (ValueError, RecursionError):
            fields = None
        if not isinstance(fields, dict):
            raise UsageError(f"{place}: expected JSON as `gslcosim up` writes it, was something else.")
        known = cast("dict[str, Any]", fields)
        if "gateway" in known:
            try:
                return cls(path=path, join=None, gateway=GatewayJoinData.model_validate(known))
            except ValidationError as error:
                raise UsageError(
                    f"{place}: expected JSON as `gslcosim up` writes it; {describe_problem(error)}"
                ) from error
        # Only processes that the run's own host starts have these.
        join = JoinData.from_text(text, place=place).model_copy(update={"mesh": None, "is_watched": False})
        if endpoint is not None:
            join = join.model_copy(update={"endpoint": endpoint})
        return cls(path=path, join=_add_certificate(join, client), gateway=None)

    @property
    def is_for_agent(self) -> bool:
        """True when it lets an agent join and no service."""
        return self.join is None or self.join.run_dir is None

    @property
    def name(self) -> str:
        """The participant that it was written for."""
        data = self.join or self.gateway
        return self.path.stem if data is None else data.name


def _add_certificate(join: JoinData, client: Certificate | None) -> JoinData:
    if client is None:
        if join.needs_tls_client:
            raise UsageError(
                f"{join.name}: expected --tls-certificate and --tls-key, for the run lets nobody in without a client "
                "certificate; found none."
            )
        return join
    if not join.endpoint.startswith("tls/"):
        raise UsageError(f"--tls-certificate: expected a run at an endpoint tls/…, was {join.endpoint}.")
    for path in (client.certificate, client.private_key):
        if not path.is_file():
            raise UsageError(f"expected a PEM file, found none.\nFile: {path}")
    return join.model_copy(
        update={
            "tls_client_certificate": read_regular_file(client.certificate).decode(),
            "tls_client_key": read_regular_file(client.private_key).decode(),
        }
    )
