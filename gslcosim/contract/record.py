"""Records, of which all messages are made: frozen structs with checked fields, numbers, names and numeric arrays.

A record is a msgspec struct, which is built, encoded and decoded without a check of its limits. The limits are part of
its annotations, in pydantic's notation; a pydantic model of the same fields is derived from them on first use.
"""

import difflib
import math
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import TYPE_CHECKING, Annotated, Any, Literal, ParamSpec, Self, TypeVar, cast, dataclass_transform

import msgspec
import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    JsonValue,
    StringConstraints,
    ValidationError,
    ValidationInfo,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from gslcosim.base.untrusted_input import describe_validation_errors

AnyStruct = TypeVar("AnyStruct", bound=msgspec.Struct)

_CONFIG = ConfigDict(frozen=True, strict=True, extra="ignore", allow_inf_nan=False, val_json_bytes="base64")
Quaternion = tuple[float, float, float, float]
Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Tick = Annotated[int, Field(ge=0, le=2**53)]
AnyRecord = TypeVar("AnyRecord")
Fields = ParamSpec("Fields")
DTYPES = {"float32": "<f4", "float64": "<f8", "uint8": "|u1", "int32": "<i4", "int64": "<i8"}
MAX_DIMENSIONS = 8
_DTYPES_BY_NAME = {name: np.dtype(code) for name, code in DTYPES.items()}
_NAMES_BY_DTYPE = {dtype: name for name, dtype in _DTYPES_BY_NAME.items()}
# Dot products of longer ones may run in several threads.
_SHORT_ARRAY_BYTES = 4096


@cache
def get_pydantic_model(record: type[msgspec.Struct]) -> type[BaseModel]:
    """Return the pydantic model of a record: its fields with their limits, and its JSON Schema.

    A record may define `json_schema_extra()`, keywords of JSON Schema beside its fields, and `check_together()`, which
    raises ValueError where fields are inconsistent.
    """
    fields: dict[str, Any] = {field.name: (field.type, _get_default(field)) for field in msgspec.structs.fields(record)}
    config = _CONFIG.copy()
    if extra := cast(Any, record).json_schema_extra():
        config["json_schema_extra"] = extra

    def check(model: BaseModel) -> BaseModel:
        cast(Any, record).check_together(model)
        return model

    return create_model(
        record.__name__,
        __config__=config,
        __doc__=record.__doc__,
        __module__=record.__module__,
        __validators__={"check_together": cast(Any, model_validator(mode="after")(check))},
        **fields,
    )


def validate_fields(record: type[AnyStruct], fields: object) -> AnyStruct:
    """Return the record with these fields, or the record itself.

    Raises:
        pydantic.ValidationError: a field is missing, of the wrong type, or out of its limits.
    """
    if type(fields) is record:
        return fields
    return _build_constructor(record)(get_pydantic_model(record).model_validate(fields))


def validate_json(record: type[AnyStruct], text: bytes) -> AnyStruct:
    """Return the record in a JSON object.

    Raises:
        pydantic.ValidationError: as `validate_fields`, or the text is not a JSON object.
    """
    return _build_constructor(record)(get_pydantic_model(record).model_validate_json(text))


def _get_default(field: msgspec.structs.FieldInfo) -> Any:
    if field.default_factory is not msgspec.NODEFAULT:
        return field.default_factory()
    return ... if field.default is msgspec.NODEFAULT else field.default


def _build_constructor(record: type[AnyStruct]) -> Callable[[BaseModel], AnyStruct]:
    return lambda model: msgspec.StructMeta.__call__(record, **vars(model))


@dataclass_transform(frozen_default=True, kw_only_default=True)
class RecordType(msgspec.StructMeta):
    """Metaclass of records: frozen structs whose constructor takes all fields by name and checks them."""

    def __new__(mcls, name: str, bases: tuple[type, ...], namespace: dict[str, Any]) -> "RecordType":
        """Create a class of records."""
        return super().__new__(mcls, name, bases, namespace, frozen=True, kw_only=True)

    if not TYPE_CHECKING:  # type checkers derive the constructor from the fields

        def __call__(cls, **fields: Any) -> Any:  # noqa: N805 - of a metaclass
            """Build a record; positions and the like may be lists and numpy arrays.

            Raises:
                TypeError: an unknown keyword; the error names the nearest field.
                ValueError: a field is missing, of the wrong type, or out of its limits.
            """
            unknown = next((name for name in fields if name not in cls.__struct_fields__), None)
            if unknown is not None:
                raise TypeError(_describe_unknown_keyword(cls, unknown))
            try:
                return validate_fields(cls, {name: _from_numpy(value) for name, value in fields.items()})
            except ValidationError as error:
                problems = "; ".join(describe_validation_errors(error))
                raise ValueError(f"{cls.__name__}: {problems}.") from None


def _describe_unknown_keyword(record: type[msgspec.Struct], keyword: str) -> str:
    known = record.__struct_fields__
    # A name without its unit or frame is much shorter: the same beginning is a better sign than a similar spelling.
    begun = [name for name in known if name.startswith(keyword.split("_", maxsplit=1)[0])]
    near = difflib.get_close_matches(keyword, begun, n=1, cutoff=0.0) or difflib.get_close_matches(keyword, known, n=1)
    remedy = f"Did you mean {near[0]}?" if near else f"There are {', '.join(known)}."
    return f"{record.__name__}: expected one of its fields, was the keyword '{keyword}'. {remedy}"


