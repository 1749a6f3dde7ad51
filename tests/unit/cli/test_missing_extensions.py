"""A word of an extension that is not installed is answered by the extension and how it is installed."""

import pytest

from gslcosim.base import extensions
from gslcosim.cli.main import main


@pytest.fixture
def without(monkeypatch):
    """Return a function that hides installed extensions."""

    def hide(*names):
        hidden = {f"gslcosim-{name}" for name in names}
        kept = tuple(point for point in extensions.list_registrations() if point.distribution not in hidden)
        monkeypatch.setattr(extensions, "_read_entry_points", lambda folders: kept)

    return hide


@pytest.mark.parametrize(
    ("hidden", "words", "asked"),
    [
        ("archive", ["bench", "sign", "x"], "gslcosim bench sign: expected a command"),
        ("archive", ["bench", "run", "smoke", "--sealed", "x"], "gslcosim bench run --sealed: expected an option"),
        ("conformance", ["agent", "check"], "gslcosim agent check: expected a command"),
        ("data", ["extract", "--to", "csv"], "gslcosim extract: expected a command"),
        ("data", ["runs", "import", "x.csv"], "gslcosim runs import: expected a command"),
        ("ros", ["up", "tiny_room", "--ros2"], "gslcosim up --ros2: expected an option"),
        ("ros", ["extract", "--to", "mcap"], "gslcosim extract: argument --to: expected a format"),
        ("training", ["train", "x"], "gslcosim train: expected a command"),
        ("validation", ["bench", "run", "measured"], "measured: expected a suite"),
    ],
)
def test_words_of_an_extension_that_is_not_installed_name_it(without, capsys, hidden, words, asked):
    without(hidden)
    assert main(words) == 2
    told = capsys.readouterr().err
    assert told.startswith(asked)
    assert f"It is in the extension {hidden}, which is not installed: pip install gslcosim-{hidden}" in told


def test_a_family_names_the_extension_that_describes_it(without, capsys):
    without("archive", "bench")
    assert main(["bench", "run", "smoke"]) == 2
    assert "pip install gslcosim-bench" in capsys.readouterr().err
    assert main(["bench", "--help"]) == 2
    assert "pip install gslcosim-bench" in capsys.readouterr().err


def test_the_core_alone_has_its_commands(without, capsys):
    without("archive", "bench", "conformance", "data", "fmi", "ros", "search", "training", "validation")
    with pytest.raises(SystemExit):
        main(["--help"])
    told = capsys.readouterr().out
    assert "    runs " in told
    assert "    bench " not in told
    assert "compare methods:" not in told
