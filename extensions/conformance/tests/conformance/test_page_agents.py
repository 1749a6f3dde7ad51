"""The whole agents that pages show keep every rule: each is taken from its page and checked."""

import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from gslcosim_conformance import ConnectionSpec, check_agent

DOCS = Path(__file__).parents[4] / "docs"
SHOWN = re.compile(r"<!-- from docs/examples/(\S+\.py) -->\n```python\n(.*?)```", re.DOTALL)
# Which page shows which agent, and through which transports the page flies it.
AGENTS = {
    ("zenoh-door.md", "zenoh_client.py"): [{"transport": "zenoh"}],
    ("gateway.md", "lines.py"): [{"transport": "stdio", "format": "json"}],
    ("gateway.md", "frames.py"): [{"transport": "tcp"}, {"transport": "unix"}],
    ("agents/python.md", "upwind.py"): [{"transport": "zenoh"}],
}
# It flies with instruments that the kit's room lacks.
OTHER_INSTRUMENTS = {("agents/python.md", "beams.py")}
CASES = [(page, name, options) for (page, name), each in AGENTS.items() for options in each]
N_AT_ONCE = 3

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end]


def test_every_agent_on_a_page_is_among_them():
    """A program on a page about transports is a whole agent where it is shown from its first line."""
    shown = {(page, name) for page in {page for page, _ in AGENTS} for name, _ in programs_of(page)}
    assert shown == AGENTS.keys() | OTHER_INSTRUMENTS


def programs_of(page):
    return [found for found in SHOWN.findall((DOCS / page).read_text()) if found[1].startswith('"""')]


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    """The reports of all agents, made several at a time."""
    with ThreadPoolExecutor(N_AT_ONCE) as pool:
        futures = []
        for page, name, options in CASES:
            file = tmp_path_factory.mktemp("agent") / name
            file.write_text(dict(programs_of(page))[name])
            connection = ConnectionSpec(command=(sys.executable, str(file)), directory=file.parent, **options)
            futures.append(pool.submit(check_agent, connection))
        yield futures


@pytest.mark.parametrize("i", range(len(CASES)), ids=[f"{name}-{options['transport']}" for _, name, options in CASES])
def test_an_agent_on_a_page_keeps_every_rule(i, reports):
    report = reports[i].result()
    assert report.has_passed, report.as_text()
