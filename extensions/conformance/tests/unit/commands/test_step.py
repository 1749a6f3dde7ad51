"""`gslcosim step`: lines and options, those of the page too."""

import io
import json
import re
import shlex
from pathlib import Path

from gslcosim.cli.main import main

PAGE = (Path(__file__).parents[5] / "docs" / "step.md").read_text()
# An attached agent that is asked every tick, in a run that lasts.
ATTACHED = [
    "referee.stop.time_limit_s=3600", "referee.success.within_m=0.01", "agents[0].start={attach: true}",
    "agents[0].mode=lockstep", "agents[0].parameters={}",
]  # fmt: skip


def lines_of(capsys):
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_the_commands_of_the_page_print_the_state(capsys, monkeypatch):
    commands = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, flags=re.DOTALL) for line in block.splitlines()]
    assert len(commands) == 3
    assert main(shlex.split(commands[0])[1:]) == 0
    assert capsys.readouterr().out.startswith("tick 99, 9.9 s\n  beetle: ")
    assert main(shlex.split(commands[1])[1:]) == 0
    states = lines_of(capsys)
    assert [state["tick"] for state in states] == [19, 39, 59, 79, 99]
    assert states[-1]["truth"]["bodies"]["beetle"]["phase"] == states[-1]["observations"]["beetle"]["status"]
    words, command = (shlex.split(part) for part in commands[2].split("|"))
    monkeypatch.setattr("sys.stdin", io.StringIO(words[1].replace("\\n", "\n")))
    assert main(command[1:]) == 0
    first, sample, reset, last = lines_of(capsys)
    assert sample["mixing_ratio_ppm"]["ethanol"] > 0.0
    assert (reset["tick"], last["tick"]) == (-1, 49)
    assert first["digest"] != last["digest"]


def test_lines_command_an_agent_and_wrong_ones_are_answered(capsys, monkeypatch):
    text = 'step\ncommand beetle {"kind": "noop"}\nstep\ncommand beetle {"kind": 3}\nfly\nstep x\nsample 1 2\ntruth\n'
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    settings = [word for setting in ATTACHED for word in ("--set", setting)]
    assert main(["step", "tiny_room", "--json", *settings]) == 0
    first, answered, second, *errors, truth = lines_of(capsys)
    assert (first["tick"], first["asked"], answered["asked"]) == (0, ["beetle"], [])
    assert (second["tick"], second["asked"]) == (1, ["beetle"])
    assert [error["error"].split(":")[0].split(",")[0] for error in errors] == [
        "command", "expected step", "step", "sample",
    ]  # fmt: skip
    assert truth["truth"]["samples"][0]["gases"][0]["gas"] == "ethanol"
    assert main(["step", "tiny_room", "--ticks", "3", *settings]) == 2
    assert main(["step", "tiny_room", "--every", "3"]) == 2
