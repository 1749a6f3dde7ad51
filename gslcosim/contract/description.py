"""What a record's class says of its fields, as pydantic knows it: who checks and who publishes records asks here.

A record is a msgspec struct, which is made, written and read without a look at its limits. The limits stand in its
annotations, in pydantic's words; a pydantic model of the same fields is made from them when it is first asked for.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar, cast

import msgspec
from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, create_model, model_validator
from pydantic_core import CoreSchema, core_schema

AnyStruct = TypeVar("AnyStruct", bound=msgspec.Struct)

_CONFIG = ConfigDict(frozen=True, strict=True, extra="ignore", allow_inf_nan=False, val_json_bytes="base64")


@cache
def description_of(record: type[msgspec.Struct]) -> type[BaseModel]:
    """Return the pydantic model of a record: its fields with their limits, and its JSON Schema.

    A record may say `json_schema_extra()`, words of JSON Schema that stand beside its fields, and `check_together()`,
    which raises ValueError where fields do not go together.
    """
    fields: dict[str, Any] = {field.name: (field.type, _default_of(field)) for field in msgspec.structs.fields(record)}
    config = _CONFIG.copy()
    if extra := cast(Any, record).json_schema_extra():
        config["json_schema_extra"] = extra
    check: Any = model_validator(mode="after")(_check_of(record))
    return create_model(
        record.__name__,
        __config__=config,
        __doc__=record.__doc__,
        __module__=record.__module__,
        __validators__={"check_together": check},
        **fields,
    )


def checked(record: type[AnyStruct], fields: object) -> AnyStruct:
    """Return the record with these fields, or the record itself.

    Raises:
        pydantic.ValidationError: a field is missing, of the wrong type, or out of its limits.
    """
    if type(fields) is record:
        return fields
    return _maker_of(record)(description_of(record).model_validate(fields))


def checked_json(record: type[AnyStruct], text: bytes) -> AnyStruct:
    """Return the record in a JSON object.

    Raises:
        pydantic.ValidationError: as `checked`, or it is no JSON object.
    """
    return _maker_of(record)(description_of(record).model_validate_json(text))


def schema_within(record: type[msgspec.Struct], handler: GetCoreSchemaHandler) -> CoreSchema:
    """Return how pydantic checks a record that is part of another: one that is made already passes as it is."""
    make = _maker_of(record)

    def taken(value: Any, check: core_schema.ValidatorFunctionWrapHandler) -> Any:
        return value if type(value) is record else make(check(value))

    model = description_of(record)
    return core_schema.json_or_python_schema(
        json_schema=core_schema.no_info_after_validator_function(make, handler(model)),
        python_schema=core_schema.no_info_wrap_validator_function(taken, handler(model)),
    )


def _default_of(field: msgspec.structs.FieldInfo) -> Any:
    if field.default_factory is not msgspec.NODEFAULT:
        return field.default_factory()
    return ... if field.default is msgspec.NODEFAULT else field.default


def _check_of(record: type[msgspec.Struct]) -> Callable[[BaseModel], BaseModel]:
    def check(model: BaseModel) -> BaseModel:
        cast(Any, record).check_together(model)
        return model

    return check


def _maker_of(record: type[AnyStruct]) -> Callable[[BaseModel], AnyStruct]:
    return lambda model: msgspec.StructMeta.__call__(record, **vars(model))
