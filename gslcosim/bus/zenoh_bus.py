"""The bus over Zenoh: a router embedded in the supervisor, a client session in every other process."""
# Zenoh's stubs leave many types open.
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# pyright: reportUnknownVariableType=false

import base64
import contextlib
import json
import secrets
import sys
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Self

import zenoh
import zenoh.handlers

from gslcosim.bus.access import SERVICE_USER, AgentUser, access_control
from gslcosim.bus.port import Answerer, Certificate, Handler, Join, Mailbox
from gslcosim.bus.queued_mailbox import QueuedMailbox
from gslcosim.bus.zenoh_mailbox import ZenohMailbox
from gslcosim.bus.zenoh_mesh import is_router_lost, joining_mesh
from gslcosim.bus.zenoh_sessions import open_session, open_with_patience, set_unread_limit
from gslcosim.errors import SimulationFault

# How soon others learn that a member elsewhere hangs without its process having ended [ms], where its join data do not
# say.
LEASE_MS = 2500
# How long members elsewhere put up with a router that is silent, because the supervisor is paused [ms].
ROUTER_LEASE_MS = 60_000
# Processes of this machine are seen to end and to be stopped: their silence means nothing, and is not waited for.
PATIENCE_MS = 24 * 60 * 60 * 1000
# For so long the router waits for a member that does not read before it closes its link; longer than a process may be
# stopped. Meanwhile others wait, too.
UNREAD_LIMIT_MS = 10_000
CLOSE_LIMIT_S = 5.0
# Stands for a segment of a key that no participant has.
WAKE = "-"


# A callback waits for the interpreter until its holder gives way; Python's 5 ms would be the latency of a run.
SWITCH_INTERVAL_S = 0.0002


