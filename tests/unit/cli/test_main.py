"""The entry point: commands, options, exit codes, and what is imported when."""

import argparse
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from gslcosim import __version__
from gslcosim.base import errors
from gslcosim.base.extensions import Registration
from gslcosim.cli.arguments import Command, CommandGroup, build_parser, command_parsers, iterate_commands, parse
from gslcosim.cli.main import list_groups, main

GROUPS = list_groups()

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "commands.md"
NAMES = [command.name for group in GROUPS for command in group.commands]
COMMANDS = dict(iterate_commands(GROUPS))
MOVED = {command.old_name: path for path, command in COMMANDS.items() if command.old_name}
ALL = ", ".join(NAMES)


def collect_actions(parser):
    """Return what a command takes, with what the actions below it take."""
    return [*parser._actions, *(each for below in command_parsers(parser).values() for each in collect_actions(below))]


def options_of(path):
    """Return the long options of a command with their help."""
    parser = build_parser(GROUPS, version="0")
    for word in path:
        parser = command_parsers(parser)[word]
    actions = collect_actions(parser)
    return {text: action.help for action in actions for text in action.option_strings if text.startswith("--")}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["upp"], f"gslcosim: expected one of the commands {ALL}, was 'upp'. "
         "Did you mean up?"),
        (["zzz"], f"gslcosim: expected one of the commands {ALL}, was 'zzz'."),
        (["bench", "run", "smoke", "--out", "x"],
         "gslcosim bench run: expected one of the options --agents, --build, --bundle, --data, --filter, --help, "
         "--jobs, --json, --no-report, --only, --ray, --results, --retry, --sealed, --seed, --shard, --yes, was "
         "'--out'. Did you mean --results?"),
        (["--foo"], "gslcosim: expected one of the options --help, --version, was '--foo'."),
        (["up", "x", "--sed", "3"], "gslcosim up: expected one of the options --elsewhere, --help, --in-process, "
         "--insecure, --join-dir, --json, --lease-s, --listen, --live, --no-services, --pace, --processes, --quiet, "
         "--ros-distro, --ros2, --ros2-truth, --runs-dir, --seed, --serve, --set, --tls-ca, --tls-certificate, "
         "--tls-client-ca, --tls-key, --window-ticks, was '--sed'. Did you mean --seed?"),
        (["up", "x", "y"], "gslcosim up: expected no further words, was 'y'. See gslcosim up --help."),
        (["up"], "gslcosim up: the following arguments are required: SCENARIO. See gslcosim up --help."),
        (["up", "x", "--seed", "-1"], "gslcosim up: argument --seed: expected a whole number of at least 0, was '-1'. "
         "See gslcosim up --help."),
        (["view", "--window-size", "big"], "gslcosim view: argument --window-size: expected width x height in pixels "
         "like 1600x1000, was 'big'. See gslcosim view --help."),
    ],
)  # fmt: skip
def test_a_wrong_call_returns_2_and_says_what_was_meant(capsys, words, expected):
    assert main(words) == 2
    output = capsys.readouterr()
    assert output.err == f"{expected}\n"
    assert output.out == ""


def test_without_words_the_help_is_shown(capsys):
    assert main([]) == 2
    assert "commands:" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [["--help"], *([name, "--help"] for name in NAMES), *([*path, "--help"] for path in COMMANDS)]
)
def test_help_has_examples(capsys, words):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert "examples:\n  gslcosim " in text


