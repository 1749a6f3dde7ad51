"""The folders of agents are complete, and nothing of one machine is in them."""

import json
from pathlib import Path

import pytest
import yaml

AGENTS = Path(__file__).parents[2] / "agents"
FOLDERS = [path.parent for path in sorted(AGENTS.glob("*/agent.yaml"))]
KEYS = {"language", "door", "format", "start", "needs"}
OPTIONAL_KEYS = {"observations", "build", "libraries", "slow_to_build", "methods"}


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_a_folder_says_what_it_is_and_how_it_is_built_and_started(folder):
    fields = yaml.safe_load((folder / "agent.yaml").read_text())
    assert fields.keys() >= KEYS
    assert fields.keys() <= KEYS | OPTIONAL_KEYS
    assert (folder / "README.md").is_file()
    assert f"[{folder.name}]({folder.name}/README.md)" in (AGENTS / "README.md").read_text()


def test_no_lock_file_of_npm_names_a_registry():
    """Else everybody would fetch from the registry of anyone who made the file."""
    for path in AGENTS.glob("*/package-lock.json"):
        packages = json.loads(path.read_text())["packages"].values()
        assert not [package for package in packages if "resolved" in package], path
