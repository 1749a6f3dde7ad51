"""Joins and never answers."""

from raw import RawAgent

agent = RawAgent()
for _ in agent.questions():
    pass
