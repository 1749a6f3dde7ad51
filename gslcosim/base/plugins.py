"""Plug-ins that installed packages offer by entry points, imported on their first use."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from gslcosim.base.errors import ScenarioError
from gslcosim.base.extensions import list_registered

AnyPlugin = TypeVar("AnyPlugin")


class PluginError(ScenarioError):
    """An installed package offers an unusable plug-in; the package's author corrects it."""

    def __init__(self, *, expected: str, found: str, remedy: str) -> None:
        super().__init__(f"expected {expected}, was {found}. {remedy}")
        self.expected, self.found, self.remedy = expected, found, remedy


@dataclass(frozen=True, kw_only=True)
class EntryPoints:
    """Plug-ins in the group of entry points `group`; `what` is the noun for one of them in errors."""

    group: str
    what: str

    def names(self) -> tuple[str, ...]:
        """Return the names of all plug-ins, in alphabetical order."""
        return tuple(dict.fromkeys(point.name for point in list_registered(self.group)))

    def find_values(self, name: str) -> tuple[str, ...]:
        """Return each different `module:attribute` that is offered under a name, in alphabetical order."""
        return tuple(sorted({point.value for point in list_registered(self.group) if point.name == name}))

    def build_name_error(self, name: str, found: Sequence[str]) -> PluginError:
        """Return the error for a name that several packages offer."""
        return PluginError(
            expected=f"one package that offers the {self.what} {name!r}",
            found=" and ".join(found),
            remedy="Uninstall one of them, or rename what it offers.",
        )

    def loaded(self, name: str, accept: Callable[[object], AnyPlugin | None], expected: str) -> AnyPlugin:
        """Return the plug-in of a name, one of `names`.

        Args:
            name: The name.
            accept: Returns the wanted object from that of the entry point, or None if it is something else.
            expected: The expected object, for the error: `the SensorKind 'clicks'`.

        Raises:
            PluginError: two packages offer the name, the package cannot be imported, or it offers something else.
        """
        values = self.find_values(name)
        if len(values) > 1:
            raise self.build_name_error(name, values)
        point = next(point for point in list_registered(self.group) if point.name == name)
        try:
            offered: object = point.load()
        # Another project's package may raise anything on import.
        except Exception as error:
            raise PluginError(
                expected=f"{point.value} to be imported for the {self.what} {name!r}",
                found=repr(error),
                remedy="Correct the package.",
            ) from error
        accepted = accept(offered)
        if accepted is None:
            raise PluginError(
                expected=f"{point.value} to be {expected}",
                found=f"{offered!s:.60}",
                remedy="Correct the entry point of the package.",
            )
        return accepted
