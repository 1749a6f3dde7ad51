"""The generated pages are current and complete."""

import inspect
import re
from pathlib import Path

from messages_page import MESSAGES_BY_KEY, build_messages_markdown

from gslcosim.contract import keys, messages
from gslcosim.contract.messages import Record
from gslcosim.runtime.services import build_dataflow
from gslcosim.scenario import load_scenario
from gslcosim_conformance.key_table import AGENT_PLACEHOLDER, KEY_TABLE
from gslcosim_conformance.message_schemas import list_message_types

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "messages.md"


def test_the_page_is_what_the_code_says():
    assert PAGE.read_text() == build_messages_markdown(), "`make docs` rewrites it"


def test_every_key_of_the_contract_is_on_the_page():
    constants = {value for name, value in vars(keys).items() if name.isupper() and isinstance(value, str)}
    functions = {
        value(AGENT_PLACEHOLDER)
        for value in vars(keys).values()
        if inspect.isfunction(value) and [*inspect.signature(value).parameters] == ["agent"]
    }
    assert constants | functions == set(MESSAGES_BY_KEY)
    assert all(f"`{key}`" in PAGE.read_text() for key in MESSAGES_BY_KEY)


def test_every_message_and_every_part_has_a_section_and_a_docstring():
    records = [item for item in vars(messages).values() if isinstance(item, type) and issubclass(item, Record)]
    for record in {*records} - {Record, messages.Message}:
        assert f"### {record.__name__}\n" in PAGE.read_text()
        assert (record.__doc__ or "").strip(), record.__name__


def test_every_message_has_a_key():
    assert set(MESSAGES_BY_KEY.values()) == {message_type.__name__ for message_type in list_message_types()}


def test_a_run_uses_the_keys_as_documented():
    dataflow = build_dataflow(load_scenario("warehouse_empty").scenario)
    used = {port.replace("beetle", AGENT_PLACEHOLDER): kind.__name__ for port, kind in dataflow.message_types.items()}
    assert used.items() <= MESSAGES_BY_KEY.items()


def test_writers_and_readers_are_as_documented():
    dataflow = build_dataflow(load_scenario("warehouse_empty").scenario)
    documented = {channel.key.replace(AGENT_PLACEHOLDER, "beetle"): channel for channel in KEY_TABLE}
    for port, writer in dataflow.writer_of.items():
        channel = documented[port]
        assert channel.writer == writer.replace("agent_beetle", "the agent's door"), port
        readers = {reader.name for reader in dataflow.readers_of[writer] if any(r.port == port for r in reader.reads)}
        documented_readers = {text.strip().replace("its door", "agent_beetle") for text in channel.readers.split(",")}
        assert readers <= documented_readers, port


def test_each_word_stands_once_and_its_module_is_there():
    words = (ROOT / "docs" / "notation.md").read_text().split("## Words")[1].split("## Frames")[0]
    rows = [row.split(" | ") for row in words.splitlines() if row.startswith("| ") and not row.startswith("| word")]
    assert rows
    names = [name for row in rows for name in row[0].removeprefix("| ").split(", ")]
    assert [name for name in set(names) if names.count(name) > 1] == []
    places = re.findall(r"`((?:gslcosim|services)/[^`*]+)`", words)
    assert [place for place in places if not (ROOT / place).exists()] == []
