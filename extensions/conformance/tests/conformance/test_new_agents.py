"""The commands in the README of a new agent work in each language.

They start processes, which a check in the same process would take for what its agent has left behind: the checks of
agents are in a file of their own.
"""

import re

import pytest
from deadlines import BUILD_S, PROCESS_S
from languages import stub_of
from page_commands import type_block

from gslcosim_conformance.scaffold import create_agent, list_languages

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end, pytest.mark.timeout(BUILD_S + PROCESS_S)]


@pytest.mark.parametrize(
    "language",
    [pytest.param(language, marks=pytest.mark.debian) for language in list_languages() if language != "python"]
    + ["python"],
)
def test_the_readme_of_a_new_agent_builds_checks_and_flies_it(language, tmp_path):
    if lacks := stub_of(language).lacks:
        pytest.skip(f"a new agent in {language} is not tried: this machine has no {lacks}")
    created = create_agent(language, "gas_finder", tmp_path / "new folder")
    (commands,) = re.findall(r"```sh\n(.*?)```", (created.folder / "README.md").read_text(), re.DOTALL)
    ended = type_block(commands, created.folder, limit_s=BUILD_S)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "0 failed." in ended.stdout
    assert "The source was found" in ended.stdout
