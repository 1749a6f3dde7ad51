"""Exporters: formats of other programs that extensions write runs and environments in, found by their names."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal

from gslcosim.base.extensions import EXPORTERS_GROUP, load_registered, tuple_of

Exported = Literal["run", "environment"]


@dataclass(frozen=True, kw_only=True)
class Exporter:
    """A format in which something is written.

    Attributes:
        name: The word for it on the command line, such as `parquet`.
        of: What is written.
        summary: The clause for it in help.
        function: `module:function` that writes it, imported when it is used. For a run it is called with the run
            (its data, as read back), the folder, the name, and a function that is given progress as text, and
            returns the files.
    """

    name: str
    of: Exported
    summary: str
    function: str

    def load(self) -> Callable[..., Any]:
        """Return the function that writes it."""
        module, _, name = self.function.partition(":")
        return getattr(import_module(module), name)


def list_exporters(of: Exported) -> dict[str, Exporter]:
    """Return the exporters of runs or of environments that installed extensions register, by name.

    Raises:
        UsageError: an extension registers something else, or cannot be imported.
    """
    offered = load_registered(EXPORTERS_GROUP, tuple_of(Exporter), "a tuple of Exporter")
    return {each.name: each for some in offered for each in some if each.of == of}
