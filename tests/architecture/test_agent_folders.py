"""The folders of agents are complete, and nothing of one machine is in them."""

import json
import subprocess
from pathlib import Path

import pytest
import yaml

AGENTS = Path(__file__).parents[2] / "agents"
FOLDERS = [path.parent for path in sorted(AGENTS.glob("*/agent.yaml"))]
KEYS = {"language", "door", "format", "start", "needs"}
OPTIONAL_KEYS = {"observations", "build", "libraries", "slow_to_build", "methods"}
LINES_AT_ONE_SITTING = 400
# A folder with several methods is read a method at a time.
LINES_OF_A_METHOD = 350


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_a_folder_says_what_it_is_and_how_it_is_built_and_started(folder):
    fields = yaml.safe_load((folder / "agent.yaml").read_text())
    assert fields.keys() >= KEYS
    assert fields.keys() <= KEYS | OPTIONAL_KEYS
    assert (folder / "README.md").is_file()
    assert f"[{folder.name}]({folder.name}/README.md)" in (AGENTS / "README.md").read_text()


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_a_language_can_be_read_at_one_sitting(folder):
    listed = subprocess.run(["git", "ls-files", "."], cwd=folder, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not a checkout, so sources cannot be told from what was built")
    files = [folder / name for name in listed.stdout.split() if "lock" not in name and not name.endswith(".md")]
    methods = yaml.safe_load((folder / "agent.yaml").read_text()).get("methods", ())
    n_lines = sum(len(file.read_text().splitlines()) for file in files)
    assert n_lines <= LINES_AT_ONE_SITTING + LINES_OF_A_METHOD * len(methods)


def test_no_lock_file_of_npm_names_a_registry():
    """Else everybody would fetch from the registry of whoever made the file."""
    for path in AGENTS.glob("*/package-lock.json"):
        packages = json.loads(path.read_text())["packages"].values()
        assert not [package for package in packages if "resolved" in package], path
