"""Puts links to a file of somebody else's where the run will write; both paths are arguments."""

import sys
from pathlib import Path

from raw import RawAgent

agent = RawAgent()
for n, question in enumerate(agent.questions()):
    if n == 1:
        [run] = Path(sys.argv[1]).iterdir()
        for name in ("result.json", "digest.json"):
            (run / name).symlink_to(sys.argv[2])
    agent.send_command(tick=question["tick"], kind="hold")
