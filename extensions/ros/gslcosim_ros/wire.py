"""Wire format of `rmw_zenoh`: keys of topics and services, liveliness tokens, quality of service, attachments.

Pure text and bytes; `node` puts them on Zenoh.
Source: ros2/rmw_zenoh, docs/design.md and rmw_zenoh_cpp/src/detail/{liveliness_utils,attachment_helpers}.cpp, and what
the peers in tests send.
"""

import re
import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

NO_HASH = "TypeHashNotSupported"
"""Stands for the hash of a type in distributions that have none: humble."""

Kind = Literal["NN", "MP", "MS", "SS", "SC"]
NODE, PUBLISHER, SUBSCRIBER, SERVICE, CLIENT = "NN", "MP", "MS", "SS", "SC"
_LIVELINESS = "@ros2_lv"
# Where a slash would begin another part of a key, and for what is empty: the root namespace, no enclave.
_MANGLED_SLASH = "%"
# rmw_zenoh's default depth, which its quality of service leaves out.
_DEFAULT_DEPTH = 42
_ATTACHMENT = struct.Struct("<qqB16s")
_GID_BYTES = 16
_NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_TYPE = re.compile(r"([a-z][a-z0-9_]*)/(msg|srv|action)/([A-Za-z][A-Za-z0-9_]*)")


@dataclass(frozen=True, kw_only=True)
class QosProfile:
    """Quality of service of an endpoint.

    Attributes:
        is_reliable: False: best effort.
        is_transient_local: True: who comes late still gets the last `depth` messages.
        depth: How many messages are kept; None: all.
    """

    is_reliable: bool = True
    is_transient_local: bool = False
    depth: int | None = 10

    @property
    def text(self) -> str:
        """The profile as tokens have it: `reliability:durability:history,depth:deadline:lifespan:liveliness`."""
        reliability = "" if self.is_reliable else "2"
        durability = "1" if self.is_transient_local else ""
        kept = "" if self.depth == _DEFAULT_DEPTH else str(self.depth)
        history = "2," if self.depth is None else f",{kept}"
        return f"{reliability}:{durability}:{history}:,:,:,,"

    @property
    def recorded_text(self) -> str:
        """The profile as bags have it: YAML of a list of one, with numbers, which all rosbag2 read."""
        lasting = "{sec: 9223372036, nsec: 854775807}"
        return (
            f"- history: {2 if self.depth is None else 1}\n  depth: {self.depth or 0}\n"
            f"  reliability: {1 if self.is_reliable else 2}\n  durability: {1 if self.is_transient_local else 2}\n"
            f"  deadline: {lasting}\n  lifespan: {lasting}\n"
            f"  liveliness: 1\n  liveliness_lease_duration: {lasting}\n  avoid_ros_namespace_conventions: false"
        )


LATCHED = QosProfile(is_transient_local=True, depth=1)


def check_name(name: str) -> str:
    """Return a fully qualified name of a topic or service."""
    if not _NAME.fullmatch(name):
        raise ValueError(f"expected a name such as /beetle/gas of letters, digits and underscores, was {name!r}")
    return name


def mangle_type(kind: str) -> str:
    """Return the name of a type on the wire: `std_msgs::msg::dds_::Float32_` for `std_msgs/msg/Float32`."""
    match = _TYPE.fullmatch(kind)
    if match is None:
        raise ValueError(f"expected a type such as std_msgs/msg/Float32, was {kind!r}")
    package, group, name = match.groups()
    return f"{package}::{group}::dds_::{name}_"


def demangle_type(dds_type: str) -> str:
    """Return the name of a type as ROS has it; the inverse of `mangle_type`. Other texts come back as they are."""
    package, _, rest = dds_type.partition("::")
    group, _, name = rest.partition("::dds_::")
    return f"{package}/{group}/{name.removesuffix('_')}" if name else dds_type


def build_key(domain: int, name: str, kind: str, type_hash: str) -> str:
    """Return the key of a topic or a service."""
    return f"{domain}/{check_name(name).strip('/')}/{mangle_type(kind)}/{type_hash}"


