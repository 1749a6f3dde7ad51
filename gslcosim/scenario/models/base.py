"""Base of all parts of a scenario: frozen, kinds of numbers and names, and blocks that are one of several kinds."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self, TypeVar, cast

from pydantic import (
    BaseModel,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from gslcosim.base.errors import UsageError
from gslcosim.base.plugins import EntryPoints, PluginError
from gslcosim.base.problems import broken_rule_error
from gslcosim.base.scenario_keys import find_registering_packages, list_scenario_keys
from gslcosim.base.spec import Name as Name
from gslcosim.base.spec import Positive as Positive
from gslcosim.base.spec import Spec as Spec

RoomEdge = Annotated[float, Field(gt=0, le=10_000)]
NonNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0, le=1000)]


AnySpec = TypeVar("AnySpec", bound=Spec)


def with_registered_keys(place: str) -> Callable[[type[AnySpec]], type[AnySpec]]:
    """Return a decorator that adds the keys which extensions register for a place to the model of its block."""

    def add_keys(block: type[AnySpec]) -> type[AnySpec]:
        keys = list_scenario_keys(place)
        if not keys:
            return block
        fields = list(block.model_fields.items())
        for key in keys:
            names = [name for name, _ in fields]
            if key.name in names:
                raise UsageError(
                    f"gslcosim.starts: expected a new key in {place or 'scenarios'}, was {key.name!r} "
                    f"of {find_registering_packages(key)}, which is there already. Rename it, or uninstall the package."
                )
            i = names.index(key.after) + 1 if key.after in names else len(names)
            field = Field(default=key.default, description=key.description)
            fields.insert(i, (key.name, FieldInfo.from_annotated_attribute(key.annotation, field)))
            block.__annotations__[key.name] = key.annotation
        block.model_fields.clear()
        block.model_fields.update(fields)
        block.model_rebuild(force=True)
        return block

    return add_keys


# Compared by identity: annotations are hashed.
@dataclass(frozen=True, eq=False)
class OneOf:
    """Annotation of a block that is one of several kinds, distinguished by the key `tag_key`.

    It is part of `Annotated[Base, OneOf(...)]`. A block is validated as its kind; places of problems have the kind
    between the block and its key, like those of pydantic's own tagged unions.

    Attributes:
        tag_key: The key that names the kind, for example `model`.
        base: Base class of all blocks; a block of a package narrows `tag_key` to its name as default.
        own: gslcosim's block of each kind; several kinds may have the same.
        offers: Kinds of other packages, if they may add some; none can replace gslcosim's own.
        default: Kind of a block that does not name one; absent: it has to.
        part: Attribute of the offered object that is the block, beside its `name`; absent: the object itself is the
            block.
        unknown: Expected value in the error of an unknown kind; absent: the known kinds.
        form: Kind for values of `tag_key` that are blocks, and their notation: `("file", "{file: PATH}")`.
        descriptions: Description of each of gslcosim's kinds, if several have the same block.
    """

    tag_key: str
    base: type[Spec]
    own: Mapping[str, type[Spec]]
    offers: EntryPoints | None
    default: str | None = None
    part: str | None = None
    unknown: str | None = None
    form: tuple[str, str] | None = None
    descriptions: Mapping[str, str] = field(default_factory=dict[str, str])

    def names(self) -> tuple[str, ...]:
        """Return the names of all kinds, those of other packages last."""
        written = [self.form[1] if self.form and name == self.form[0] else name for name in self.own]
        offered = self.offers.names() if self.offers else ()
        return (*written, *(name for name in offered if name not in self.own))

    def block_of(self, kind: object) -> type[Spec] | None:
        """Return the block of a kind, or None if there is no such kind."""
        if not isinstance(kind, str):
            return None
        offered = self.offers.find_values(kind) if self.offers is not None else ()
        if self.offers is None or not offered:
            return self.own.get(kind)
        if kind in self.own:
            raise self.offers.build_name_error(kind, ("gslcosim", *offered))
        what = f"a class for {kind!r} that derives from {self.base.__name__}"
        if self.part is not None:
            what = f"an object for {kind!r} whose {self.part} derive from {self.base.__name__}"
        return self.offers.loaded(kind, lambda offered: self._block_in(offered, kind), what)

    def blocks(self) -> Iterator[tuple[str, type[Spec]]]:
        """Yield each kind with its block; those of other packages last, each imported at its turn.

        Unusable packages are left out: a file that names one of their kinds gets the reason.
        """
        yield from self.own.items()
        for kind in self.offers.names() if self.offers else ():
            try:
                block = None if kind in self.own else self.block_of(kind)
            except PluginError:
                continue
            if block is not None:
                yield kind, block

    def _block_in(self, offered: object, kind: str) -> type[Spec] | None:
        block = getattr(offered, self.part, None) if self.part is not None else offered
        if not (isinstance(block, type) and issubclass(block, self.base)):
            return None
        if self.part is not None:
            return block if getattr(offered, "name", None) == kind else None
        return block if block.model_fields[self.tag_key].default == kind else None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return pydantic's schema of the annotation; pydantic calls it."""
        return core_schema.with_info_wrap_validator_function(self._validated, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the JSON schema of any of the installed kinds; pydantic calls it."""
        blocks = list(dict.fromkeys(block for _, block in self.blocks()))
        if not blocks:
            return handler(schema)
        return {"anyOf": [handler(block.__pydantic_core_schema__) for block in blocks]}

    def _validated(self, value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        if not isinstance(value, dict):
            return handler(value)
        values = cast("dict[str, Any]", value)
        kind = values.get(self.tag_key, self.default)
        if kind is None and self.tag_key not in values:
            raise _refused([InitErrorDetails(type="missing", loc=(self.tag_key,), input=values)])
        if self.form is not None and isinstance(kind, dict):
            kind = self.form[0]
        try:
            block = self.block_of(kind)
        except PluginError as error:
            rule = broken_rule_error(key=self.tag_key, expected=error.expected, found=error.found, remedy=error.remedy)
            raise _refused([InitErrorDetails(type=rule, loc=(), input=values)]) from error
        if block is None:
            raise _refused([self._unknown_kind(kind, values)])
        try:
            # Strict like scenario files; JSON, because strict models accept its lists as tuples.
            if info.mode == "json":
                return block.model_validate_json(json.dumps(values), strict=True)
            return block.model_validate(values)
        except ValidationError as error:
            raise _refused([_inside(str(kind), details) for details in error.errors(include_url=False)]) from error

    def _unknown_kind(self, kind: object, values: dict[str, Any]) -> InitErrorDetails:
        if self.unknown is not None and isinstance(kind, str):
            names = ", ".join(self.names()) or "there is none"
            rule = broken_rule_error(
                key=self.tag_key,
                expected=f"{self.unknown} ({names})",
                found=f"'{kind}'",
                remedy="Install the package, or correct the name.",
            )
            return InitErrorDetails(type=rule, loc=(), input=values)
        context = {"discriminator": self.tag_key, "tag": str(kind), "expected_tags": ", ".join(self.names())}
        return InitErrorDetails(type="union_tag_invalid", loc=(), input=values, ctx=context)


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
    """A block in which some keys belong to some kinds only: in others they are errors, and are not dumped.

    `tag_key` is the key that names the kind. `belongs` has the kinds of each key that does not belong to all; a key
    inside a block of the block is written `plume.meander_s`.
    """

    tag_key: ClassVar[str] = "kind"
    belongs: ClassVar[Mapping[str, tuple[str, ...]]] = {}

    @property
    def kind_name(self) -> str:
        """The name of the block's kind."""
        return str(getattr(self, self.tag_key))

    def useless_keys(self) -> dict[str, str]:
        """Return the keys without a meaning in this block, each with its home: `model: filament`."""
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
                raise broken_rule_error(
                    key=key,
                    expected=f"no {name} with {self.tag_key}: {self.kind_name}",
                    found="one",
                    remedy=f"{name} belongs to {home}.",
                )
        return self


# `null` has the meaning of an absent key.
def _is_given(block: BaseModel, key: str) -> bool:
    first, _, rest = key.partition(".")
    inner = getattr(block, first)
    if first not in block.model_fields_set or inner is None:
        return False
    return _is_given(inner, rest) if rest else True
