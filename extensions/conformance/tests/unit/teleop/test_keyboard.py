"""What a terminal sends for keys."""

import pytest

from gslcosim_conformance.teleop import parse_keys


@pytest.mark.parametrize(
    ("sent", "keys"),
    [
        ("aW[", ["a", "w", "["]),
        ("\x1b[A\x1bOB\x1b[5~", ["up", "down", "page_up"]),
        ("d\x1b[Dd", ["d", "left", "d"]),
        (" \r", ["space", "enter"]),
        ("\x1b[15~a", ["a"]),
        ("\x1b", []),
        ("\x00\x7f", []),
    ],
)
def test_keys_have_names(sent, keys):
    assert parse_keys(sent) == keys
