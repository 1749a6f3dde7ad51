"""Blocks that are one of several kinds: with a block each, to which other packages may add, or with keys of some."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self, cast

from pydantic import (
    BaseModel,
    GetCoreSchemaHandler,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    model_validator,
)
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from gslcosim.scenario.models.rules import broken_rule
from gslcosim.scenario.models.spec import Spec

# Returns the block of a kind that another package offers, or nothing where none does.
Offered = Callable[[str], type[Spec] | None]


# Told apart by identity: annotations are hashed.
@dataclass(frozen=True, eq=False)
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


class KindedSpec(Spec):
    """A block of which some keys belong to some of its kinds only: with others they are errors, and are not dumped.

    `tag_key` is the key that names the kind. `belongs` says which kinds a key belongs to, for those that do not belong
    to all; a key inside a block of the block is written `plume.meander_s`.
    """

    tag_key: ClassVar[str] = "kind"
    belongs: ClassVar[Mapping[str, tuple[str, ...]]] = {}

    @property
    def kind_name(self) -> str:
        """The name of the block's kind."""
        return str(getattr(self, self.tag_key))

    def useless_keys(self) -> dict[str, str]:
        """Return the keys that mean nothing in this block, each with where it belongs: `model: farrell`."""
        return {
            key: f"{self.tag_key}: {', '.join(kinds)}"
            for key, kinds in self.belongs.items()
            if self.kind_name not in kinds
        }

    @model_validator(mode="after")
    def _check_useless(self) -> Self:
        for key, home in self.useless_keys().items():
            if _is_given(self, key):
                name = key.rpartition(".")[2]
                raise broken_rule(
                    key=key,
                    expected=f"no {name} with {self.tag_key}: {self.kind_name}",
                    found="one",
                    remedy=f"{name} belongs to {home}.",
                )
        return self


# `null` is what an absent key means.
def _is_given(block: BaseModel, key: str) -> bool:
    first, _, rest = key.partition(".")
    inner = getattr(block, first)
    if first not in block.model_fields_set or inner is None:
        return False
    return _is_given(inner, rest) if rest else True
