"""Old import names: modules and names of 0.1.0 work under them for one release, with a DeprecationWarning.

Two tables say what each is called now: `moved_modules.json` of modules that lie elsewhere, and `renamed_in_place.json`
of modules and packages that are there under that name, while names in them have changed. The first, which is large, is
read when an old module is imported.
"""

import importlib
import importlib.abc
import importlib.machinery
import json
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

_FOLDER = Path(__file__).parent
_UNTIL = "The old name works for one release"


def support_old_names() -> None:
    """Let old modules and names of gslcosim be imported, each with a DeprecationWarning."""
    if not any(isinstance(finder, _MovedModules) for finder in sys.meta_path):
        sys.meta_path.insert(0, _RenamedInPlace())
        sys.meta_path.append(_MovedModules())


@cache
def load_table(name: str) -> Mapping[str, Mapping[str, Any]]:
    """Return a table: for each module its `module` of now, and `names` of now by old ones."""
    return json.loads((_FOLDER / f"{name}.json").read_text(encoding="utf-8"))


class _MovedModules(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    # Stands last, so that it is asked only for what nothing else finds.

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if not fullname.startswith("gslcosim.") or fullname not in load_table("moved_modules"):
            return None
        # A package, since modules may lie below it under their old names too.
        return importlib.machinery.ModuleSpec(fullname, self, is_package=True)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType | None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        old = module.__name__
        entry = load_table("moved_modules")[old]
        importlib.import_module(entry["module"])
        _warn(f"{old} is called {entry['module']} now.")
        module.__dict__["__getattr__"] = _build_getattr(old, entry)


class _RenamedInPlace(importlib.abc.MetaPathFinder):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if not fullname.startswith("gslcosim.") or fullname not in load_table("renamed_in_place"):
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path)
        if spec is not None and spec.loader is not None:
            spec.loader = _LoaderWithOldNames(spec.loader)
        return spec


class _LoaderWithOldNames(importlib.abc.Loader):
    def __init__(self, loader: importlib.abc.Loader) -> None:
        self._loader = loader

    # What asks for a module's source, such as runpy and inspect, asks the loader itself.
    def __getattr__(self, name: str) -> Any:
        return getattr(self._loader, name)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        self._loader.exec_module(module)
        if "__getattr__" not in module.__dict__:
            entry = load_table("renamed_in_place")[module.__name__]
            module.__dict__["__getattr__"] = _build_getattr(module.__name__, entry)


def _build_getattr(old: str, entry: Mapping[str, Any]) -> Callable[[str], Any]:
    renamed: Mapping[str, str] = entry.get("names", {})
    place: str = entry["module"]

    def find(name: str) -> Any:
        now = renamed.get(name)
        if now is None and (place == old or name.startswith("__")):
            raise AttributeError(f"module {old!r} has no attribute {name!r}")
        if now is not None:
            _warn(f"{name} of {old} is called {now} in {place} now.")
        return getattr(importlib.import_module(place), now or name)

    return find


def _warn(text: str) -> None:
    # The frames of importlib do not count.
    warnings.warn(f"{text} {_UNTIL}.", DeprecationWarning, stacklevel=3)
