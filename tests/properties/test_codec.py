"""Whatever the schema allows survives the wire, and nothing else does."""

import math
import types
import typing
from typing import Any

import msgpack
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy
from pydantic import StringConstraints

from gslcosim.base.errors import ContractError
from gslcosim.contract import codec
from gslcosim.contract.messages import Belief, Command, Message, Record
from gslcosim.contract.record import DTYPES, NumericArray, get_pydantic_model
from gslcosim_conformance.message_schemas import list_message_types

shapes = st_numpy.array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=4)
arrays = st.sampled_from(sorted(DTYPES)).flatmap(
    lambda dtype: st_numpy.arrays(
        dtype,
        shapes,
        elements={"allow_nan": False, "allow_infinity": False} if dtype.startswith("float") else None,
    )
)

probabilities = st_numpy.arrays(
    "float32", st_numpy.array_shapes(min_dims=2, max_dims=3, max_side=3), elements=st.floats(0.125, 1.0, width=32)
).map(lambda weights: NumericArray.from_array((weights / weights.sum()).astype("float32")))
beliefs = st.builds(
    Belief,
    origin_m=st.tuples(*[st.floats(-1e6, 1e6)] * 3),
    cell_m=st.floats(0.01, 10.0),
    probability=probabilities,
)


def values_of(annotation: Any, constraints: tuple[Any, ...] = ()) -> st.SearchStrategy[Any]:
    """Return a strategy for all values that a message field of this type may hold."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return values_of(arguments[0], (*constraints, *arguments[1:]))
    if origin is typing.Literal:
        return st.sampled_from(arguments)
    if origin in (typing.Union, types.UnionType):
        return st.one_of(*(values_of(argument) for argument in arguments))
    if origin is tuple and arguments[-1] is Ellipsis:
        return st.lists(values_of(arguments[0]), max_size=3).map(tuple)
    if origin is tuple:
        return st.tuples(*(values_of(argument) for argument in arguments))
    if origin is dict:
        return st.dictionaries(*(values_of(argument) for argument in arguments), max_size=3)
    if annotation is NumericArray:
        return arrays.map(NumericArray.from_array)
    if annotation is Belief:
        return beliefs
    if isinstance(annotation, type) and issubclass(annotation, Record):
        return records_of(annotation)
    return scalars_of(annotation, constraints)


def scalars_of(annotation: Any, constraints: tuple[Any, ...]) -> st.SearchStrategy[Any]:
    flat = [item for constraint in constraints for item in (getattr(constraint, "metadata", None) or [constraint])]
    low = max((item.ge for item in flat if getattr(item, "ge", None) is not None), default=None)
    high = min((item.le for item in flat if getattr(item, "le", None) is not None), default=None)
    if annotation is bool:
        return st.booleans()
    if annotation is int:
        return st.integers(-(2**63) if low is None else low, 2**64 - 1 if high is None else high)
    if annotation is float:
        above = max((item.gt for item in flat if getattr(item, "gt", None) is not None), default=None)
        if above is not None:
            return st.floats(above, high, exclude_min=True, allow_nan=False, allow_infinity=False)
        return st.floats(low, high, allow_nan=False, allow_infinity=False)
    if annotation is str:
        text = next((item for item in flat if isinstance(item, StringConstraints)), StringConstraints())
        if text.pattern:
            return st.from_regex(text.pattern, fullmatch=True)
        return st.text(max_size=min(20, text.max_length or 20))
    if annotation is bytes:
        return st.binary(max_size=20)
    assert annotation is types.NoneType, annotation
    return st.none()


def records_of(model: type[Record]) -> st.SearchStrategy[Any]:
    described = get_pydantic_model(model).model_fields
    fields = {name: values_of(field.annotation, tuple(field.metadata)) for name, field in described.items()}
    return (
        st.fixed_dictionaries(fields).map(lambda values: built(model, values)).filter(lambda record: record is not None)
    )


def built(model: type[Record], values: dict[str, Any]) -> Record | None:
    """Return the record, or None where a rule between fields forbids it."""
    try:
        return model(**values)
    except ValueError:
        assert model is Command
        return None


any_message = st.one_of(*(records_of(message_type) for message_type in list_message_types()))
generous = settings(max_examples=200, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much])


@pytest.mark.slow
@generous
@given(any_message)
def test_every_message_comes_back_equal_and_byte_for_byte(message: Message):
    payload = codec.encode(message)
    back = codec.decode(type(message), payload)
    assert back == message
    assert codec.encode(back) == payload
    assert codec.decode_trusted(type(message), payload) == message
    assert payload == msgpack.packb(message.model_dump(), use_bin_type=True)


@pytest.mark.slow
@generous
@given(any_message, st.sampled_from([math.nan, math.inf, -math.inf]), st.randoms(use_true_random=False))
def test_not_a_number_anywhere_is_refused(message: Message, poison: float, random: Any):
    fields = message.model_dump()
    if poison_one_float(fields, poison, random):
        with pytest.raises(ContractError, match="finite number"):
            codec.decode(type(message), msgpack.packb(fields))


def poison_one_float(fields: dict[str, Any], poison: float, random: Any) -> bool:
    places = list(floats_in(fields))
    if not places:
        return False
    *path, last = random.choice(places)
    holder: Any = fields
    for step in path:
        if isinstance(holder[step], tuple):
            holder[step] = list(holder[step])
        holder = holder[step]
    holder[last] = poison
    return True


def floats_in(value: Any, path: tuple[Any, ...] = ()) -> Any:
    if isinstance(value, float):
        yield path
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from floats_in(item, (*path, key))
    elif isinstance(value, tuple | list):
        for index, item in enumerate(value):
            yield from floats_in(item, (*path, index))


@pytest.mark.slow
@generous
@given(any_message, st.dictionaries(st.text("xyz", min_size=9), st.integers() | st.text(), max_size=3))
def test_unknown_keys_are_ignored(message: Message, more: dict[str, Any]):
    more = {key: value for key, value in more.items() if isinstance(value, str) or -(2**63) <= value < 2**64}
    assert codec.decode(type(message), msgpack.packb(message.model_dump() | more)) == message


@generous
@given(st.binary(max_size=200), st.sampled_from(list_message_types()))
def test_arbitrary_bytes_are_refused_with_a_contract_error(payload: bytes, message_type: type[Message]):
    with pytest.raises(ContractError, match=message_type.__name__):
        codec.decode(message_type, payload)


@pytest.mark.slow
@generous
@given(any_message, st.data())
def test_a_truncated_message_is_refused(message: Message, data: st.DataObject):
    payload = codec.encode(message)
    with pytest.raises(ContractError):
        codec.decode(type(message), payload[: data.draw(st.integers(0, len(payload) - 1))])
