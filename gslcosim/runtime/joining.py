"""What processes that are not started here need to join a run: endpoints, and files that hold their join data."""

import json
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gslcosim.bus.port import Certificate, Join
from gslcosim.errors import UsageError

NEW_CERTIFICATE = (
    "A new pair: openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 365 -keyout key.pem "
    "-out certificate.pem -subj /CN=HOST -addext subjectAltName=DNS:HOST -addext basicConstraints=critical,CA:FALSE"
)

JOIN_LIMIT_S = 180.0


@dataclass(frozen=True, kw_only=True)
class Network:
    """How the run's processes reach its router.

    By default a private unix socket, and the supervisor starts everything. `listen` adds endpoints for other hosts;
    with `starts_services` off the services are started by someone else. Who is not started here finds its join data
    in `join_dir` (by default `join` in the run directory): `services/<name>.json` or `agents/<name>.json`.
    Endpoints that begin with `tls/` need a certificate; who joins from elsewhere gets it with its join data.
    """

    listen: tuple[str, ...] = ()
    starts_services: bool = True
    join_dir: Path | None = None
    tls: Certificate | None = None

    def check(self) -> None:
        """Refuse an endpoint that nothing can listen on.

        Raises:
            UsageError: not a Zenoh endpoint, TLS without a certificate, or a certificate that is not there.
        """
        for endpoint in self.listen:
            if endpoint.split("/")[0] not in ("tcp", "tls", "unixsock-stream"):
                raise UsageError(f"--listen: expected an endpoint such as tcp/0.0.0.0:7447 or tls/…, was {endpoint!r}.")
            if endpoint.startswith("tls/") and self.tls is None:
                raise UsageError(
                    f"--listen {endpoint}: expected --tls-certificate and --tls-key with it. {NEW_CERTIFICATE}"
                )
        for path in (self.tls.certificate, self.tls.private_key) if self.tls else ():
            if not path.is_file():
                raise UsageError(f"expected a PEM file, found none. {NEW_CERTIFICATE}\nFile: {path}")

    @property
    def public_endpoint(self) -> str | None:
        """The endpoint that processes on other hosts use: the first of `listen`, with this host's name for `any`."""
        if not self.listen:
            return None
        return self.listen[0].replace("0.0.0.0", socket.gethostname()).replace("[::]", socket.gethostname())

    def write_join(self, kind: str, join: Join, run_path: Path) -> None:
        """Write the join data of a process that somebody else starts and that joins the bus."""
        if endpoint := self.public_endpoint:
            join = join.model_copy(update={"endpoint": endpoint})
            if self.tls is not None and endpoint.startswith("tls/"):
                join = join.model_copy(update={"tls_root_ca": self.tls.certificate.read_text()})
        self.write_join_file(kind, join.name, join.model_dump(exclude_none=True), run_path)

    def write_join_file(self, kind: str, name: str, fields: Mapping[str, Any], run_path: Path) -> None:
        """Write a join file at once, never half. It holds a secret, so only the owner may read it."""
        folder = (self.join_dir or run_path / "join") / kind
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        written = folder / f".{name}.json"
        written.touch(mode=0o600)
        written.write_text(json.dumps(fields))
        written.replace(folder / f"{name}.json")
