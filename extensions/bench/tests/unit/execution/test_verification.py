"""Rows that this software cannot repeat are reported with what made them."""

import re

import pytest

import gslcosim
from gslcosim_bench.execution.verification import describe_other_software


@pytest.mark.parametrize(
    ("software", "version", "expected"),
    [
        ("here", gslcosim.__version__, "the programs of its agents have changed. Give it those programs"),
        ("other", gslcosim.__version__, "other code or packages of gslcosim .*. Install those"),
        ("other", "0.0.1", r"they were made by gslcosim 0\.0\.1\. Install that version"),
    ],
)
def test_the_cause_is_the_program_the_packages_or_the_version(software, version, expected):
    manifest = {"software_hash": software, "versions": {"gslcosim": version}}
    assert re.search(expected, describe_other_software(manifest, "here"))
