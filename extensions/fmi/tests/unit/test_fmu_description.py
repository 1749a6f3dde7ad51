"""Descriptions of FMUs, as far as that needs no library."""

import sys

import pytest

from gslcosim.base.errors import UsageError
from gslcosim_fmi.description import FmuVariable, read_fmu


def variable(fmi_type, **more):
    return FmuVariable(name="x", reference=1, fmi_type=fmi_type, causality="input", variability="continuous", **more)


@pytest.mark.parametrize(
    ("fmi_type", "kind", "smallest", "largest"),
    [("Int8", int, -128, 127), ("UInt16", int, 0, 65_535), ("Integer", int, -(2**31), 2**31 - 1)],
)
def test_whole_numbers_are_taken_as_far_as_their_type_holds_them(fmi_type, kind, smallest, largest):
    whole = variable(fmi_type)
    assert whole.kind is kind
    assert [whole.holds(value) for value in (smallest - 1, smallest, largest, largest + 1)] == [
        False,
        True,
        True,
        False,
    ]


def test_variables_have_the_types_of_python_or_none():
    kinds = {
        name: variable(name).kind for name in ("Real", "Float32", "Boolean", "String", "UInt64", "Binary", "Clock")
    }
    assert kinds == {
        "Real": float, "Float32": float, "Boolean": bool, "String": str, "UInt64": int, "Binary": None, "Clock": None,
    }  # fmt: skip
    assert variable("Float64", is_scalar=False).kind is None
    assert variable("Float64").holds(1e300)


def test_a_missing_library_is_named_with_what_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(UsageError, match=r"expected the package fmpy, .* Install it: pip install gslcosim-fmi"):
        read_fmu(tmp_path / "fan.fmu")
