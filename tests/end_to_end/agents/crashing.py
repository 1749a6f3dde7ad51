"""Answers twice and then ends with an exception."""

from raw import RawAgent

agent = RawAgent()
for n, question in enumerate(agent.questions()):
    if n == 2:
        raise RuntimeError("lost my way")
    agent.send_command(tick=question["tick"], kind="hold")
