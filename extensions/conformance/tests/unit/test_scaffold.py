"""New agents from templates: complete, renamed, and never over somebody's files."""

import re

import pytest

from gslcosim.base.errors import UsageError
from gslcosim_conformance.scaffold import create_agent, list_languages


@pytest.mark.parametrize("language", list_languages())
def test_every_file_has_the_agents_own_name(language, tmp_path):
    created = create_agent(language, "gas_finder", tmp_path / "new")
    texts = {path: path.read_text() for path in created.folder.rglob("*") if path.is_file()}
    assert not [path for path, text in texts.items() if re.search(r"NAME|Searcher|beetle|\.\./", text)]
    assert texts[created.folder / "README.md"].startswith("# gas_finder\n")
    assert "agent.yaml" not in {path.name for path in texts}


@pytest.mark.parametrize("language", list_languages())
def test_it_says_how_to_build_check_and_run(language, tmp_path):
    created = create_agent(language, "gas_finder", tmp_path / "new")
    assert created.check_command[:3] == ("gslcosim", "agent", "check")
    assert created.check_command[-len(created.start) :] == created.start
    readme = (created.folder / "README.md").read_text()
    *_, first = [line for line in created.as_text().splitlines() if "cd " in line]
    assert first.split() == ["cd", str(created.folder)]
    assert [line for line in created.as_text().splitlines()[2:] if line.strip() not in readme] == []


@pytest.mark.parametrize(
    ("language", "name", "words"),
    [
        ("cobol", "x", "expected one of the languages python"),
        ("python", "My-Agent", "expected a name of lower-case letters"),
        ("python", "", "expected a name of lower-case letters"),
    ],
)
def test_a_wrong_call_says_what_was_expected(language, name, words, tmp_path):
    with pytest.raises(UsageError, match=words):
        create_agent(language, name, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_files_that_are_there_are_left_alone(tmp_path):
    (tmp_path / "agent.py").write_text("precious")
    with pytest.raises(UsageError, match="expected a folder that is new or empty"):
        create_agent("python", "x", tmp_path)
    assert (tmp_path / "agent.py").read_text() == "precious"
