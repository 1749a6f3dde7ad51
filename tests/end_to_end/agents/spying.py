"""Listens to everything and writes where it must not, and reports in its log what it has reached."""

import collections
import sys

from raw import RawAgent

agent = RawAgent()
received = collections.Counter()
agent.bus.subscribe("**", lambda key, payload: received.update([key]))
agent.bus.ask("**", b"", lambda key, payload: received.update([f"answer {key}"]))
agent.bus.declare_alive("alive/referee_of_mine")
for question in agent.questions():
    for key in ("truth/bodies", "referee/verdict", "command/beetle", "ctl/stop", "ctl/close", "ctl/start"):
        agent.bus.publish(key, b"forged")
    agent.send_command(tick=question["tick"], kind="hold")
foreign = sorted(key for key in received if not key.startswith(f"agents/{agent.join.name}/"))
# What this session has itself written is always delivered to itself.
own = {"truth/bodies", "referee/verdict", "command/beetle", "ctl/stop", "ctl/close", "ctl/start"}
sys.stdout.write(f"heard {sum(received.values())} messages, foreign: {sorted(set(foreign) - own)}\n")
sys.stdout.write(f"own only: {all(received[key] <= received['agents/beetle/observation'] for key in own)}\n")
