"""`gslcosim list`"""

import json

import pytest

from gslcosim.cli.commands.list_ import KINDS
from gslcosim.cli.main import main


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("scenarios", "warehouse_empty"), ("sensors", "anemometer"), ("vehicles", "iris"),
        ("gas_models", "farrell"), ("wind_solvers", "uniform"),
        ("gases", "ethanol"), ("agents", "infotaxis"),
    ],
)  # fmt: skip
def test_each_kind_is_listed_with_what_describes_it(capsys, kind, name):
    assert main(["list", kind]) == 0
    listed, *settings = capsys.readouterr().out.split("\n\n")
    headings, *rows = listed.splitlines()
    assert headings.startswith("name ")
    assert name in [row.split()[0] for row in rows]
    assert len(settings) == (len(rows) if kind in ("sensors", "gas_models", "wind_solvers") else 0)
    assert all(len(row.split()) > 1 for row in rows), "each has a description"


def test_without_a_kind_all_are_listed(capsys):
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.lower() for line in lines if line.isupper()] == list(KINDS)


def test_json_has_one_list_for_each_kind(capsys):
    assert main(["list", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert list(listed) == list(KINDS)
    assert {"name", "density_relative_to_air"} == set(listed["gases"][0])
    assert listed["scenarios"][0]["file"].endswith(".yaml")
