"""Old import names work for one release and say what to write instead."""

import importlib
import subprocess
import sys
import warnings

import pytest

from gslcosim.base.old_names import load_table

TABLES = ("moved_modules", "renamed_in_place")


@pytest.mark.parametrize("table", TABLES)
def test_each_old_name_is_that_of_now(table):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        missing = []
        for old, entry in load_table(table).items():
            module, new = importlib.import_module(old), importlib.import_module(entry["module"])
            for name, now in entry.get("names", {}).items():
                missing += [] if getattr(module, name) is getattr(new, now) else [f"{old}.{name}"]
    assert missing == []


def test_an_old_module_and_an_old_name_are_reported_at_the_line_that_has_them():
    program = "import gslcosim.safe_files\nfrom gslcosim.search.senses.instruments import noses_of\n"
    command = [sys.executable, "-W", "always::DeprecationWarning", "-c", program]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    assert "gslcosim.safe_files is called gslcosim.base.files now." in said
    assert "noses_of of gslcosim.search.senses.instruments is called find_noses" in said


def test_a_name_that_never_was_is_missing_as_before():
    with pytest.raises(ImportError, match="cannot import name"):
        from gslcosim.search.senses.instruments import never_was  # noqa: F401
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("gslcosim.never_was")