# Convert numpy values and lists to the types of messages: tuples of Python's numbers.
def _from_numpy(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return _from_numpy(cast(Any, value).tolist())
    if isinstance(value, list | tuple):
        return tuple(_from_numpy(item) for item in cast(tuple[Any, ...], value))
    return value


def build_unchecked_constructor(record: Callable[Fields, AnyRecord]) -> Callable[Fields, AnyRecord]:
    """Return the constructor of a record without its checks, at a tenth of the cost.

    For records that are built at every tick from values of known types: reals are floats, not whole numbers or numpy's.
    """
    return partial(msgspec.StructMeta.__call__, cast(Any, record))


class Record(msgspec.Struct, metaclass=RecordType):
    """Base of all parts of messages: frozen, no conversion of types, unknown keys ignored, no NaN or infinity."""

    @property
    def sent(self) -> Self:
        """The record as it is encoded: a field that is `msgspec.UNSET` is left out."""
        return self

    def check_together(self) -> None:
        """Raise ValueError where fields are inconsistent; each field has been checked by itself."""

    @classmethod
    def json_schema_extra(cls) -> dict[str, JsonValue]:
        """Return keywords of JSON Schema that stand beside the fields."""
        return {}

    def model_copy(self, *, update: Mapping[str, Any] | None = None) -> Self:
        """Return the record with some fields replaced, which are not checked."""
        return msgspec.structs.replace(self, **update or {})

    def model_dump(self, *, exclude_none: bool = False, exclude_defaults: bool = False) -> dict[str, Any]:
        """Return the fields as a map, as the wire has them; without those that are None or have their default."""
        defaults = _get_defaults(type(self)) if exclude_defaults else {}
        kept: dict[str, Any] = {}
        sent = self.sent
        for name in self.__struct_fields__:
            value = getattr(sent, name)
            if value is msgspec.UNSET:
                continue
            is_default = name in defaults and value == defaults[name]
            if is_default or (exclude_none and value is None):
                continue
            if isinstance(value, Record | tuple):
                value = _to_plain(value, exclude_none=exclude_none, exclude_defaults=exclude_defaults)
            kept[name] = value
        return kept

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return pydantic's schema for a record that is part of another; an existing record passes unchecked."""
        build = _build_constructor(cls)

        def validate(value: Any, check: core_schema.ValidatorFunctionWrapHandler) -> Any:
            return value if type(value) is cls else build(check(value))

        model = get_pydantic_model(cls)
        return core_schema.json_or_python_schema(
            json_schema=core_schema.no_info_after_validator_function(build, handler(model)),
            python_schema=core_schema.no_info_wrap_validator_function(validate, handler(model)),
        )


class Message(Record):
    """Base of all messages: a fact about one tick."""

    tick: Tick

    @property
    def closes_port(self) -> bool:
        """True when no further message follows on this port."""
        return False

    @property
    def is_question(self) -> bool:
        """True when an answer to this message is awaited."""
        return False

    def announced_ports(self) -> frozenset[str]:
        """Return the announced ports that carry a message for this tick because of this one."""
        return frozenset()


@cache
def _get_defaults(record: type[Record]) -> dict[str, Any]:
    fields = get_pydantic_model(record).model_fields
    return {name: field.default for name, field in fields.items() if not field.is_required()}


def _to_plain(value: Any, **excluded: bool) -> Any:
    if isinstance(value, Record):
        return value.model_dump(**excluded)
    if isinstance(value, tuple):
        return tuple(_to_plain(item, **excluded) for item in cast(tuple[Any, ...], value))
    return value


def _check_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    if len(shape) > MAX_DIMENSIONS:
        raise ValueError(f"expected at most {MAX_DIMENSIONS} dimensions, was {len(shape)}")
    if any(n < 0 for n in shape):
        raise ValueError(f"expected lengths that are not negative, was {shape}")
    return shape


def _check_data(data: bytes, info: ValidationInfo) -> bytes:
    name, shape = info.data.get("dtype"), info.data.get("shape")
    if name is None or shape is None:  # which is reported already
        return data
    dtype = _DTYPES_BY_NAME[name]
    # With Python's own integers: numpy's wrap around, and a hostile shape would pass for an empty one.
    expected = math.prod(shape) * dtype.itemsize
    if len(data) != expected:
        raise ValueError(f"expected {expected} bytes for {name} {shape}, was {len(data)}")
    if dtype.kind == "f" and not _are_finite(np.frombuffer(data, dtype)):
        raise ValueError("expected finite numbers, was NaN or infinity somewhere")
    return data


# One dot product takes a fraction of the time of testing each number; where the squares overflow, each is tested.
def _are_finite(values: NDArray[np.floating]) -> bool:
    is_sure = len(values) <= _SHORT_ARRAY_BYTES and math.isfinite(np.vdot(values, values))
    return is_sure or bool(np.isfinite(values).all())


class NumericArray(Record):
    """An n-dimensional array, C order, little-endian, of finite numbers."""

    dtype: Literal["float32", "float64", "uint8", "int32", "int64"]
    shape: Annotated[tuple[int, ...], AfterValidator(_check_shape)]
    data: Annotated[bytes, AfterValidator(_check_data)]

    @classmethod
    def from_array(cls, array: NDArray[Any]) -> Self:
        """Copy a numpy array of one of the five dtypes into a message field."""
        name = _NAMES_BY_DTYPE.get(array.dtype) or array.dtype.name
        if name not in DTYPES or (array.dtype.kind == "f" and not _are_finite(array.ravel())):
            return cls(dtype=cast(Any, name), shape=array.shape, data=array.tobytes())  # and is rejected
        data = array.astype(_DTYPES_BY_NAME[name], copy=False).tobytes()
        return cast(Self, _new_array(dtype=cast(Any, name), shape=array.shape, data=data))

    def to_array(self) -> NDArray[Any]:
        """Return the values as a read-only numpy array with the message's shape."""
        return np.frombuffer(self.data, _DTYPES_BY_NAME[self.dtype]).reshape(self.shape)


_new_array = build_unchecked_constructor(NumericArray)
