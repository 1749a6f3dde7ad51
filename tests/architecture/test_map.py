"""ARCHITECTURE.md: the map of folders is the tree."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "ARCHITECTURE.md").read_text()


@pytest.mark.parametrize("parent", ["gslcosim", "services", "extensions"])
def test_each_folder_has_one_row_and_each_row_a_folder(parent):
    rows = re.findall(rf"^\| `{parent}/(\w+)` \|", PAGE.split("## Layers")[0], re.MULTILINE)
    listed = subprocess.run(["git", "ls-files", parent], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    folders = {path.split("/")[1] for path in listed.split() if path.count("/") > 1}
    assert sorted(rows) == sorted(folders)


def test_services_import_each_other_where_the_page_says_and_nowhere_else():
    found = set()
    for path in (ROOT / "services").rglob("*.py"):
        own = path.relative_to(ROOT / "services").parts[0]
        found |= {(own, other) for other in re.findall(r"gslcosim_services\.(\w+)", path.read_text()) if other != own}
    folders = {path.name for path in (ROOT / "services").iterdir() if path.is_dir()}
    pairs = {(own, other) for own, other in found if own in folders and other in folders}
    assert pairs == {("cameras", "world"), ("recorder", "sensing")}
    assert (
        "`cameras` draws the scene of `world`, and `recorder` names values after the instruments of `sensing`" in PAGE
    )