@dataclass(frozen=True, kw_only=True)
class Token:
    """Liveliness token of a node or of one of its endpoints: what a graph consists of.

    Attributes:
        domain: The domain's number.
        session: The Zenoh identifier of the session.
        node_id: The node's number in its session.
        entity_id: The endpoint's number in its session; the node's own for a node.
        kind: `NN` node, `MP` publisher, `MS` subscriber, `SS` service, `SC` client.
        namespace: Of the node, such as `/` or `/beetle`.
        node: The node's name.
        name: Fully qualified, of the topic or service; empty for a node.
        type: Such as `std_msgs/msg/Float32`; empty for a node.
        type_hash: Of the type; empty for a node.
        qos: Quality of service as text; empty for a node.
    """

    domain: int
    session: str
    node_id: int
    entity_id: int
    kind: Kind
    namespace: str
    node: str
    name: str = ""
    type: str = ""
    type_hash: str = ""
    qos: str = ""

    @property
    def key(self) -> str:
        """The key of the token."""
        parts = [
            _LIVELINESS, str(self.domain), self.session, str(self.node_id), str(self.entity_id), self.kind,
            _MANGLED_SLASH, _mangle_name(self.namespace), _mangle_name(self.node),
        ]  # fmt: skip
        if self.kind != NODE:
            parts += [_mangle_name(self.name), mangle_type(self.type), self.type_hash, self.qos]
        return "/".join(parts)

    @property
    def gid(self) -> bytes:
        """Global identifier of the endpoint: XXH3-128 of its key, low 64 bits first, 16 bytes."""
        import xxhash

        return xxhash.xxh3_128_intdigest(self.key.encode()).to_bytes(_GID_BYTES, "little")

    @classmethod
    def parse(cls, key: str) -> Self | None:
        """Return the token of a key; None where it is none, for keys come from anybody."""
        parts = key.split("/")
        try:
            prefix, domain, session, node_id, entity_id, kind, _, namespace, node, *rest = parts
            if prefix != _LIVELINESS or kind not in (NODE, PUBLISHER, SUBSCRIBER, SERVICE, CLIENT):
                return None
            name, dds_type, type_hash, qos = rest if kind != NODE else ("", "", "", "")
            return cls(
                domain=int(domain), session=session, node_id=int(node_id), entity_id=int(entity_id), kind=kind,
                namespace=_demangle_name(namespace), node=_demangle_name(node), name=_demangle_name(name),
                type=demangle_type(dds_type), type_hash=type_hash, qos=qos,
            )  # fmt: skip
        except ValueError:
            return None


def build_graph_key(domain: int) -> str:
    """Return the key that covers all tokens of a domain; no `**` covers it, for its first part begins with `@`."""
    return f"{_LIVELINESS}/{domain}/**"


def _mangle_name(name: str) -> str:
    return name.replace("/", _MANGLED_SLASH)


def _demangle_name(name: str) -> str:
    return name.replace(_MANGLED_SLASH, "/")


@dataclass(frozen=True, kw_only=True)
class Attachment:
    """Number, time and writer of a message, which travel beside it in 33 bytes.

    Attributes:
        sequence: Number of the message of its writer, from 1.
        stamp_ns: When it was sent, by the wall clock [ns since 1970]; part of no result.
        gid: Global identifier of its writer, 16 bytes.
    """

    sequence: int
    stamp_ns: int
    gid: bytes

    @classmethod
    def now(cls, sequence: int, gid: bytes) -> Self:
        """Return the attachment of a message that is sent now."""
        return cls(sequence=sequence, stamp_ns=time.time_ns(), gid=gid)

    def to_bytes(self) -> bytes:
        """Return int64 sequence, int64 stamp, one byte with the length of the identifier, and it; little-endian."""
        return _ATTACHMENT.pack(self.sequence, self.stamp_ns, _GID_BYTES, self.gid)

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """Return an attachment from its bytes."""
        if len(data) != _ATTACHMENT.size:
            raise ValueError(f"expected an attachment of {_ATTACHMENT.size} bytes, was {len(data)} bytes")
        sequence, stamp_ns, n_gid_bytes, gid = _ATTACHMENT.unpack(data)
        if n_gid_bytes != _GID_BYTES:
            raise ValueError(
                f"expected an attachment with an identifier of {_GID_BYTES} bytes, was {n_gid_bytes} bytes"
            )
        return cls(sequence=sequence, stamp_ns=stamp_ns, gid=gid)


def find_mismatches(own: Sequence[Token], others: Sequence[Token]) -> list[tuple[Token, Token]]:
    """Return the pairs of an own endpoint and another's that have a name in common and do not meet on the wire.

    Their types or the hashes of these differ, so that neither ever gets a message of the other.
    """
    facing = {PUBLISHER: SUBSCRIBER, SUBSCRIBER: PUBLISHER, SERVICE: CLIENT, CLIENT: SERVICE}
    return [
        (mine, other)
        for mine in own
        for other in others
        if mine.kind != NODE
        and other.kind == facing[mine.kind]
        and mine.name == other.name
        and (mine.type, mine.type_hash) != (other.type, other.type_hash)
    ]
