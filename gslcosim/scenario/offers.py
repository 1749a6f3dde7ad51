"""What installed packages offer to scenarios by entry points, imported when a scenario names it and not before."""

from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, Generic, TypeVar

from pydantic import ValidationError, ValidationInfo
from pydantic_core import InitErrorDetails, to_json

from gslcosim.scenario.models.rules import broken_rule
from gslcosim.scenario.models.spec import Spec

AnySpec = TypeVar("AnySpec", bound=Spec)


@dataclass(frozen=True, kw_only=True)
class Offers(Generic[AnySpec]):
    """The blocks that packages offer in a group of entry points; each derives from `base`.

    `key` is the key of the block that names it and whose default is that name; `what` is the word for it in errors.
    As metadata of a member of a union it says that this member stands for the kinds of other packages.
    """

    group: str
    base: type[AnySpec]
    key: str
    what: str

    def names(self) -> tuple[str, ...]:
        """Return the names of all that is offered, in alphabetical order."""
        return tuple(sorted(entry_points(group=self.group).names))

    def validated(self, value: dict[str, Any], info: ValidationInfo) -> AnySpec:
        """Return the block that such values describe: strict about JSON, as scenario files are read, else lenient.

        Args:
            value: The block's values; the one of `key` is in `names`.
            info: How the scenario around it is validated.

        Raises:
            PydanticCustomError: what the package offers cannot be imported, or is no such block.
            ValidationError: the values are not what the block allows.
        """
        block = self._import(value[self.key])
        try:
            if info.mode == "json":
                return block.model_validate_json(to_json(value), strict=True)
            return block.model_validate(value)
        except ValidationError as error:
            raise _as_rules(error, block) from None

    def _import(self, name: str) -> type[AnySpec]:
        point = entry_points(group=self.group)[name]
        try:
            block: object = point.load()
        # A package of somebody else may raise anything when it is imported.
        except Exception as error:
            expected = f"{point.value} to be imported for the {self.what} {name!r}"
            raise broken_rule(
                key=self.key, expected=expected, found=repr(error), remedy="Correct the package."
            ) from error
        if isinstance(block, type) and issubclass(block, self.base) and block.model_fields[self.key].default == name:
            return block
        raise broken_rule(
            key=self.key,
            expected=f"{point.value} to be a class for {name!r} that derives from {self.base.__name__}",
            found=f"{block!s:.60}",
            remedy="Correct the entry point of the package.",
        )


# The models of a scenario do not know the fields of others' blocks, so these problems bring their words along.
def _as_rules(error: ValidationError, block: type[Spec]) -> ValidationError:
    from gslcosim.scenario.explain import problems_of

    rules = (
        broken_rule(key=problem.path, expected=problem.expected, found=problem.found, remedy=problem.remedy)
        for problem in problems_of(error, root=block)
    )
    return ValidationError.from_exception_data(
        block.__name__, [InitErrorDetails(type=rule, loc=(), input=None) for rule in rules]
    )
