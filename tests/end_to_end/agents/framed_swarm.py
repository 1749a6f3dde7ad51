"""Flies all agents of its process through the gateway in JSON lines over stdio: each frame names its agent."""

import importlib.util
import os
import sys

from framed import ROOT, message_of, receive, send

from gslcosim.contract.messages import Briefing, Observation

spec = importlib.util.spec_from_file_location("beetle", ROOT / "agents" / "calling_beetle" / "agent.py")
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
agents = dict.fromkeys(os.environ["GSLCOSIM_AGENT"].split(","))
while (fields := receive(sys.stdin.buffer, "json")) and fields["message"] != "Ending":
    name = fields["agent"]
    if fields["message"] == "Briefing":
        agents[name] = module.CallingBeetle(message_of(Briefing, fields))
        continue
    observation = message_of(Observation, fields)
    agents[name].observe(observation)
    if observation.awaiting_command:
        command = agents[name].decide(observation)
        send(sys.stdout.buffer, "json", {"agent": name, **command.model_dump(exclude_none=True)})
