r"""Nodes in a ROS 2 graph over Zenoh: publishers, subscribers, services and their clients, without ROS.

A session is in one domain and speaks for one distribution. It is the router of the graph that nodes of `rmw_zenoh` look
for at tcp/localhost:7447, or joins the one that is there:

    with RosSession.open(RosTypes("jazzy"), endpoint="tcp/localhost:7447") as session:
        node = session.create_node("gslcosim")
        gas = node.create_publisher("/gas", "std_msgs/msg/Float32")
        gas.publish(session.types.make("std_msgs/msg/Float32", data=1.5))
        node.subscribe("/goal", "geometry_msgs/msg/PoseStamped", on_goal)
        session.types.define_service("std_srvs/srv/Trigger", "", "bool success\nstring message")
        node.answer_service("/reset", "std_srvs/srv/Trigger", on_reset)

`on_goal(message)` and `response = on_reset(request)` are called on threads of Zenoh: each subscriber and each service
has its own, so that a service that takes long holds up no other. Messages and requests that are none of the type, or
too long, never reach them: they are reported in one sentence, and a client is answered with an error. A response is
made by `types.make("std_srvs/srv/Trigger_Response", ...)`; an answerer that refuses a request raises `ValueError`.
"""

import json
import logging
import re
import threading
from collections.abc import Callable, Collection
from contextlib import suppress
from types import TracebackType
from typing import Any, Self

import zenoh
import zenoh.ext
import zenoh.handlers

from gslcosim.base.errors import UsageError
from gslcosim.bus.zenoh_bus import build_session_config, open_session
from gslcosim_ros import wire
from gslcosim_ros.ros_graphs import ROS_ENDPOINT
from gslcosim_ros.types import RosTypes
from gslcosim_ros.wire import Attachment, QosProfile, Token

MAX_MESSAGE_BYTES = 16 << 20
CALL_TIMEOUT_S = 10.0
_ENCODING = "application/cdr"
# As rmw_zenoh: how soon a reader learns that the last message was lost.
_HEARTBEAT_S = 0.5
# A burst is faster than the link for a moment; a reader that has stopped is waited for once, and then loses messages.
_WAIT_BEFORE_DROP_US = 50_000
# Of reports: somebody may send nonsense all day.
_MAX_REPORTS = 100
# Where in its own source Zenoh has refused.
_SOURCE_LINE = re.compile(r" at /\S+\.rs:\d+\.?")
_MAX_REPORT_CHARACTERS = 1000

Reporter = Callable[[str], None]
_LOGGER = logging.getLogger(__name__)


