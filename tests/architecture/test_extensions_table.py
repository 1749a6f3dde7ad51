"""The table of what extensions offer is that of their registrations."""

import re
import runpy
from pathlib import Path

import pytest

from gslcosim.base.extensions import read_known

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "docs" / "_build" / "extensions_table.py"
PAGE = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")


def test_the_table_of_extensions_is_current():
    assert runpy.run_path(str(SCRIPT))["build_table"]() == read_known(), "run make contract"


@pytest.mark.parametrize("extension", read_known())
def test_the_page_of_commands_lists_those_of_an_extension(extension):
    words = {word for word in read_known()[extension].get("commands", ()) if "--" not in word}
    row = re.search(rf"^\| `{extension}` \| (.*) \|$", PAGE, re.MULTILINE)
    listed = set()
    for part in row[1].split("; ") if row else ():
        name, *actions = re.findall("`([^`]+)`", part)
        listed |= {f"{name} {action}" for action in actions} or {name}
    assert {word for word in words if " " in word} - {"bench run measured"} <= listed
    assert {word.split()[0] for word in listed} >= {word for word in words if " " not in word}
