"""What processes that are not started here need to join a run: endpoints, and files that hold their join data."""

import json
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gslcosim.bus.port import Join


@dataclass(frozen=True, kw_only=True)
class Network:
    """How the run's processes reach its router.

    By default a private unix socket, and the supervisor starts everything. `listen` adds endpoints for other hosts;
    with `starts_services` off the services are started by someone else. Who is not started here finds its join data
    in `join_dir` (by default `join` in the run directory): `services/<name>.json` or `agents/<name>.json`.
    """

    listen: tuple[str, ...] = ()
    starts_services: bool = True
    join_dir: Path | None = None

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
        self.write_join_file(kind, join.name, join.model_dump(exclude_none=True), run_path)

    def write_join_file(self, kind: str, name: str, fields: Mapping[str, Any], run_path: Path) -> None:
        """Write a join file at once, never half. It holds a secret, so only the owner may read it."""
        folder = (self.join_dir or run_path / "join") / kind
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        written = folder / f".{name}.json"
        written.touch(mode=0o600)
        written.write_text(json.dumps(fields))
        written.replace(folder / f"{name}.json")
