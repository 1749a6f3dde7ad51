"""Preload of the recorder's process: imports rerun and pyarrow before it is known what to record."""

import importlib
import sys


def preload_modules() -> None:
    """Import all that recording needs, in a process that does nothing else.

    It may start threads.
    """
    for module in ("blueprint", "rows.wind", "recording_file", "run_recording", "summary"):
        importlib.import_module(f"gslcosim_services.recorder.{module}")
    _block_pandas()


# pyarrow imports pandas, where that is installed, as soon as it converts a list: 0.2 s and 50 MB for nothing.
# What it has found then it keeps, so that this is not for a process in which somebody's own code runs.
def _block_pandas() -> None:
    import pyarrow

    sys.meta_path.insert(0, _PandasBlocker)
    try:
        pyarrow.array([True])
    finally:
        sys.meta_path.remove(_PandasBlocker)


class _PandasBlocker:
    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        del path, target
        if name == "pandas":
            raise ModuleNotFoundError(name=name)
