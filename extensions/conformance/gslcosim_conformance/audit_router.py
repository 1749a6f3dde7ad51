"""Router that lets an agent do what a run's router denies, and records it: for checking agents, never for runs."""
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# pyright: reportUnknownVariableType=false

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import zenoh
import zenoh.handlers

from gslcosim.base.errors import SimulationFault
from gslcosim.bus.interface import MessageHandler
from gslcosim.bus.zenoh_bus import SERVICE_ACCOUNT, AgentAccount, build_session_config, generate_password, open_session


class AuditRouter:
    """Router for one agent that records everything the agent writes, on whatever key.

    The agent needs its user and password as in a run, but no access control stands in its way: what it writes, asks or
    subscribes to outside its own keys arrives here instead of vanishing. Keys are whole, namespace included, so that an
    agent that has forgotten its namespace is recorded too.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._held: list[Any] = []  # Zenoh undeclares what nobody holds

    @classmethod
    def open(cls, *, endpoint: str, agent: AgentAccount, secrets_dir: Path) -> Self:
        """Open the router.

        Args:
            endpoint: Where it listens.
            agent: The one account besides the router's own.
            secrets_dir: A private folder for the file with the accounts.
        """
        own_password = generate_password()
        accounts = secrets_dir / "accounts"
        accounts.touch(mode=0o600)
        accounts.write_text(f"{SERVICE_ACCOUNT}:{own_password}\n{agent.user}:{agent.password}\n")
        config = build_session_config(None)
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps([endpoint]))
        config.insert_json5("transport/auth/usrpwd/dictionary_file", json.dumps(str(accounts)))
        config.insert_json5("transport/auth/usrpwd/user", json.dumps(SERVICE_ACCOUNT))
        config.insert_json5("transport/auth/usrpwd/password", json.dumps(own_password))
        try:
            return cls(open_session(config))
        except zenoh.ZError as error:
            raise SimulationFault(f"router: expected to listen on {endpoint}, could not: {error}") from error

    def watch(
        self, *, on_put: MessageHandler, on_question: MessageHandler, on_alive: Callable[[str, bool], None]
    ) -> None:
        """Hear everything the agent writes, asks, and shows as alive; handlers only enqueue.

        What this router publishes itself is not among it.
        """

        def receive_sample(sample: zenoh.Sample) -> None:
            on_put(str(sample.key_expr), sample.payload.to_bytes())

        def receive_query(query: zenoh.Query) -> None:
            with query:
                on_question(str(query.key_expr), b"")

        callback: Any = zenoh.handlers.Callback(receive_sample, indirect=True)
        self._held.append(self._session.declare_subscriber("**", callback))
        self._held.append(self._session.declare_queryable("**", receive_query))
        self._held.append(
            self._session.liveliness().declare_subscriber(
                "**",
                lambda sample: on_alive(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT),
                history=True,
            )
        )

    def publish(self, key: str, payload: bytes, *, encoding: str = "") -> None:
        """Send bytes to the agent's subscribers of a key."""
        self._publisher(key, encoding).put(payload)

    def offer(self, key: str) -> None:
        """Be ready to publish on a key, so that `is_read` can tell whether the agent wants it."""
        self._publisher(key, "")

    def is_read(self, key: str) -> bool:
        """Return whether the agent subscribes to anything that includes a key."""
        status: Any = self._publisher(key, "").matching_status  # the stub says bool
        return status.matching

    def close(self) -> None:
        """End the router; the agent's link is lost at once."""
        if not self._session.is_closed():
            self._session.close()

    # To remote subscribers only: the subscriber that hears everything must not count, nor hear this.
    def _publisher(self, key: str, encoding: str) -> zenoh.Publisher:
        publisher = self._publishers.get(key)
        if publisher is None:
            publisher = self._session.declare_publisher(
                key,
                encoding=zenoh.Encoding(encoding or "application/msgpack"),
                congestion_control=zenoh.CongestionControl.BLOCK,
                express=True,
                allowed_destination=zenoh.Locality.REMOTE,
            )
            self._publishers[key] = publisher
        return publisher
