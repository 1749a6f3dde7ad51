"""Answers with 50 MB."""

from raw import RawAgent

agent = RawAgent()
for _ in agent.questions():
    agent.send(bytes(50_000_000))
