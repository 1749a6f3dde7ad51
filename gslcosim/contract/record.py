"""What all messages are made of: numbers and names, frozen records, and the base of messages."""

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec, Self, TypeVar, cast, dataclass_transform

import msgspec
from pydantic import Field, GetCoreSchemaHandler, JsonValue, StringConstraints
from pydantic_core import CoreSchema

from gslcosim.contract.description import checked, description_of, schema_within

Quaternion = tuple[float, float, float, float]
Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Tick = Annotated[int, Field(ge=0, le=2**53)]

AnyRecord = TypeVar("AnyRecord")
Fields = ParamSpec("Fields")


@dataclass_transform(frozen_default=True, kw_only_default=True)
class RecordType(msgspec.StructMeta):
    """The type of record classes: frozen structs whose constructor checks all fields, and takes them by name."""

    def __new__(mcls, name: str, bases: tuple[type, ...], namespace: dict[str, Any]) -> "RecordType":
        """Make a class of records."""
        return super().__new__(mcls, name, bases, namespace, frozen=True, kw_only=True)

    if not TYPE_CHECKING:  # type checkers know the constructor by the fields

        def __call__(cls, **fields: Any) -> Any:  # noqa: N805 - of a metaclass
            """Make a record, or raise pydantic's ValidationError."""
            return checked(cls, fields)


def unchecked(record: Callable[Fields, AnyRecord]) -> Callable[Fields, AnyRecord]:
    """Return the constructor of a record without its checks, at a tenth of the cost.

    For who makes records at every tick of values whose types are known: reals are floats, not whole numbers or numpy's.
    """
    return partial(msgspec.StructMeta.__call__, cast(Any, record))


class Record(msgspec.Struct, metaclass=RecordType):
    """Base of all parts of messages: frozen, no conversion of types, unknown keys ignored, no NaN or infinity."""

    def check_together(self) -> None:
        """Raise ValueError where fields do not go together; each field has been checked."""

    @classmethod
    def json_schema_extra(cls) -> dict[str, JsonValue]:
        """Return words of JSON Schema that stand beside the fields."""
        return {}

    @classmethod
    def model_validate(cls, fields: object) -> Self:
        """Return the record with these fields.

        Raises:
            pydantic.ValidationError: a field is missing, of the wrong type, or out of its limits.
        """
        return checked(cls, fields)

    def model_copy(self, *, update: Mapping[str, Any] | None = None) -> Self:
        """Return the record with some fields replaced, which are not checked."""
        return msgspec.structs.replace(self, **update or {})

    def model_dump(self, *, exclude_none: bool = False, exclude_defaults: bool = False) -> dict[str, Any]:
        """Return the fields as a map, as the wire has them; without those that are None or have their default."""
        defaults = _defaults_of(type(self)) if exclude_defaults else {}
        kept: dict[str, Any] = {}
        for name in self.__struct_fields__:
            value = getattr(self, name)
            is_default = name in defaults and value == defaults[name]
            if is_default or (exclude_none and value is None):
                continue
            if isinstance(value, Record | tuple):
                value = _plain(value, exclude_none=exclude_none, exclude_defaults=exclude_defaults)
            kept[name] = value
        return kept

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Tell pydantic how a record is checked that is part of something else."""
        return schema_within(cls, handler)


class Message(Record):
    """Base of all messages: a fact about one tick."""

    tick: Tick

    @property
    def closes_port(self) -> bool:
        """Whether no further message follows on this port."""
        return False

    @property
    def is_question(self) -> bool:
        """Whether somebody's answer to this message is waited for."""
        return False

    def announced_ports(self) -> frozenset[str]:
        """Return the announced ports that carry a message for this tick because of this one."""
        return frozenset()


@cache
def _defaults_of(record: type[Record]) -> dict[str, Any]:
    fields = description_of(record).model_fields
    return {name: field.default for name, field in fields.items() if not field.is_required()}


def _plain(value: Any, **excluded: bool) -> Any:
    if isinstance(value, Record):
        return value.model_dump(**excluded)
    if isinstance(value, tuple):
        return tuple(_plain(item, **excluded) for item in cast(tuple[Any, ...], value))
    return value
