"""Answers once, so that a test knows the run is flying, and then waits for ever."""

from raw import RawAgent

agent = RawAgent()
for n, question in enumerate(agent.questions()):
    if n == 0:
        agent.send_command(tick=question["tick"], kind="hold")
