"""The pages of the transports and of Python are followed literally, and their programs all fly the same run."""

import re
import sys

import pytest
from page_commands import type_block
from real_runs import ROOT, TINY_ROOM, fly, fly_here

EXAMPLES = ROOT / "docs" / "examples"
PAGES = ("agents/python.md", "gateway.md", "zenoh-door.md")
SAVED = re.compile(r"<!-- from docs/examples/(\S+) -->\n```python\n(.*?)```", re.DOTALL)
COMMANDS = re.compile(r"```sh\n(.*?)```", re.DOTALL)


@pytest.mark.parametrize("page", PAGES)
def test_a_page_followed_literally_runs(tmp_path, page):
    text = (ROOT / "docs" / page).read_text()
    for name, program in SAVED.findall(text):
        (tmp_path / name).write_text(program)
    followed = type_block("".join(COMMANDS.findall(text)), tmp_path)
    assert followed.returncode == 0, followed.stdout + followed.stderr
    assert followed.stdout.count("The source was found") == text.count("\ngslcosim up tiny_room") > 0


def test_all_examples_make_the_same_run(tmp_path):
    """The kit, bare Zenoh, JSON lines, and msgpack frames over a unix socket."""
    program = f"command: [{sys.executable}, {EXAMPLES}"
    starts = {
        "kit": f"{{python: {EXAMPLES}/upwind.py}}",
        "zenoh": f"{{{program}/zenoh_client.py]}}",
        "lines": f"{{{program}/lines.py], door: stdio, format: json, observations: asked}}",
        "frames": f"{{{program}/frames.py], door: unix}}",
    }
    ended = {
        name: (fly if name == "zenoh" else fly_here)(TINY_ROOM, tmp_path / name, "--set", f"agents[0].start={start}")
        for name, start in starts.items()
    }
    assert [flight.result["faults"] for flight in ended.values()] == [[], [], [], []]
    assert len({flight.result["digest"] for flight in ended.values()}) == 1
