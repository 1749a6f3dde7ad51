"""The examples from which the golden vectors are made hold every message and every optional field."""

import types
import typing

import msgspec
import pytest
from contract_examples import EXAMPLES

from gslcosim.contract import codec
from gslcosim.contract.messages import Record
from gslcosim.contract.record import get_pydantic_model
from gslcosim_conformance.message_schemas import list_published_types


def records_in(value: object) -> list[Record]:
    if isinstance(value, tuple):
        return [record for item in value for record in records_in(item)]
    if not isinstance(value, Record):
        return []
    return [value, *records_in(msgspec.structs.astuple(value))]


def optional_fields(record_type: type[Record]) -> set[str]:
    return {
        name
        for name, field in get_pydantic_model(record_type).model_fields.items()
        if not field.is_required() or _accepts_none(field.annotation)
    }


def _accepts_none(annotation: object) -> bool:
    return typing.get_origin(annotation) in (typing.Union, types.UnionType) and type(None) in typing.get_args(
        annotation
    )


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_comes_back_from_its_bytes(name):
    assert codec.decode(type(EXAMPLES[name]), codec.encode(EXAMPLES[name])) == EXAMPLES[name]


def test_every_message_type_has_an_example():
    assert {type(message) for message in EXAMPLES.values()} == set(list_published_types())


def test_every_optional_field_appears_with_a_value_in_some_example():
    records = records_in(tuple(EXAMPLES.values()))
    for record_type in {type(record) for record in records}:
        for name in optional_fields(record_type):
            default = get_pydantic_model(record_type).model_fields[name].default
            values = [getattr(record, name) for record in records if type(record) is record_type]
            assert any(value is not None and value != default for value in values), f"{record_type.__name__}.{name}"
