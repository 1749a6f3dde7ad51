"""The page of building blocks says what the code says, and its example flies."""

from pathlib import Path

import pytest
from search_page import EXAMPLE, SEARCH, build_search_page

from gslcosim.cli.main import main

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "search.md"


def test_the_page_is_what_the_docstrings_say():
    assert PAGE.read_text() == build_search_page(ROOT), "`make docs` rewrites it"


def test_every_module_and_every_public_block_has_a_sentence():
    text = PAGE.read_text()
    for module in SEARCH.rglob("*.py"):
        if not module.stem.endswith(("_kernels", "__init__")):
            name = ".".join(module.relative_to(SEARCH).with_suffix("").parts)
            assert f"### gslcosim.search.{name}\n" in text
    assert not [line for line in text.splitlines() if line.startswith("| `") and line.endswith("|  |")]


@pytest.mark.slow
def test_the_example_runs(tmp_path):
    start = f"agents[0].start={{python: {ROOT / EXAMPLE}}}"
    arguments = ["--set", start, "--set", "recording.enabled=false", "--in-process", "--runs-dir", str(tmp_path)]
    assert main(["up", "tiny_room", *arguments]) in (0, 1)
