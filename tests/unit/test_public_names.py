"""`dir(gslcosim)` lists what a person calls, and each of it is there."""

import subprocess
import sys

import pytest

import gslcosim


def test_the_package_lists_what_a_person_calls():
    names = {name for name in dir(gslcosim) if not name.startswith("_")}
    assert names == {"Simulation", "agent_kit"}


@pytest.mark.parametrize("name", [name for name in dir(gslcosim) if not name.startswith("_")])
def test_each_listed_name_is_there_without_another_import(name):
    program = f"import gslcosim; print(gslcosim.{name}.__name__)"
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert said.strip().split(".")[-1] == name


def test_a_name_that_is_not_there_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = gslcosim.nonsense
