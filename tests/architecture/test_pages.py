"""What the pages show is what the files and the code say: programs, bytes, errors and links."""

import json
import re
from pathlib import Path

import msgpack
import pytest
from contract_vectors import build_rejected

from gslcosim.base.errors import ContractError
from gslcosim.contract import codec
from gslcosim.contract.messages import Command

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
MARKED = re.compile(r"<!-- (from|vector|frame of) (.+?) -->\n```[a-z]*\n(.*?)```", re.DOTALL)
MARKS = re.compile(r"<!-- (?:from|vector|frame of) ")


def name_of(path):
    return path.relative_to(ROOT).as_posix()


def marked_blocks(kind):
    return [
        pytest.param(source, block, id=f"{name_of(page)}-{source}")
        for page in PAGES
        for found, source, block in MARKED.findall(page.read_text())
        if found == kind
    ]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_mark_has_its_block(page):
    """A mark that is not right above its block would check nothing."""
    text = page.read_text()
    assert len(MARKS.findall(text)) == len(MARKED.findall(text))


@pytest.mark.parametrize(("source", "block"), marked_blocks("from"))
def test_a_program_on_a_page_is_the_one_in_its_file(source, block):
    assert f"\n{block}" in f"\n{(ROOT / source).read_text()}"


@pytest.mark.parametrize(("source", "block"), marked_blocks("vector"))
def test_a_message_on_a_page_is_a_golden_vector(source, block):
    message, case_name = source.split()
    vectors = json.loads((ROOT / "agents" / "contract" / "vectors" / f"{message}.json").read_text())
    assert block.strip() in [case["json"] for case in vectors["accept"] if case["name"] == case_name]


@pytest.mark.parametrize(("source", "block"), marked_blocks("frame of"))
def test_bytes_on_a_page_are_the_frame_of_their_message(source, block):
    shown = bytes.fromhex("".join(re.findall(r"^ *((?:[0-9a-f]{2} ?)+)", block, re.MULTILINE)))
    payload = msgpack.packb(json.loads(source))
    assert shown == len(payload).to_bytes(4, "big") + payload


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    targets = re.findall(r"\]\(([^)]+)\)", text)
    missing = []
    for target in targets:
        file, _, anchor = target.partition("#")
        if target.startswith("http"):
            continue
        there = (page.parent / file).resolve() if file else page
        if not there.exists() or (anchor and anchor not in anchors_of(there)):
            missing.append(target)
    assert missing == []


def anchors_of(page):
    headings = re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^a-z0-9 _-]", "", heading.lower()).replace(" ", "-") for heading in headings}


def errors_on_the_page():
    text = (ROOT / "docs" / "write-an-agent.md").read_text().split("## When something is wrong")[1]
    return re.findall(r"^\| `([^`]+)` \|", text, re.MULTILINE)


def what_the_codec_says():
    for case in build_rejected(Command):
        try:
            codec.decode_untrusted(Command, bytes.fromhex(case.msgpack))
        except ContractError as error:
            yield str(error)


@pytest.mark.parametrize("text", errors_on_the_page())
def test_an_error_on_the_page_is_one_that_is_given(text):
    """The words are in the code, around what varies, or the codec says them of a golden vector."""
    sources = "\n".join(path.read_text() for path in sorted((ROOT / "gslcosim").rglob("*.py")))
    parts = [part.strip() for part in re.split(r"\b\d+\b", text)]
    assert all(part in sources for part in parts) or any(text in said for said in what_the_codec_says())


def test_the_files_that_contributing_names_hold_what_it_says():
    rows = re.findall(r"^\| ([^|]+\?) \| `([^`]+)` \|$", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    words = {
        "how are lost messages sent again?": "retransmission", "where is an agent's command validated?": "validator",
        "how does a service process start?": "process", "how does a MOX sensor decay?": "resistance falls with gas",
        "when has an agent succeeded?": "criterion", "where is the outcome of a run collected?": "utcome",
        "how is a path shortened?": "shortens", "what does a snapshot contain?": "observations",
        "which loop waits for agents, and checks their deadlines?": "deadlines",
    }  # fmt: skip
    assert {question for question, _ in rows} == set(words)
    for question, file in rows:
        assert words[question] in (ROOT / file).read_text().lower(), file


def test_the_index_has_every_page():
    index = (ROOT / "docs" / "README.md").read_text()
    pages = [page for page in PAGES if page.parent.name in ("docs", "extend", "benchmark") and page.name != "README.md"]
    assert [name_of(page) for page in pages if f"({page.relative_to(ROOT / 'docs').as_posix()})" not in index] == []
