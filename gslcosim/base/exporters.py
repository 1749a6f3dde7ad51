"""Exporters: other programs' formats for runs and environments, registered by extensions and found by name."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal

from gslcosim.base.extensions import EXPORTERS_GROUP, load_registered, tuple_of

Exported = Literal["run", "environment"]


@dataclass(frozen=True, kw_only=True)
class Exporter:
    """A format for export.

    Attributes:
        name: The word for it on the command line, such as `parquet`.
        of: Kind of data that it exports.
        summary: Its clause in help.
        function: `module:function` that writes the files, imported on use. For a run its arguments are the run (its
            data, as read back), the folder, the name, and a function that receives progress as text; it returns the
            files.
    """

    name: str
    of: Exported
    summary: str
    function: str

    def load(self) -> Callable[..., Any]:
        """Return the function that writes the files."""
        module, _, name = self.function.partition(":")
        return getattr(import_module(module), name)


def list_exporters(of: Exported) -> dict[str, Exporter]:
    """Return the exporters of runs or of environments that installed extensions register, by name.

    Raises:
        UsageError: an extension registers something else, or cannot be imported.
    """
    offered = load_registered(EXPORTERS_GROUP, tuple_of(Exporter), "a tuple of Exporter")
    return {each.name: each for some in offered for each in some if each.of == of}