def test_the_help_lists_each_command_once_under_its_group_and_no_old_name(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    text = capsys.readouterr().out.partition("commands:")[2].partition("examples:")[0]
    assert re.findall(r"^    (\S+)", text, re.MULTILINE) == NAMES
    assert re.findall(r"^  (\S.*):$", text, re.MULTILINE) == [group.title for group in GROUPS]


@pytest.mark.parametrize("old", MOVED)
def test_an_old_name_is_understood_and_says_the_new_one(capsys, old):
    with pytest.raises(SystemExit) as ended:
        main([old, "--help"])
    assert ended.value.code == 0
    output = capsys.readouterr()
    new = " ".join(MOVED[old])
    assert output.err == f"gslcosim {old}: is gslcosim {new} now; the old name ends with the next release.\n"
    assert output.out.startswith(f"usage: gslcosim {old} ")


def test_runs_without_an_action_lists_runs(capsys, tmp_path):
    assert main(["runs", str(tmp_path)]) == main(["runs", "list", str(tmp_path)]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first == second
    assert main(["runs", "--foo"]) == 2
    assert capsys.readouterr().err.startswith("gslcosim runs: expected one of the options")


def test_an_old_name_that_is_misspelled_leads_to_the_new_one(capsys):
    assert main(["exprt"]) == 2
    assert capsys.readouterr().err.endswith("was 'exprt'. Did you mean environment export?\n")


def test_the_version_is_printed(capsys):
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == f"gslcosim {__version__}\n"


def section_of(path):
    """Return what the page says about a command, or about its family where it has no section of its own."""
    page = PAGE.read_text()
    own, family = (re.search(rf"^## gslcosim {name}\b", page, re.MULTILINE) for name in (" ".join(path), path[0]))
    found = own or family
    assert found, path
    return page[found.start() :].partition("\n## ")[0]


@pytest.mark.parametrize("path", COMMANDS)
def test_every_option_has_help_and_is_documented(path):
    section = section_of(path)
    for option, help_text in options_of(path).items():
        assert help_text, option
        if help_text == argparse.SUPPRESS:
            # For processes that gslcosim starts itself.
            continue
        assert option == "--help" or f"`{option}" in section, f"{option} of {path} is missing in {PAGE.name}"


def test_no_option_is_documented_that_there_is_not():
    sections = {}
    for path in COMMANDS:
        sections.setdefault(section_of(path), set()).update(options_of(path))
    for section, options in sections.items():
        assert set(re.findall(r"^\| `(--[a-z0-9-]+)", section, re.MULTILINE)) <= options


def example_lines():
    lines = [line for command in COMMANDS.values() for line in command.examples.splitlines()]
    lines += [line for line in PAGE.read_text().splitlines() if line.startswith("gslcosim ")]
    return [re.split(r" \||  +| > ", line.strip())[0] for line in lines]


@pytest.mark.parametrize("line", example_lines())
def test_every_example_is_a_call_that_can_be_parsed(line):
    program, *words = shlex.split(line)
    assert program == "gslcosim"
    assert parse(build_parser(GROUPS, version="0"), GROUPS, words).command in NAMES


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.ScenarioError, 2), (errors.UsageError, 2), (errors.EnvironmentDataError, 2), (errors.FlowError, 2),
        (errors.RecordingError, 2),
        (errors.MachineError, 3), (errors.RecordingWriteError, 3), (errors.RunFolderError, 3),
        (errors.SimulationFault, 3), (errors.ModelError, 3), (errors.GslCosimError, 3), (errors.RunTimeoutError, 4),
    ],
)  # fmt: skip
def test_an_error_has_the_exit_code_of_who_must_act(error, code):
    assert error("told").exit_code == code


def test_an_error_is_reported_without_a_traceback(capsys, tmp_path):
    assert main(["validate", str(tmp_path / "none.yaml")]) == 2
    assert capsys.readouterr().err == f"{tmp_path}/none.yaml: expected a scenario file, found none.\n"


@pytest.mark.parametrize(
    ("raised", "expected"),
    [
        (OSError(28, "No space left on device", "/x/y"), "the machine: expected it to do what was asked, was no space "
         "left on device. Free room there, or choose another disk.\nFile: /x/y\n"),
        (MemoryError(), "the machine: expected it to do what was asked, was out of memory. Close programs, or raise "
         "the limit on memory (ulimit -v).\n"),
    ],
)  # fmt: skip
def test_what_the_machine_refuses_returns_3_and_is_one_sentence(capsys, monkeypatch, raised, expected):
    def refuse(*_, **__):
        raise raised

    monkeypatch.setattr("gslcosim.scenario.load_scenario", refuse)
    assert main(["validate", "tiny_room"]) == 3
    assert capsys.readouterr().err == expected


