"""Blocks that are one of several kinds, each with keys of its own; other packages may add kinds."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

from pydantic import BaseModel, GetCoreSchemaHandler, ValidationError, ValidationInfo, ValidatorFunctionWrapHandler
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from gslcosim.scenario.models.spec import Spec

# Returns the block of a kind that another package offers, or nothing where none does.
Offered = Callable[[str], type[Spec] | None]


@dataclass(frozen=True)
class OneOf:
    """Says of an annotation that its block is one of several kinds, told apart by the key `tag_key`.

    It stands in `Annotated[Base, OneOf(...)]`. A block is validated as its kind; the places of problems have the kind
    between the block and its key, as those of pydantic's own tagged unions have.

    Attributes:
        tag_key: The key that names the kind, for example `model`.
        own: The block of each kind that gslcosim has; several kinds may have the same.
        names: Returns the names of all kinds, those of other packages included.
        offered: Returns the block of a kind that another package offers; it is asked only for such kinds. It may
            raise a `broken_rule`.
    """

    tag_key: str
    own: Mapping[str, type[Spec]]
    names: Callable[[], tuple[str, ...]]
    offered: Offered

    def block_of(self, kind: object) -> type[Spec] | None:
        """Return the block of a kind, or nothing where there is no such kind."""
        if not isinstance(kind, str):
            return None
        return self.own[kind] if kind in self.own else self.offered(kind)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return pydantic's schema of the annotation; pydantic calls it."""
        return core_schema.with_info_wrap_validator_function(self._validated, handler(source))

    def _validated(self, value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        if not isinstance(value, dict):
            return handler(value)
        values = cast("dict[str, Any]", value)
        if self.tag_key not in values:
            raise _refused([InitErrorDetails(type="missing", loc=(self.tag_key,), input=values)])
        kind = values[self.tag_key]
        try:
            block = self.block_of(kind)
        except PydanticCustomError as error:
            raise _refused([InitErrorDetails(type=error, loc=(), input=values)]) from error
        if block is None:
            context = {"discriminator": self.tag_key, "tag": str(kind), "expected_tags": ", ".join(self.names())}
            raise _refused([InitErrorDetails(type="union_tag_invalid", loc=(), input=values, ctx=context)])
        try:
            return _read(block, values, is_json=info.mode == "json")
        except ValidationError as error:
            raise _refused([_inside(kind, details) for details in error.errors(include_url=False)]) from error


# Strict as scenario files are; JSON, because strict models take its lists as tuples.
def _read(block: type[BaseModel], values: dict[str, Any], *, is_json: bool) -> BaseModel:
    return block.model_validate_json(json.dumps(values), strict=True) if is_json else block.model_validate(values)


def _inside(kind: str, details: Any) -> InitErrorDetails:
    text = details["msg"].replace("{", "(").replace("}", ")")
    return InitErrorDetails(
        type=PydanticCustomError(details["type"], text, details.get("ctx")),
        loc=(kind, *details["loc"]),
        input=details["input"],
    )


def _refused(details: list[InitErrorDetails]) -> ValidationError:
    return ValidationError.from_exception_data("block", details)
