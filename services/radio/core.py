"""Radio core: delivers the texts in agents' commands with the range, loss and delay of their channels."""

from collections.abc import Iterable, Iterator
from typing import cast

import numpy as np

from gslcosim.base.errors import ModelError
from gslcosim.base.rng import stream
from gslcosim.base.scalar_kernels import distance
from gslcosim.contract import keys
from gslcosim.contract.messages import (
    BodyPoses,
    Command,
    RadioArrival,
    RadioMessage,
    RadioReception,
    RadioTraffic,
    RadioTransmission,
    Vec3,
)
from gslcosim.contract.participant import Episode, Inbox, Outbox
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import RadioLostSpec, RadioReturnsSpec
from gslcosim.scenario.models.scenario import ChannelSpec, find_due_events
from gslcosim_services.radio.ports import radio_spec

TO_ALL = "all"


class RadioCore:
    """Delivers texts between agents, with the range, loss and delay of their channels.

    Reads `truth/bodies` of the tick before and every agent's commands when they take effect (`latency_ticks` after the
    observation they answer); writes `truth/radio` every tick. Texts that step k reads were sent at the end of
    tick k - 1, their ranges are those between the bodies of k - 1, and they arrive `delay_ticks` of the channel later.

    Range is the straight line between the origins of two bodies; walls are as air. Losses of one receiver do not
    depend on others: each pair of sender and receiver has its own stream `radio.<channel>.<sender>.<receiver>`, and
    each text for that receiver, in range or not, draws once from it.

    Texts of a radio that an event in `truth/events` of the last tick has switched off are `lost`.

    State: the texts in transit, the streams, and the lost radios; all are new at each reset.
    Raises ModelError when the truth lacks a sender or receiver; the runtime then ends the run as invalid.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.spec = radio_spec(scenario)
        self._channels = {channel.name: channel for channel in scenario.channels}
        self._members = {channel.name: scenario.members_of(channel) for channel in scenario.channels}
        self._scenario = scenario
        # Agents with lost texts, each with a channel; None stands for all.
        self._outages: set[tuple[str | None, str | None]] = set()
        self._senders = sorted(agent.name for agent in scenario.agents)
        self._seed = scenario.seed
        self._rngs: dict[str, np.random.Generator] = {}
        self._on_their_way: dict[int, list[RadioArrival]] = {}

    def reset(self, episode: Episode) -> Outbox:
        """Drop the texts in transit and begin all streams again; nothing is written before tick 0."""
        self._seed = episode.seed
        self._rngs = {}
        self._on_their_way = {}
        self._outages = set()
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Send the texts that agents wrote a tick ago, and deliver those that arrive now."""
        self._obey_events(inbox)
        transmissions = tuple(self._transmissions(tick - 1, inbox))
        arrivals = tuple(self._on_their_way.pop(tick, ()))
        return {keys.RADIO: RadioTraffic(tick=tick, transmissions=transmissions, arrivals=arrivals)}

    def _obey_events(self, inbox: Inbox) -> None:
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, RadioLostSpec):
                self._outages.add((event.agent, event.channel))
            elif isinstance(event, RadioReturnsSpec):
                self._outages.discard((event.agent, event.channel))

    def _is_out(self, channel: str, sender: str, receiver: str) -> bool:
        return any(
            agent in (None, sender, receiver) and lost_channel in (None, channel)
            for agent, lost_channel in self._outages
        )

    def _transmissions(self, sent_tick: int, inbox: Inbox) -> Iterator[RadioTransmission]:
        positions_m = _positions_m(cast(BodyPoses | None, inbox.get(keys.BODIES)), self._senders, sent_tick)
        for sender in self._senders:
            command = cast(Command | None, inbox.get(keys.command(sender)))
            for i, message in enumerate(command.outgoing if command else ()):
                refusal = self._refusal(sender, message)
                if refusal is None:
                    yield self._send(sender, message, sent_tick, positions_m)
                else:
                    yield RadioTransmission(sender=sender, message=message, refusal=f"outgoing[{i}].{refusal}")

    # The reason why a text cannot be sent; None if it can.
    def _refusal(self, sender: str, message: RadioMessage) -> str | None:
        own = [name for name, members in self._members.items() if sender in members]
        if message.channel not in own:
            return f"channel: expected {_join_names(own)}, was {message.channel!r}."
        others = [name for name in self._members[message.channel] if name != sender]
        if message.to != TO_ALL and message.to not in others:
            return f"to: expected {_join_names([TO_ALL, *others])}, was {message.to!r}."
        n_bytes, max_bytes = len(message.text.encode()), self._channels[message.channel].max_bytes
        if n_bytes > max_bytes:
            return f"text: expected at most {max_bytes} bytes in UTF-8 on {message.channel}, was {n_bytes}."
        return None

    def _send(
        self, sender: str, message: RadioMessage, sent_tick: int, positions_m: dict[str, Vec3]
    ) -> RadioTransmission:
        channel = self._channels[message.channel]
        fates: dict[str, list[str]] = {"reached": [], "lost": [], "out_of_range": []}
        for receiver in self._members[channel.name]:
            if receiver != sender and message.to in (TO_ALL, receiver):
                fates[self._fate(channel, sender, receiver, positions_m)].append(receiver)
        reception = RadioReception(
            sender=sender, channel=channel.name, text=message.text, sent_tick=sent_tick, to=message.to
        )
        arriving = self._on_their_way.setdefault(sent_tick + channel.delay_ticks, [])
        arriving += [RadioArrival(agent=receiver, reception=reception) for receiver in fates["reached"]]
        return RadioTransmission(
            sender=sender,
            message=message,
            reached=tuple(fates["reached"]),
            lost=tuple(fates["lost"]),
            out_of_range=tuple(fates["out_of_range"]),
        )

    def _fate(self, channel: ChannelSpec, sender: str, receiver: str, positions_m: dict[str, Vec3]) -> str:
        is_lost = self._rng(f"radio.{channel.name}.{sender}.{receiver}").random() < channel.loss_frac
        if channel.range_m is not None and distance(positions_m[sender], positions_m[receiver]) > channel.range_m:
            return "out_of_range"
        return "lost" if is_lost or self._is_out(channel.name, sender, receiver) else "reached"

    def _rng(self, name: str) -> np.random.Generator:
        if name not in self._rngs:
            self._rngs[name] = stream(self._seed, name)
        return self._rngs[name]


# Before tick 0 there are no bodies, and no texts.
def _positions_m(poses: BodyPoses | None, agents: Iterable[str], tick: int) -> dict[str, Vec3]:
    if poses is None:
        return {}
    positions_m = {body.agent: body.position_world_m for body in poses.bodies}
    for agent in agents:
        if agent not in positions_m:
            raise ModelError(f"radio: expected a pose of vehicle {agent!r} in tick {tick}, was none.")
    return positions_m


def _join_names(names: list[str]) -> str:
    return f"one of {', '.join(names)}" if names else "none, for the agent is on no channel"