def test_a_mistake_of_ours_returns_3_and_is_reported_as_such(capsys, monkeypatch):
    """1 would say that the agent has failed."""

    def err(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr("gslcosim.scenario.load_scenario", err)
    assert main(["validate", "tiny_room"]) == 3
    output = capsys.readouterr().err
    assert "Traceback" in output
    assert output.endswith(
        "gslcosim: internal error: ZeroDivisionError. This is a mistake in gslcosim: please report "
        "it with the lines above.\n"
    )


def called(words, shell_end):
    """Call the command through a shell that closes or fills a stream."""
    call = f"{shlex.join([sys.executable, '-m', 'gslcosim', *words])} {shell_end}"
    return subprocess.run(["sh", "-c", call], capture_output=True, text=True, check=False)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is always full")
@pytest.mark.parametrize("words", [["list", "gases"], ["list", "gases", "--json"], ["--version"]])
@pytest.mark.parametrize(
    ("end", "reason"), [("> /dev/full", "no space left on device"), (">&-", "bad file descriptor")]
)
def test_an_output_that_cannot_be_written_returns_3_and_is_one_sentence(words, end, reason):
    ended = called(words, end)
    text = f"standard output: expected to take the result, was {reason}. "
    remedy = "Send it to a file on a disk with room, or to a terminal.\n"
    assert (ended.returncode, ended.stderr) == (3, text + remedy)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is always full")
@pytest.mark.parametrize("end", ["2> /dev/full", "2>&-", "<&- 2>&-"])
def test_a_note_that_nobody_can_read_changes_nothing(end):
    assert called(["validate", "none.yaml"], end).returncode == 2
    assert called(["list", "gases"], end).stdout.startswith("name ")


def test_an_interruption_returns_130(capsys, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("gslcosim.scenario.load_scenario", interrupt)
    assert main(["validate", "tiny_room"]) == 130
    assert capsys.readouterr().err == "Interrupted.\n"


def test_a_reader_that_has_gone_is_no_error():
    code = "import sys; from gslcosim.cli.main import main; sys.exit(main(['list', 'gases']))"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == b""
        assert process.wait() == 0


def test_help_imports_nothing_heavy():
    heavy = {
        "numpy",
        "numba",
        "pydantic",
        "yaml",
        "rich",
        "zenoh",
        "mujoco",
        "rerun",
        "gslcosim.scenario",
        "gslcosim.runtime",
    }
    every = "import sys; from gslcosim.cli.main import list_groups; list_groups()"
    code = f"{every}; sys.exit(', '.join({heavy!r} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stderr.strip() == ""


def test_a_mistake_of_an_extension_names_it(capsys, monkeypatch):
    """Who meets it reports it to the right people."""

    def err(*_, **__):
        raise ZeroDivisionError

    point = Registration(group="gslcosim.commands", name="dose", value=f"{__name__}:GROUPS", distribution="dose")
    monkeypatch.setattr("gslcosim.cli.main.list_registrations", lambda: (point,))
    monkeypatch.setattr("gslcosim.scenario.load_scenario", err)
    assert main(["validate", "tiny_room"]) == 3
    assert capsys.readouterr().err.endswith("This is a mistake in the extension dose: correct it.\n")


def test_two_commands_of_one_name_are_refused(monkeypatch):
    mine = Command(name="up", summary="s", examples="", add_arguments=lambda _: None, run=lambda _: 0)
    groups = (CommandGroup(title="mine", commands=(mine,)),)
    monkeypatch.setattr("gslcosim.cli.main.load_registered", lambda *_: (groups,))
    with pytest.raises(
        errors.UsageError, match=f"expected one command 'up', was one of gslcosim.* and one of {__name__}"
    ):
        list_groups()