class ZenohBus:
    """A Zenoh session seen as a `Bus`.

    Zenoh's own queues are bounded and drop or disconnect when full; all handlers here must only enqueue.
    """

    def __init__(self, session: zenoh.Session, namespace: str) -> None:
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self._session = session
        self._prefix = f"{namespace}/"
        self._publishers: dict[tuple[str, bool], zenoh.Publisher] = {}
        self._held: list[Any] = []  # Zenoh undeclares what nobody holds
        self._tokens: dict[str, zenoh.LivelinessToken] = {}

    @classmethod
    def open_member(cls, join: Join) -> Self:
        """Connect a process to the run's router.

        Raises:
            MachineError: the machine lacks what a session needs.
            SimulationFault: nothing answers at the endpoint, or name and password are refused.
        """
        elsewhere_ms = LEASE_MS if join.lease_s is None else round(1000 * join.lease_s)
        config = session_config(join.namespace, lease_ms=PATIENCE_MS if join.is_watched else elsewhere_ms)
        if join.is_watched or join.lease_s is not None:
            set_unread_limit(config, PATIENCE_MS if join.is_watched else elsewhere_ms)
        if not join.is_watched:
            _compress(config)
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([join.endpoint]))
        config.insert_json5("listen/endpoints", "[]")
        if join.tls_root_ca is not None:
            _insert_base64(config, "root_ca_certificate_base64", join.tls_root_ca)
        if join.tls_client_certificate is not None and join.tls_client_key is not None:
            config.insert_json5("transport/link/tls/enable_mtls", "true")
            _insert_base64(config, "connect_certificate_base64", join.tls_client_certificate)
            _insert_base64(config, "connect_private_key_base64", join.tls_client_key)
        config.insert_json5("transport/auth/usrpwd/user", json.dumps(join.user))
        config.insert_json5("transport/auth/usrpwd/password", json.dumps(join.password))
        # Whoever is watched is ended with the supervisor, so a router that is silent is one that is stopped.
        endpoint = join.endpoint if join.is_watched else ""
        try:
            with joining_mesh(config, join):
                session = open_with_patience(lambda: open_session(config), endpoint)
                return cls(session, join.namespace)
        except zenoh.ZError as error:
            raise SimulationFault(
                f"{join.name}: expected the run's router at {join.endpoint}, could not join it. Either the run has "
                f"ended, or {_what_is_refused(join)} refused. ({error})"
            ) from error

    @classmethod
    def open_router(
        cls,
        *,
        endpoints: Iterable[str],
        namespace: str,
        service_password: str,
        agents: Iterable[AgentUser],
        secrets_dir: Path,
        tls: Certificate | None = None,
        lease_s: float = 0.0,
    ) -> Self:
        """Open the run's router, with one account for the services and one for each process that flies agents.

        It is confined to `agents/<name>/**` of its agents: it may write their commands and their liveliness tokens
        there and read the rest of it; everything else is denied in both directions.
        Who is cut off keeps its place for `lease_s`, the longest lease of those elsewhere.

        Raises:
            MachineError: the machine lacks what a session needs.
            SimulationFault: an endpoint cannot be listened on.
        """
        agents, endpoints = list(agents), list(endpoints)
        accounts = secrets_dir / "accounts"
        accounts.touch(mode=0o600)
        lines = [f"{SERVICE_USER}:{service_password}", *(f"{a.user}:{a.password}" for a in agents)]
        accounts.write_text("\n".join(lines) + "\n")
        is_local = all(endpoint.startswith("unixsock-stream/") for endpoint in endpoints)
        config = session_config(namespace, lease_ms=PATIENCE_MS if is_local else ROUTER_LEASE_MS)
        set_unread_limit(config, max(UNREAD_LIMIT_MS, round(1000 * lease_s)))
        if not is_local:
            _compress(config)
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps(endpoints))
        if tls is not None:
            config.insert_json5("transport/link/tls/listen_certificate", json.dumps(str(tls.certificate)))
            config.insert_json5("transport/link/tls/listen_private_key", json.dumps(str(tls.private_key)))
            if tls.client_ca is not None:
                config.insert_json5("transport/link/tls/enable_mtls", "true")
                config.insert_json5("transport/link/tls/root_ca_certificate", json.dumps(str(tls.client_ca)))
        config.insert_json5("transport/auth/usrpwd/dictionary_file", json.dumps(str(accounts)))
        config.insert_json5("transport/auth/usrpwd/user", json.dumps(SERVICE_USER))
        config.insert_json5("transport/auth/usrpwd/password", json.dumps(service_password))
        config.insert_json5("access_control", json.dumps(access_control(namespace, agents)))
        try:
            return cls(open_session(config), namespace)
        except zenoh.ZError as error:
            raise SimulationFault(f"router: expected to listen on {endpoints}, could not: {error}") from error
        finally:
            # The router has read it; agents of the same user could.
            accounts.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publish(self, key: str, payload: bytes, *, encoding: str = "", urgent: bool = False) -> None:
        """Send bytes to all subscribers of a key; see `Bus`."""
        publisher = self._publishers.get((key, urgent))
        if publisher is None:
            publisher = self._session.declare_publisher(
                key,
                encoding=zenoh.Encoding(encoding or "application/msgpack"),
                congestion_control=zenoh.CongestionControl.BLOCK,
                express=urgent,
            )
            self._publishers[key, urgent] = publisher
        publisher.put(payload)

    def subscribe(
        self,
        key: str,
        handler: Handler,
        *,
        max_bytes: int | None = None,
        on_longer: Callable[[str, int], None] = lambda _key, _n_bytes: None,
    ) -> None:
        """Call `handler(key, payload)` for each message; see `Bus`.

        A payload of more than `max_bytes` is not even copied: `on_longer(key, n_bytes)` is told of it instead.
        """

        def on_sample(sample: zenoh.Sample) -> None:
            n_bytes = len(sample.payload)
            if max_bytes is not None and n_bytes > max_bytes:
                on_longer(self._relative(sample.key_expr), n_bytes)
            else:
                handler(self._relative(sample.key_expr), sample.payload.to_bytes())

        # Indirect: the network's thread must not wait for the interpreter, or the router forwards nothing meanwhile.
        callback: Any = zenoh.handlers.Callback(on_sample, indirect=True)
        self._held.append(self._session.declare_subscriber(key, callback))

    def mailbox(self, key: str | None = None) -> Mailbox:
        """Return a mailbox; see `Bus`."""
        if key is None:
            return QueuedMailbox()
        return ZenohMailbox(self._session, self._prefix, key, key.replace("$*", "").replace("*", WAKE))

    def answer(self, key: str, answerer: Answerer) -> None:
        """Answer each question put to a key; see `Bus`."""

        def reply(query: zenoh.Query) -> None:
            with query:
                question = query.payload.to_bytes() if query.payload else b""
                for payload in answerer(question):
                    query.reply(query.key_expr, payload)

        self._held.append(self._session.declare_queryable(key, reply))

    def ask(self, key: str, payload: bytes, handler: Handler) -> None:
        """Put a question to a key; see `Bus`."""

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                handler(self._relative(reply.ok.key_expr), reply.ok.payload.to_bytes())

        # All replies of one to one question count, as each is another message.
        every, each = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
        try:
            self._session.get(key, on_reply, payload=payload, target=every, consolidation=each)
        except zenoh.ZError:
            # Nobody answers any more; who looks at a run from a thread of its own may ask as it is closed.
            if not self._session.is_closed():
                raise

    def declare_alive(self, key: str) -> None:
        """Show a liveliness token; see `Bus`."""
        self._tokens[key] = self._session.liveliness().declare_token(key)

    def withdraw_alive(self, key: str) -> None:
        """Take back a liveliness token; see `Bus`."""
        self._tokens.pop(key).undeclare()

    def watch_alive(self, key: str, handler: Callable[[str, bool], None]) -> None:
        """Call `handler(key, is_alive)` for each token; see `Bus`."""
        self._held.append(
            self._session.liveliness().declare_subscriber(
                key,
                lambda sample: handler(self._relative(sample.key_expr), sample.kind == zenoh.SampleKind.PUT),
                history=True,
            )
        )

    def on_disconnect(self, handler: Callable[[], None]) -> None:
        """Call `handler()` when the link to the router is lost."""
        self._held.append(
            self._session.info.declare_transport_events_listener(
                lambda event: handler() if is_router_lost(event) else None
            )
        )

    def close(self) -> None:
        """End the session; see `Bus`. It can block for seconds on a bad link, so it is given a limit."""
        if self._session.is_closed():
            return
        closing = threading.Thread(target=self._close_quietly, daemon=True)
        try:
            closing.start()
        except RuntimeError:
            # No memory for a thread: the session ends with the process.
            return
        closing.join(CLOSE_LIMIT_S)

    def _close_quietly(self) -> None:
        with contextlib.suppress(zenoh.ZError):
            self._session.close()

    def _relative(self, key: object) -> str:
        return str(key).removeprefix(self._prefix)


