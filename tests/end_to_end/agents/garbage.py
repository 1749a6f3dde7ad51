"""Answers with bytes that are not msgpack."""

from raw import RawAgent

agent = RawAgent()
for _ in agent.questions():
    agent.send(b"\xc1 this is not msgpack")
