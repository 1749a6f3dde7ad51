"""The rules of docs/contract-evolution.md, held against the contract of the past.

`contract_1_0.json` and later ones have the schemas and bytes of these contracts; they are never rewritten.
"""

import copy
import json
from pathlib import Path

import jsonschema
import pytest
from contract_examples import EXAMPLES

from gslcosim.contract import codec
from gslcosim.contract.record import get_pydantic_model
from gslcosim.contract.version import CONTRACT_VERSION
from gslcosim_conformance.message_schemas import build_json_schema, list_message_types

PASTS = [json.loads(path.read_text()) for path in sorted(Path(__file__).parent.glob("contract_*.json"))]
TYPES = {item.__name__: item for item in list_message_types()}
NOW = {name: build_json_schema(item) for name, item in TYPES.items()}
# What an agent reads; there a new word in an enumeration would surprise it.
READ_BY_AGENTS = {"Briefing", "Observation", "Ending"}
# `allOf` only says in the schema what 1.0 said in its prose: which field a kind of command cannot do without.
PROSE = {"description", "title", "$schema", "$id", "allOf"}


def breaks(old, new, *, may_add_words, at=""):
    """Return what a change of schema breaks, as `place: what`."""
    found = []
    for name, record in {"": old, **old.get("$defs", {})}.items():
        later = new["$defs"].get(name) if name else new
        place = f"{at}{'.' + name if name else ''}"
        found += [f"{place}: gone"] if later is None else _record_breaks(record, later, place, may_add_words)
    return found


def _record_breaks(old, new, place, may_add_words):
    found = []
    old_names, new_names = list(old["properties"]), list(new["properties"])
    if new_names[: len(old_names)] != old_names:
        found.append(f"{place}: fields removed, or a new one before old ones")
    found += [f"{place}.{name}: must be given now" for name in new.get("required", []) if name not in old["required"]]
    found += [
        f"{place}.{name}: may be missing now" for name in old.get("required", []) if name not in new.get("required", [])
    ]
    for name in set(old_names) & set(new_names):
        if not _is_same(old["properties"][name], new["properties"][name], may_add_words):
            found.append(f"{place}.{name}: another type, range or default")
    return found


def _is_same(old, new, may_add_words):
    if may_add_words and set(old.get("enum", ())) <= set(new.get("enum", ())):
        old, new = ({k: v for k, v in side.items() if k != "enum"} for side in (old, new))
    return _bare(old) == _bare(new)


def _bare(schema):
    if isinstance(schema, list):
        return [_bare(item) for item in schema]
    if isinstance(schema, dict):
        return {word: _bare(value) for word, value in schema.items() if word not in PROSE}
    return schema


def of_past(key):
    """Parametrize over an entry of each past contract: the contract and the entry."""
    return [pytest.param(past, item, id=f"{past['version']}-{name_of(item)}") for past in PASTS for item in past[key]]


def name_of(item):
    return item["name"] if isinstance(item, dict) else item


@pytest.mark.parametrize(("past", "message"), of_past("schemas"))
def test_nothing_of_the_past_is_broken(past, message):
    assert breaks(past["schemas"][message], NOW[message], may_add_words=message not in READ_BY_AGENTS) == []


@pytest.mark.parametrize(("past", "vector"), of_past("vectors"))
def test_an_old_agent_is_understood(past, vector):
    """What was written by a past contract is read now, and what it said is kept; new fields have their defaults."""
    del past
    message = codec.decode(TYPES[vector["message"]], bytes.fromhex(vector["msgpack"]))
    said = codec._unpack_map("", bytes.fromhex(vector["msgpack"]))
    assert keeps(message.model_dump(), said)


def keeps(now, said):
    """Tell whether all that was said stands, with new fields beside it at any depth."""
    if isinstance(said, dict):
        return isinstance(now, dict) and all(name in now and keeps(now[name], value) for name, value in said.items())
    if isinstance(said, list | tuple):
        return len(now) == len(said) and all(keeps(new, old) for new, old in zip(now, said, strict=True))
    return now == said


@pytest.mark.parametrize("past", PASTS, ids=lambda past: past["version"])
@pytest.mark.parametrize("example", EXAMPLES)
def test_an_old_agent_understands(past, example):
    """What is written now, new fields included, is a valid message of the past for a reader that ignores unknown keys.

    Kinds of commands that it did not have are left out: only the framework reads them.
    """
    name = type(EXAMPLES[example]).__name__
    fields = json.loads(codec.encode_json(EXAMPLES[example]))
    is_new_kind = name == "Command" and fields["kind"] not in past["schemas"]["Command"]["properties"]["kind"]["enum"]
    if name not in past["schemas"] or is_new_kind:
        return
    jsonschema.validate(fields, past["schemas"][name], jsonschema.Draft202012Validator)


@pytest.mark.parametrize("past", PASTS, ids=lambda past: past["version"])
@pytest.mark.parametrize("name", sorted(READ_BY_AGENTS))
def test_a_new_agent_runs_in_an_old_run(past, name):
    """It misses what is new there: each field since then has a default."""
    old = past["schemas"][name]
    for vector in (vector for vector in past["vectors"] if vector["message"] == name):
        message = codec.decode(TYPES[name], bytes.fromhex(vector["msgpack"]))
        for field, info in get_pydantic_model(TYPES[name]).model_fields.items():
            assert field in old["properties"] or getattr(message, field) == info.default


def test_what_a_later_framework_adds_is_ignored():
    """Unknown keys at any depth do no harm, in either form."""
    later = EXAMPLES["observation"].model_dump()
    later["battery_frac"] = 0.5
    later["readings"][0]["temperature_k"] = 293.0
    later["readings"][0]["history"] = [{"tick": 1}]
    for read, written in (
        (codec.decode, codec._msgpack.packb(later)),
        (codec.decode_json, codec.dump_json_line(later)),
    ):
        assert read(TYPES["Observation"], written) == EXAMPLES["observation"]


def test_a_release_of_today_is_of_the_same_major_version():
    assert {past["version"].split(".")[0] for past in PASTS} == {CONTRACT_VERSION.split(".")[0]}
    assert CONTRACT_VERSION.split(".")[0] == str(codec.MAJOR_VERSION)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda s: s["properties"].pop("yaw_rad"), "Observation: fields removed"),
        (lambda s: s["properties"].update(yaw_rad={"type": "string"}), "Observation.yaw_rad: another type"),
        (lambda s: s.update(properties={"new": {}, **s["properties"]}), "a new one before old ones"),
        (lambda s: s["required"].append("notice"), "Observation.notice: must be given now"),
        (lambda s: s["required"].remove("status"), "Observation.status: may be missing now"),
        (lambda s: s["$defs"].pop("Reading"), "Observation.Reading: gone"),
        (lambda s: s["$defs"]["Reading"]["properties"].pop("unit"), "Observation.Reading: fields removed"),
        (lambda s: s["properties"]["tick"].update(maximum=10), "Observation.tick: another type, range"),
    ],
)
def test_each_rule_finds_its_breach(change, expected):
    changed = copy.deepcopy(NOW["Observation"])
    change(changed)
    assert expected in " ".join(breaks(NOW["Observation"], changed, may_add_words=False, at="Observation"))


def test_new_words_are_for_commands_only():
    changed = copy.deepcopy(NOW["Command"])
    changed["properties"]["kind"]["enum"].append("teleport")
    assert breaks(NOW["Command"], changed, may_add_words=True) == []
    assert breaks(NOW["Command"], changed, may_add_words=False) == [".kind: another type, range or default"]
