"""JSON files beside measured tables: values by their path, checked as they are read."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gslcosim.base.quantities import Vec3
from gslcosim.base.untrusted_input import JsonObject, MalformedFileError, read_json
from gslcosim_validation.readers.columns import MeasuredDataError, build_error


@dataclass(frozen=True)
class Document:
    """A JSON file and what stands in it."""

    path: Path
    content: dict[str, Any]

    def get(self, *keys: str) -> Any:
        """Return the value at a path of keys, or None."""
        value: Any = self.content
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else None
        return value

    def number(self, *keys: str) -> float:
        """Return a number."""
        value = self.get(*keys)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._error(keys, "a number", value)
        return float(value)

    def vector(self, *keys: str) -> Vec3:
        """Return three numbers."""
        value = self.get(*keys)
        is_vector = isinstance(value, list) and len(value) == 3 and all(isinstance(x, int | float) for x in value)
        if not is_vector:
            raise self._error(keys, "three numbers", value)
        return float(value[0]), float(value[1]), float(value[2])

    def block(self, *keys: str) -> dict[str, Any]:
        """Return a block with at least one entry."""
        value = self.get(*keys)
        if not isinstance(value, dict) or not value:
            raise self._error(keys, "a block with entries", value)
        return value

    def _error(self, keys: tuple[str, ...], expected: str, value: object) -> MeasuredDataError:
        found = "nothing" if value is None else repr(value)[:60]
        return build_error(self.path, ".".join(keys), expected=expected, found=found, remedy="Add or correct it.")


def read_document(path: Path) -> Document:
    """Return a JSON file."""
    try:
        return Document(path, read_json(path, JsonObject))
    except MalformedFileError as error:
        raise MeasuredDataError(str(error)) from error
