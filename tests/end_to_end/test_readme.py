"""README.md and docs/commands.md are true: commands and agent run as they stand, in an empty folder."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import PROCESS_S
from page_commands import type_line, type_on_runs

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
COMMANDS = (ROOT / "docs" / "commands.md").read_text()


def section(title, page=README):
    return page.split(f"## {title}\n")[1].split("\n## ")[0]


def commands_of(title):
    return [
        line
        for block in re.findall(r"```sh\n(.*?)```", section(title, COMMANDS), re.DOTALL)
        for line in block.splitlines()
    ]


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "my.yaml").write_text((ROOT / "scenarios" / "tiny_room.yaml").read_text())
    return tmp_path


@pytest.mark.end_to_end
@pytest.mark.slow
@pytest.mark.parametrize(
    "title",
    [
        pytest.param("Everyday commands", marks=[pytest.mark.debian, pytest.mark.extras]),
        "Compare methods",
    ],
)
def test_every_command_works_as_it_stands(title, folder):
    lines = commands_of(title)
    assert len(lines) >= 4
    for line in lines:
        # A viewer stays open; a picture of the same view ends by itself.
        line = re.sub("gslcosim view RUN(?: --web)? ", "gslcosim view RUN --screenshot view.png ", line)
        # A part of the search, for each picture of a film takes as long as the last.
        line = line.replace("gslcosim film RUN ", "gslcosim film RUN --to 15 ")
        line = line.replace("--count 20", "--count 2").replace("--repetitions 2", "--repetitions 1")
        ended = type_on_runs(line, folder)
        assert ended.returncode == 0, f"{line}\n{ended.stdout}\n{ended.stderr}"


@pytest.mark.end_to_end
@pytest.mark.slow
def test_the_agent_runs_by_the_command_beside_it(folder):
    (program,) = re.findall(r"```python\n(.*?)```", section("Write an agent"), re.DOTALL)
    (folder / "upwind.py").write_text(program)
    (command,) = re.findall(r"`(gslcosim up [^`]*upwind\.py[^`]*)`", section("Write an agent"))
    ended = type_line(command, folder)
    assert ended.returncode in (0, 1), f"{ended.stdout}\n{ended.stderr}"
    assert (next((folder / "runs").iterdir()) / "result.json").is_file()


@pytest.mark.end_to_end
@pytest.mark.slow
def test_the_quickstart_ends_as_the_page_shows(folder):
    (shown,) = re.findall(r"ends with[^`]*```\n(.*?)```", section("Two commands"), re.DOTALL)
    program = Path(sys.executable).with_name("gslcosim")
    call = [program, "up", ROOT / "scenarios" / "warehouse_empty.yaml"]
    ended = subprocess.run(call, cwd=folder, capture_output=True, text=True, timeout=PROCESS_S, check=False)
    assert ended.returncode == 0, ended.stderr
    # Which sandbox is the strongest depends on the machine.
    for line in shown.strip().replace("bubblewrap", "").splitlines():
        wanted = " ".join(line.split())
        assert any(" ".join(said.split()).startswith(wanted) for said in ended.stdout.splitlines()), ended.stdout
