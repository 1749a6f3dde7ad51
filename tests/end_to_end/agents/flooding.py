"""Answers rightly, after twenty thousand messages nobody asked for."""

from raw import RawAgent

agent = RawAgent()
for question in agent.questions():
    agent.send_command(tick=question["tick"], kind="hold")
    for n in range(20_000):
        agent.send_command(tick=1_000_000 + n, kind="waypoint", position_world_m=[1.0, 1.0, 1.0])
