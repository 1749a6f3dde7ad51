"""The framework speaks of gas and wind only where the contract's messages do: what is known of them is in services."""

import re
from pathlib import Path

import pytest

from gslcosim.contract import environment_messages, keys, messages, participant_messages
from gslcosim.contract.record import Record

ROOT = Path(__file__).parents[2] / "gslcosim"
FRAMEWORK = ("bus", "contract", "gateway", "runtime")
WORDS = re.compile(
    r"\b(gas|gases|(up|down)?winds?|windless|plumes?|filaments?|puffs?|odou?rs?|smells?|sniffs?|noses?|anemometers?"
    r"|ppm|concentrations?|ethanol|methane|mox|tgs\d+)\b",
    re.IGNORECASE,
)
# The messages themselves.
ALLOWED_FILES = (
    "contract/environment_messages.py",
    "contract/keys.py",
    "contract/messages.py",
    "contract/participant_messages.py",
)


def list_message_names():
    """Return the names that the contract's messages have for their types, fields and ports."""
    names = set(vars(keys))
    for module in (messages, environment_messages, participant_messages):
        names |= set(vars(module))
        records = (item for item in vars(module).values() if isinstance(item, type) and issubclass(item, Record))
        names |= {field for record in records for field in record.__struct_fields__}
    return names


# A field whose name is a plain word, such as `gas`, is one as an argument, as a text and as a constant of its name.
def find_words(text, names=frozenset()):
    """Return the identifiers with a word of gas or wind in a text, but for names of messages."""
    found = set()
    for token in re.findall(r'"?\b[A-Za-z_]\w*(?:"|=(?!=))?', text):
        name = token.strip('"=')
        parts = re.sub(r"(?<=[a-z])(?=[A-Z])|_", " ", name)
        is_plain = parts.islower() and " " not in parts
        is_named = name in names and (not is_plain or token != name)
        if WORDS.search(parts) and not is_named and not (name.isupper() and name.lower() in names):
            found.add(name)
    return sorted(found)


@pytest.mark.parametrize("package", FRAMEWORK)
def test_the_framework_has_no_word_of_gas_or_wind_but_those_of_messages(package):
    names, wrong = list_message_names(), {}
    for path in sorted((ROOT / package).rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if not name.startswith(ALLOWED_FILES) and (words := find_words(f"{name}\n{path.read_text()}", names)):
            wrong[name] = words
    assert wrong == {}


@pytest.mark.parametrize("name", ALLOWED_FILES)
def test_each_file_that_may_have_such_words_has_some(name):
    paths = (ROOT / name).rglob("*.*") if name.endswith("/") else [ROOT / name]
    assert any(find_words(path.read_text(), list_message_names()) for path in paths)


@pytest.mark.parametrize(
    "text",
    [
        "the gas was carried",
        "windless_warmup",
        "WIND_FILE",
        "i_wind = 1",
        "_gas: float",
        "StillWind",
        "an Odour",
        '"tgs2600"',
    ],
)
def test_a_word_is_found_in_prose_names_and_texts(text):
    assert find_words(text, list_message_names()) != []


@pytest.mark.parametrize("text", ["Windows", "WINDOW_TICKS", "rewind", "WindShare", "wind_world_m_s=0", 'gas="none"'])
def test_other_words_and_names_of_messages_are_passed_over(text):
    assert find_words(text, list_message_names()) == []
