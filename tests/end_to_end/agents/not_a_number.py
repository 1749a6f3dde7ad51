"""Answers with a waypoint that is not a number."""

from raw import RawAgent

agent = RawAgent()
for question in agent.questions():
    agent.send_command(tick=question["tick"], kind="waypoint", position_world_m=[float("nan"), 1.0, 1.0])
