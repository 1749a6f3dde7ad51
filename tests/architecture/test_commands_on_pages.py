"""Every `gslcosim …` on a page is a command that there is, with options that it has."""

import re
import shlex
from pathlib import Path

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import build_parser, iterate_commands, parse
from gslcosim.cli.main import list_groups

GROUPS = list_groups()

PARSER = build_parser(GROUPS, version="")


NAMES = {path[:n] for path, _ in iterate_commands(GROUPS) for n in (1, 2)}
MOVED = {command.old_name: path for path, command in iterate_commands(GROUPS) if command.old_name}
ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "agents").glob("*/README.md")), *sorted((ROOT / "scenarios").rglob("README.md")),
]  # fmt: skip
# What a reader is to fill in, or what stands for more of the same.
OPEN = re.compile(r"…|\.\.\.|\bOPTIONS?\b|\|")


def commands_on(page):
    text = page.read_text(encoding="utf-8")
    fenced = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL)).replace("\\\n", " ")
    inline = re.findall(r"`(gslcosim [^`]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    lines = [line.strip().removeprefix("$ ") for line in fenced.splitlines()]
    return [line for line in (*lines, *inline) if line.startswith("gslcosim ")]


# The page's own extension adds it; test_extend_extension.py runs it.
ADDED = "gslcosim sources "
SHOWN = sorted(
    {
        (page.relative_to(ROOT).as_posix(), line)
        for page in PAGES
        for line in commands_on(page)
        if not line.startswith(ADDED)
    }
)


@pytest.mark.parametrize(("page", "line"), [shown for shown in SHOWN if not OPEN.search(shown[1])])
def test_a_command_on_a_page_is_understood(page, line):
    words = shlex.split(line.replace("--seed SEED", "--seed 1"), comments=True)
    end = next((i for i, word in enumerate(words) if word in ("&&", ";", "&", ">", "2>", "<")), len(words))
    # A page may name a command without its arguments, such as `gslcosim agent check`.
    if tuple(words[1:end]) in NAMES or words[1:end] == ["up", "--set"]:
        return
    assert words[1] not in MOVED, f"{page}: {line}: is gslcosim {' '.join(MOVED[words[1]])} now"
    try:
        parse(PARSER, GROUPS, words[1:end])
    except UsageError as error:
        pytest.fail(f"{page}: {line}\n{error}")
    # `--version` and `--help` end here, and well.
    except SystemExit as ended:
        if ended.code:
            pytest.fail(f"{page}: {line}")
