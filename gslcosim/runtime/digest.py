"""Digests of a run: a hash chained over each port's messages, cut at the tick that ended the run."""

import base64
import hashlib
import json
from array import array
from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, TypedDict

import msgspec

from gslcosim.base.checksums import check_files
from gslcosim.base.errors import UsageError, build_machine_error
from gslcosim.base.files import replace_file
from gslcosim.base.untrusted_input import FROM_A_COPY, JsonObject, read_json, validate_value

SCHEMA = "gslcosim/digest/1"
LINK_BYTES = 8
_EMPTY_LINK = bytes(LINK_BYTES)
# A run of a million ticks has some 500 MB.
_MAX_BYTES = 8_000_000_000


class HashChainFields(TypedDict):
    """A `HashChain` as msgpack and JSON can carry it: the links as Base64."""

    ticks: list[int]
    links: str


class _PortTrail(HashChainFields):
    participant: str


class _DigestFile(TypedDict):
    final_tick: Annotated[int, msgspec.Meta(ge=0, lt=1 << 62)]
    ports: dict[str, _PortTrail]


@dataclass
class HashChain:
    """The chain of one port: after each message the hash of the link before, the tick and the message's bytes."""

    # Whole machine words: as Python's numbers they would be the most that a long run keeps.
    ticks: "array[int]" = field(default_factory=partial(array, "q"))
    links: bytearray = field(default_factory=bytearray)

    def append(self, tick: int, payload: bytes) -> None:
        """Chain a message."""
        chained = self.links[-LINK_BYTES:] + tick.to_bytes(8, "big") + payload
        self.ticks.append(tick)
        self.links += hashlib.blake2b(chained, digest_size=LINK_BYTES).digest()

    def until(self, final_tick: int) -> "HashChain":
        """Return the chain without what came after a tick."""
        n = sum(tick <= final_tick for tick in self.ticks)
        return HashChain(self.ticks[:n], self.links[: n * LINK_BYTES])

    def link(self, index: int) -> bytes:
        """Return the hash after the message of that index; -1 is the last, and an empty chain has zeros."""
        at = range(0, len(self.links), LINK_BYTES)
        return bytes(self.links[at[index] : at[index] + LINK_BYTES]) if at else _EMPTY_LINK

    def as_fields(self) -> HashChainFields:
        """Return the chain as fields of messages and files."""
        return {"ticks": self.ticks.tolist(), "links": base64.b64encode(self.links).decode()}

    @classmethod
    def from_fields(cls, fields: HashChainFields) -> "HashChain":
        """Return the chain from `as_fields`."""
        trail = cls(array("q", fields["ticks"]), bytearray(base64.b64decode(fields["links"])))
        if len(trail.links) != len(trail.ticks) * LINK_BYTES:
            raise ValueError(f"{len(trail.links)} bytes of links for {len(trail.ticks)} ticks")
        return trail


@dataclass(frozen=True)
class RunDigest:
    """The chains of all ports of a run, each with the participant that wrote it, up to the final tick."""

    final_tick: int
    writer_of: dict[str, str]
    trails: dict[str, HashChain]

    @classmethod
    def of(cls, trails: Mapping[str, HashChain], writer_of: Mapping[str, str], final_tick: int) -> "RunDigest":
        """Return the digest of whole chains, without what came after the final tick."""
        cut = {port: trail.until(final_tick) for port, trail in trails.items()}
        return cls(final_tick, {port: writer_of[port] for port in trails}, cut)

    def without(self, ports: Set[str], *, final_tick: int | None = None) -> "RunDigest":
        """Return the digest without some ports, and without what came after a tick."""
        kept = {port: trail for port, trail in self.trails.items() if port not in ports}
        return RunDigest.of(kept, self.writer_of, self.final_tick if final_tick is None else final_tick)

    @property
    def hex(self) -> str:
        """The digest of the run: equal for equal runs."""
        total = hashlib.blake2b(digest_size=16)
        total.update(self.final_tick.to_bytes(8, "big"))
        for port in sorted(self.trails):
            total.update(port.encode() + b"\0" + len(self.trails[port].ticks).to_bytes(8, "big"))
            total.update(self.trails[port].link(-1))
        return total.hexdigest()

    def save(self, path: Path) -> None:
        """Write `digest.json` at once."""
        ports = {
            port: {"participant": self.writer_of[port], **trail.as_fields()}
            for port, trail in sorted(self.trails.items())
        }
        content = {"schema": SCHEMA, "digest": self.hex, "final_tick": self.final_tick, "ports": ports}
        try:
            replace_file(path.parent, path.name, (json.dumps(content) + "\n").encode())
        except OSError as error:
            raise build_machine_error(error, path.name, "a file that can be written", path=path) from error

    @classmethod
    def load(cls, path: Path) -> "RunDigest":
        """Read `digest.json`."""
        read = read_json(path, JsonObject, max_bytes=_MAX_BYTES)
        if read.get("schema") != SCHEMA:
            found = str(read.get("schema"))[:80]
            raise UsageError(f"{path.name}: expected {SCHEMA}, was {found!r}. {FROM_A_COPY}\nFile: {path}")
        content = validate_value(read, _DigestFile, place=f"{path.parent.name}/{path.name}")
        ports = content["ports"]
        try:
            trails = {port: HashChain.from_fields(fields) for port, fields in ports.items()}
        except (ValueError, OverflowError) as error:
            raise UsageError(
                f"{path.name}: expected ticks with a link each, was {error}. {FROM_A_COPY}\nFile: {path}"
            ) from error
        check_files(path.parent, path.name)
        return cls(content["final_tick"], {port: ports[port]["participant"] for port in ports}, trails)