def new_password() -> str:
    """Return a fresh random password; it has no influence on a run's results."""
    return secrets.token_urlsafe(18)


def session_config(namespace: str | None, *, lease_ms: int = LEASE_MS) -> zenoh.Config:
    """Return what all sessions of a run have in common; without a namespace their keys are whole.

    Args:
        namespace: Comes before all keys.
        lease_ms: How long the session may be silent before the other side gives it up; each side tells its own.
    """
    # Multicast and gossip off: runs never meet. Shared memory off: it drops messages on a loaded machine.
    config = zenoh.Config()
    if namespace is not None:
        config.insert_json5("namespace", json.dumps(namespace))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("scouting/delay", "0")
    config.insert_json5("timestamping/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")
    config.insert_json5("transport/link/tx/lease", str(lease_ms))
    config.insert_json5("transport/link/tx/keep_alive", "4")
    return config


# Used on a link whose both ends have it: keys of messages come again and again.
def _compress(config: zenoh.Config) -> None:
    config.insert_json5("transport/unicast/compression/enabled", "true")


def _insert_base64(config: zenoh.Config, key: str, pem: str) -> None:
    config.insert_json5(f"transport/link/tls/{key}", json.dumps(base64.b64encode(pem.encode()).decode()))


def _what_is_refused(join: Join) -> str:
    account = f"user {join.user!r} and its password"
    return f"{account}, or the client certificate, were" if join.needs_tls_client else f"{account} were"
