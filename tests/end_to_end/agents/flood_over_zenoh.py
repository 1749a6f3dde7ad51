"""Answers, and then sends for two seconds what nobody asked for, as fast as it is taken."""

import sys
import time

from raw import RawAgent

JUNK = {"small": b"\x81\xa4kind\xa4noop", "large": bytes(100_000_000)}[sys.argv[1]]

agent = RawAgent()
for question in agent.questions():
    agent.send_command(tick=question["tick"], kind="hold")
    stop_at, n_sent = time.monotonic() + 2.0, 0
    while time.monotonic() < stop_at:
        agent.send(JUNK)
        n_sent += 1
    sys.stderr.write(f"sent {n_sent} messages in two seconds\n")
    sys.stderr.flush()
