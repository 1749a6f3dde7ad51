"""What one participant needs to go on from a tick, as bytes in a file, and whose code can make use of it."""

import functools
import hashlib
import inspect
import platform
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgpack  # pyright: ignore[reportMissingTypeStubs]

import gslcosim
from gslcosim._code_identity import COMPUTING_PACKAGES, code_hash, package_files
from gslcosim.contract.schema import contract_hash
from gslcosim.errors import SnapshotError
from gslcosim.runtime.run_dir import cpu_flags, package_version

SCHEMA = "gslcosim/snapshot/1"
# What a state is made of, and what computes what follows from it.
_CODE = (
    "cameras", "contract", "environment", "events", "fields", "radio", "referee", "scenario", "sensing", "states",
    "vehicles", "world", "runtime/snapshots", "runtime/gate.py", "runtime/stepper.py", "rng.py", "ticks.py",
)  # fmt: skip
_msgpack: Any = msgpack


@dataclass(frozen=True, kw_only=True)
class Identity:
    """Whose state it is: the contract, hashes of code and processor, versions of packages."""

    contract: str
    code: str
    processor: str
    packages: str
    version: str

    @classmethod
    @functools.cache
    def of_this(cls) -> "Identity":
        """Return that of this process."""
        processor = f"{platform.machine()} {cpu_flags()}".encode()
        return cls(
            contract=contract_hash(),
            code=code_hash(package_files(*_CODE)),
            processor=hashlib.blake2b(processor, digest_size=8).hexdigest(),
            packages=", ".join(f"{name} {package_version(name)}" for name in COMPUTING_PACKAGES),
            version=gslcosim.__version__,
        )

    def difference_to(self, other: "Identity") -> str:
        """Return in which respect another cannot use the state, empty where it can."""
        if self.contract != other.contract:
            return f"another contract ({self.contract}, flown by gslcosim {self.version})"
        if self.packages != other.packages:
            return f"other packages ({self.packages})"
        if self.processor != other.processor:
            return "another processor"
        return f"other code (gslcosim {self.version})" if self.code != other.code else ""


@dataclass(frozen=True, kw_only=True)
class SnapshotPart:
    """What one participant needs to go on with the step of `tick`.

    `state` is that of its core, `memory` that of its gate, `trails` are its chains of hashes by port, and `outputs` the
    messages, as (port, payload), that somebody may still need. `made_by` hashes the code of a core of another package.
    """

    participant: str
    tick: int
    state: Mapping[str, Any]
    memory: Mapping[str, Any]
    trails: Mapping[str, Any]
    outputs: list[tuple[str, bytes]]
    made_by: str = ""

    def to_bytes(self) -> bytes:
        """Return what a file of it holds."""
        body = zlib.compress(_msgpack.packb(vars(self)), 1)
        head = {"schema": SCHEMA, "identity": asdict(Identity.of_this()), "hash": _hash(body)}
        return _msgpack.packb([head, body])

    @classmethod
    def from_bytes(cls, data: bytes) -> "SnapshotPart":
        """Return what a file holds.

        Raises:
            SnapshotError: it is damaged, or of other code; the text is a reason after "it is".
        """
        try:
            head, body = _msgpack.unpackb(data)
            is_whole = head["schema"] == SCHEMA and head["hash"] == _hash(body)
            identity = Identity(**head["identity"]) if is_whole else None
        except (ValueError, KeyError, TypeError, msgpack.UnpackException) as error:
            raise SnapshotError(f"damaged ({error})") from error
        if identity is None:
            raise SnapshotError("damaged")
        if difference := identity.difference_to(Identity.of_this()):
            raise SnapshotError(f"of {difference}")
        fields: dict[str, Any] = _msgpack.unpackb(zlib.decompress(body), strict_map_key=False)
        fields["outputs"] = [(str(port), bytes(payload)) for port, payload in fields["outputs"]]
        return cls(**fields)


def maker_of(core: object) -> str:
    """Return a hash of the file of a core of another package, whose version says nothing; empty for our own."""
    if type(core).__module__.startswith("gslcosim."):
        return ""
    try:
        return _hash(Path(inspect.getfile(type(core))).read_bytes())
    except (OSError, TypeError):
        return ""


def _hash(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=16).hexdigest()
