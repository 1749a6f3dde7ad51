"""The file with which another host joins a run: what it holds, for a service or an agent, and what this host adds."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from gslcosim.bus.port import Certificate, Join, MemberName, Secret, problem_text, read_join_file
from gslcosim.errors import UsageError


class GatewayJoin(BaseModel):
    """Connection of an agent behind the gateway: the address, the token that it sends first, and its frames.

    `agents` names the agents that its process flies where they are several.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    name: MemberName
    gateway: Annotated[
        str, StringConstraints(pattern=r"^(tcp:[A-Za-z0-9_.:%\[\]-]{1,300}:[0-9]{1,5}|unix:/[^\x00-\x1f]{1,4096})$")
    ]
    token: Secret
    format: Literal["msgpack", "json"] = "msgpack"
    agents: Annotated[tuple[MemberName, ...], Field(min_length=1, max_length=1000)] | None = None


@dataclass(frozen=True, kw_only=True)
class JoinFile:
    """Content of a join file: how to join the bus, or how an agent connects to the gateway; one of the two."""

    path: Path
    join: Join | None
    gateway: GatewayJoin | None

    @classmethod
    def read(
        cls, path: Path, *, wait_s: float = 0.0, endpoint: str | None = None, client: Certificate | None = None
    ) -> "JoinFile":
        """Read a join file.

        Args:
            path: The file.
            wait_s: For how long it is waited for where it is not there yet [s].
            endpoint: Where the run is reached from here; absent: as the file says.
            client: The client certificate of this host.

        Raises:
            UsageError: there is no such file, it is something else, or the run wants another certificate.
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
                return cls(path=path, join=None, gateway=GatewayJoin.model_validate(known))
            except ValidationError as error:
                raise UsageError(f"{place}: expected JSON as `gslcosim up` writes it; {problem_text(error)}") from error
        # What only a process has that the run's own host starts.
        join = Join.from_text(text, place=place).model_copy(update={"mesh": None, "is_watched": False})
        if endpoint is not None:
            join = join.model_copy(update={"endpoint": endpoint})
        return cls(path=path, join=_with_certificate(join, client), gateway=None)

    @property
    def is_of_agent(self) -> bool:
        """Whether it lets an agent join and no service."""
        return self.join is None or self.join.run_dir is None

    @property
    def name(self) -> str:
        """The participant that it was written for."""
        data = self.join or self.gateway
        return self.path.stem if data is None else data.name


def _with_certificate(join: Join, client: Certificate | None) -> Join:
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
            "tls_client_certificate": client.certificate.read_text(),
            "tls_client_key": client.private_key.read_text(),
        }
    )
