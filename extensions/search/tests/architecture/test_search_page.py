"""The pages of building blocks match the code, and their example runs."""

from pathlib import Path

import pytest
from search_page import EXAMPLE, PAGE, SEARCH, build_search_pages

from gslcosim.cli.main import main

ROOT = Path(__file__).parents[4]
DOCS = ROOT / "docs"


def test_the_pages_match_the_docstrings():
    pages = build_search_pages(ROOT)
    assert {path.relative_to(DOCS).as_posix() for path in DOCS.glob("search/*.md")} == {*pages} - {PAGE}
    for name, text in pages.items():
        assert (DOCS / name).read_text() == text, f"`make docs` rewrites {name}"


def test_every_module_and_every_public_block_has_a_sentence():
    texts = {path.stem: path.read_text() for path in DOCS.glob("search/*.md")}
    for module in SEARCH.rglob("*.py"):
        if not module.stem.endswith(("_kernels", "__init__")):
            parts = module.relative_to(SEARCH).with_suffix("").parts
            page = parts[0] if len(parts) > 1 else "shared"
            assert f"## gslcosim_search.{'.'.join(parts)}\n" in texts[page]
    lines = [line for text in texts.values() for line in text.splitlines()]
    assert not [line for line in lines if line.startswith("| `") and line.endswith("|  |")]


@pytest.mark.slow
def test_the_example_runs(tmp_path):
    start = f"agents[0].start={{python: {ROOT / EXAMPLE}}}"
    arguments = ["--set", start, "--set", "recording.enabled=false", "--in-process", "--runs-dir", str(tmp_path)]
    assert main(["up", "tiny_room", *arguments]) in (0, 1)