class RosSession:
    """Zenoh session in a ROS graph.

    Args:
        session: Open; it is closed with this object.
        types: Of messages and services, of the distribution that the graph has.
        domain: Number of the domain, `ROS_DOMAIN_ID` of others.
        report: Receives a sentence about each thing that others do wrong.
    """

    def __init__(
        self,
        session: zenoh.Session,
        types: RosTypes,
        *,
        domain: int = 0,
        report: Reporter = _LOGGER.warning,
    ) -> None:
        self.types = types
        self.domain = domain
        self._session = session
        self._report = report
        self._reported: set[str] = set()
        self._n_ids = 0
        self._own: list[Token] = []
        # Zenoh takes out of the graph what nobody holds.
        self._nodes: list[RosNode] = []
        self._graph: dict[str, Token] = {}
        self._subscribed: set[str] = set()
        self._graph_lock = threading.Condition()
        liveliness = session.liveliness()
        self._watch = liveliness.declare_subscriber(wire.build_graph_key(domain), self._on_token, history=True)

    @classmethod
    def open(
        cls,
        types: RosTypes,
        *,
        endpoint: str = ROS_ENDPOINT,
        domain: int = 0,
        report: Reporter = _LOGGER.warning,
    ) -> Self:
        """Open a session that is the graph's router, or joins it where another program listens at its endpoint."""
        config = _build_config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps([endpoint]))
        try:
            session = open_session(config)
        except zenoh.ZError as refusal:
            config = _build_config()
            config.insert_json5("mode", '"client"')
            config.insert_json5("connect/endpoints", json.dumps([endpoint]))
            try:
                session = open_session(config)
            except zenoh.ZError:
                raise UsageError(
                    f"endpoint: expected to be the router of ROS nodes at {endpoint}, or to find one there, could not "
                    f"({_SOURCE_LINE.sub('', str(refusal))}). Give another endpoint, such as tcp/localhost:7448."
                ) from refusal
        return cls(session, types, domain=domain, report=report)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the session with all its nodes."""
        if not self._session.is_closed():
            self._session.close()

    def create_node(self, name: str, namespace: str = "/") -> "RosNode":
        """Return a new node, visible in the graph until it or the session is closed.

        Args:
            name: Such as `gslcosim`.
            namespace: Such as `/beetle`.
        """
        node = RosNode(self, name, namespace)
        self._nodes.append(node)
        return node

    def forget_node(self, node: "RosNode") -> None:
        """Hold a node no longer, for it is closed."""
        if node in self._nodes:
            self._nodes.remove(node)

    @property
    def graph(self) -> list[Token]:
        """Nodes and endpoints of the graph that have been seen, own ones among them."""
        with self._graph_lock:
            return list(self._graph.values())

    def wait_for(self, kind: wire.Kind, name: str, timeout_s: float = CALL_TIMEOUT_S) -> Token:
        """Return an endpoint of the graph, and wait until it is there.

        Args:
            kind: `MP` publisher, `MS` subscriber, `SS` service, `SC` client.
            name: Of the topic or service.
        """
        return self.wait_for_any([(kind, name)], timeout_s)

    def wait_for_any(self, endpoints: Collection[tuple[wire.Kind, str]], timeout_s: float = CALL_TIMEOUT_S) -> Token:
        """Return the first of several endpoints, by kind and name, and wait until one is there; see `wait_for`."""

        def find() -> Token | None:
            return next((token for token in self._graph.values() if (token.kind, token.name) in endpoints), None)

        with self._graph_lock:
            token = self._graph_lock.wait_for(find, timeout_s)
        if token is None:
            kind, name = next(iter(endpoints))
            raise TimeoutError(f"{name}: expected an endpoint {kind} within {timeout_s:g} s, found none.")
        return token

    def has_subscriber(self, name: str) -> bool:
        """Return whether anybody subscribes to a topic, with whatever type."""
        return name in self._subscribed

    def report_once(self, text: str) -> None:
        """Report what others do wrong, each thing once, in text that neither floods nor steers a terminal."""
        text = "".join(each if each.isprintable() else "?" for each in text[:_MAX_REPORT_CHARACTERS])
        if text not in self._reported and len(self._reported) < _MAX_REPORTS:
            self._reported.add(text)
            self._report(text)

    # On a thread of Zenoh.
    def _on_token(self, sample: zenoh.Sample) -> None:
        token = Token.parse(key := str(sample.key_expr))
        if token is None:
            return
        with self._graph_lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._graph[key] = token
            else:
                self._graph.pop(key, None)
            self._subscribed = {each.name for each in self._graph.values() if each.kind == wire.SUBSCRIBER}
            self._graph_lock.notify_all()
            if sample.kind != zenoh.SampleKind.PUT:
                return
            own = list(self._own)
        self._report_mismatches(own, [token])

    def _report_mismatches(self, own: list[Token], others: list[Token]) -> None:
        for mine, other in wire.find_mismatches(own, others):
            self.report_once(
                f"{mine.name}: expected {mine.type} with hash {mine.type_hash}, as {self.types.distribution} has it, "
                f"node {other.node} has {other.type} with hash {other.type_hash}: they never meet. Choose the "
                "distribution of that node, or correct its type."
            )

    def next_id(self) -> int:
        """Return the number of a new node or endpoint."""
        self._n_ids += 1
        return self._n_ids - 1

    def declare(self, token: Token) -> zenoh.LivelinessToken:
        """Show a node or an endpoint in the graph until what this returns is undeclared."""
        with self._graph_lock:
            self._own.append(token)
            others = list(self._graph.values())
        self._report_mismatches([token], others)
        return self._session.liveliness().declare_token(token.key)

    @property
    def zenoh(self) -> zenoh.Session:
        """The Zenoh session."""
        return self._session


def _build_config() -> zenoh.Config:
    config = build_session_config(None)
    config.insert_json5("transport/link/tx/queue/congestion_control/drop/wait_before_drop", str(_WAIT_BEFORE_DROP_US))
    return config


class RosNode:
    """Node of a graph; see `RosSession.create_node`."""

    def __init__(self, session: RosSession, name: str, namespace: str) -> None:
        self.name = name
        self.namespace = namespace
        self._session = session
        self._id = session.next_id()
        self._held: list[Any] = [session.declare(self._token(wire.NODE, self._id))]

    def create_publisher(self, topic: str, kind: str, qos: QosProfile | None = None) -> "RosPublisher":
        """Return a publisher of a topic.

        Args:
            topic: Such as `/beetle/gas`.
            kind: Type, such as `sensor_msgs/msg/Imu`.
            qos: Reliable and volatile where absent.
        """
        token = self._endpoint(wire.PUBLISHER, topic, kind, qos or QosProfile())
        publisher = RosPublisher(self._session, token, qos or QosProfile())
        self._held.append(publisher)
        self._held.append(self._session.declare(token))
        return publisher

    def subscribe(
        self,
        topic: str,
        kind: str,
        handler: Callable[[Any], None],
        qos: QosProfile | None = None,
        *,
        max_bytes: int = MAX_MESSAGE_BYTES,
    ) -> None:
        """Call `handler(message)` for each message of a topic, on a thread of its own.

        Args:
            topic: Such as `/beetle/goal`.
            handler: Receives messages; what it raises of `ValueError` is reported.
            qos: With `is_transient_local` messages from before are received, too.
            max_bytes: Longer messages are reported and not read.
        """
        qos = qos or QosProfile()
        token = self._endpoint(wire.SUBSCRIBER, topic, kind, qos)

        def on_sample(sample: zenoh.Sample) -> None:
            try:
                self._check_length(sample.payload, max_bytes)
                handler(self._session.types.from_cdr(sample.payload.to_bytes(), kind))
            except ValueError as error:
                self._session.report_once(f"{topic}: {error}; ignored.")

        callback: Any = zenoh.handlers.Callback(on_sample, indirect=True)
        key = self._key(token)
        if qos.is_transient_local:
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth)
            self._held.append(
                zenoh.ext.declare_advanced_subscriber(self._session.zenoh, key, callback, history=history)
            )
        else:
            self._held.append(self._session.zenoh.declare_subscriber(key, callback))
        self._held.append(self._session.declare(token))

    def answer_service(
        self, name: str, kind: str, answerer: Callable[[Any], Any], *, max_bytes: int = MAX_MESSAGE_BYTES
    ) -> None:
        """Answer each request to a service with `answerer(request)`.

        Requests of one service are answered one after the other, on a thread of its own.

        Args:
            name: Such as `/odor_value`.
            kind: Type of the service, which `RosTypes.define_service` has defined.
            answerer: Takes a message `<kind>_Request` and returns one `<kind>_Response`, or its bytes; where it raises
                `ValueError`, the client gets an error with its text.
            max_bytes: Longer requests are answered with an error.
        """
        types = self._session.types

        def answer(request: "RosRequest") -> None:
            response = answerer(request.message)
            request.answer(response if isinstance(response, bytes) else types.to_cdr(response))

        self.take_requests(name, kind, answer, max_bytes=max_bytes)

    def take_requests(
        self, name: str, kind: str, take: Callable[["RosRequest"], None], *, max_bytes: int = MAX_MESSAGE_BYTES
    ) -> None:
        """Call `take(request)` for each request to a service, which answers it then or later, on any thread.

        Args:
            name: Such as `/navigate_to_pose/_action/get_result`.
            take: Receives requests; where it raises `ValueError`, the client gets an error with its text.
            max_bytes: Longer requests are answered with an error.
        """
        types = self._session.types
        token = self._endpoint(wire.SERVICE, name, kind, QosProfile())

        def on_query(query: zenoh.Query) -> None:
            try:
                payload = query.payload if query.payload is not None else zenoh.ZBytes(b"")
                self._check_length(payload, max_bytes)
                asked = Attachment.from_bytes(query.attachment.to_bytes() if query.attachment is not None else b"")
                take(RosRequest(types.from_cdr(payload.to_bytes(), f"{kind}_Request"), query, asked))
            except ValueError as error:
                self._session.report_once(f"{name}: {error}; refused.")
                with query, suppress(zenoh.ZError):
                    query.reply_err(str(error).encode())
            except BaseException:
                # Whoever waits for it is told that there is no answer.
                query.drop()
                raise

        callback: Any = zenoh.handlers.Callback(on_query, indirect=True)
        self._held.append(self._session.zenoh.declare_queryable(self._key(token), callback, complete=True))
        self._held.append(self._session.declare(token))

    def create_client(self, name: str, kind: str) -> "RosClient":
        """Return a client of a service.

        Args:
            name: Such as `/odor_value`.
        """
        token = self._endpoint(wire.CLIENT, name, kind, QosProfile())
        self._held.append(self._session.declare(token))
        return RosClient(self._session, token)

    def close(self) -> None:
        """Take the node out of the graph, with all its endpoints."""
        while self._held:
            self._held.pop().undeclare()
        self._session.forget_node(self)

    def _token(self, kind: wire.Kind, entity_id: int, **endpoint: str) -> Token:
        return Token(
            domain=self._session.domain,
            session=str(self._session.zenoh.info.zid()),
            node_id=self._id,
            entity_id=entity_id,
            kind=kind,
            namespace=self.namespace,
            node=self.name,
            **endpoint,
        )

    def _endpoint(self, kind: wire.Kind, name: str, type_name: str, qos: QosProfile) -> Token:
        type_hash = self._session.types.hash(type_name)
        return self._token(
            kind, self._session.next_id(), name=wire.check_name(name), type=type_name, type_hash=type_hash, qos=qos.text
        )

    def _key(self, token: Token) -> str:
        return wire.build_key(token.domain, token.name, token.type, token.type_hash)

    def _check_length(self, payload: zenoh.ZBytes, max_bytes: int) -> None:
        if len(payload) > max_bytes:
            raise ValueError(f"expected a message of at most {max_bytes} bytes, was {len(payload)} bytes")


class RosRequest:
    """Request to a service, which is answered once; see `RosNode.take_requests`.

    Attributes:
        message: Of the type `<kind>_Request`.
    """

    def __init__(self, message: Any, query: zenoh.Query, asked: Attachment) -> None:
        self.message = message
        self._query = query
        self._asked = asked

    def answer(self, data: bytes) -> None:
        """Answer with the bytes of a message `<kind>_Response`; nothing happens where the client is gone."""
        # The client knows its request by its own number and identifier.
        attachment = Attachment.now(self._asked.sequence, self._asked.gid).to_bytes()
        with self._query, suppress(zenoh.ZError):
            self._query.reply(self._query.key_expr, data, encoding=_ENCODING, attachment=attachment)


class RosPublisher:
    """Publisher of a topic; see `RosNode.create_publisher`."""

    def __init__(self, session: RosSession, token: Token, qos: QosProfile) -> None:
        self.topic = token.name
        self._session = session
        self._types = session.types
        self._gid = token.gid
        self._sequence = 0
        key = wire.build_key(token.domain, token.name, token.type, token.type_hash)
        keeps_all = qos.is_reliable and qos.depth is None
        congestion = zenoh.CongestionControl.BLOCK if keeps_all else zenoh.CongestionControl.DROP
        if qos.is_transient_local:
            # By numbers, not by stamps of the clock, who comes late knows what it has.
            detection = zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=_HEARTBEAT_S)
            self._publisher: Any = zenoh.ext.declare_advanced_publisher(
                session.zenoh,
                key,
                encoding=_ENCODING,
                congestion_control=congestion,
                cache=zenoh.ext.CacheConfig(max_samples=qos.depth),
                sample_miss_detection=detection,
                publisher_detection=True,
            )
        else:
            self._publisher = session.zenoh.declare_publisher(
                key, encoding=zenoh.Encoding(_ENCODING), congestion_control=congestion
            )

    def publish(self, message: Any) -> None:
        """Send a message of the topic's type."""
        self.publish_cdr(self._types.to_cdr(message))

    def publish_cdr(self, data: bytes) -> None:
        """Send the bytes of a message of the topic's type; nothing happens where the session has ended."""
        self._sequence += 1
        try:
            self._publisher.put(data, attachment=Attachment.now(self._sequence, self._gid).to_bytes())
        except zenoh.ZError:
            if not self._session.zenoh.is_closed():
                raise

    def undeclare(self) -> None:
        """End the publisher."""
        self._publisher.undeclare()


class RosClient:
    """Client of a service; see `RosNode.create_client`."""

    def __init__(self, session: RosSession, token: Token) -> None:
        self._session = session
        self._name = token.name
        self._type = token.type
        self._key = wire.build_key(token.domain, token.name, token.type, token.type_hash)
        self._gid = token.gid
        self._sequence = 0

    def call(self, request: Any, *, timeout_s: float = CALL_TIMEOUT_S) -> Any:
        """Return the response of the service to a request.

        Args:
            request: A message of the type `<kind>_Request`.
        """
        types = self._session.types
        self._sequence += 1
        replies = self._session.zenoh.get(
            self._key,
            payload=types.to_cdr(request),
            attachment=Attachment.now(self._sequence, self._gid).to_bytes(),
            encoding=_ENCODING,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout_s,
        )
        for reply in replies:
            if reply.ok is not None:
                return types.from_cdr(reply.ok.payload.to_bytes(), f"{self._type}_Response")
            if reply.err is not None and (text := reply.err.payload.to_bytes().decode(errors="replace")) != "Timeout":
                raise ValueError(text)
        raise TimeoutError(f"{self._name}: expected an answer within {timeout_s:g} s, got none.")
