"""The life of an agent without the kit, for agents that do wrong things."""

import json
import queue
import sys

import msgpack

from gslcosim.bus.interface import JoinData
from gslcosim.bus.zenoh_bus import ZenohBus


class RawAgent:
    """Joins a run and hands over observations that await an answer; sends whatever bytes it is given."""

    def __init__(self) -> None:
        self.join = JoinData.from_environment()
        self.bus = ZenohBus.open_member(self.join)
        self.events: queue.SimpleQueue = queue.SimpleQueue()
        for kind in ("observation", "ending"):
            self.bus.subscribe(f"agents/{self.join.name}/{kind}", lambda key, payload: self.events.put((key, payload)))
        self.bus.declare_alive(f"agents/{self.join.name}/alive")

    def questions(self):
        """Yield each new observation that awaits a command, until the run ends."""
        seen = -1
        while True:
            key, payload = self.events.get()
            if key.endswith("/ending"):
                self.bus.close()
                return
            observation = msgpack.unpackb(payload)
            if observation["awaiting_command"] and observation["tick"] > seen:
                seen = observation["tick"]
                yield observation

    def send(self, payload: bytes) -> None:
        """Send bytes as this agent's command."""
        self.bus.publish(f"agents/{self.join.name}/command", payload, urgent=True)

    def send_command(self, **fields) -> None:
        """Send a map as this agent's command."""
        self.send(msgpack.packb(fields))

    def run_attacks(self, attacks) -> None:
        """Try each attack once when first asked, log what it has reached, and hold until the run ends."""
        for i_question, question in enumerate(self.questions()):
            if i_question == 0:
                for attack in attacks:
                    line = json.dumps({"attack": attack.__name__, "reached": attack()})
                    sys.stdout.write(f"{line}\n")
                    sys.stdout.flush()
            self.send_command(tick=question["tick"], kind="hold")
