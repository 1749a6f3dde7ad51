"""Shells complete commands, options, names and paths."""

import os
import pty
import select
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gslcosim.base.bundled import bundled_agents, bundled_scenarios, bundled_suites, bundled_train_files
from gslcosim.cli.arguments import build_parser, command_parsers
from gslcosim.cli.commands.completion import SHELLS
from gslcosim.cli.commands.list_ import KINDS
from gslcosim.cli.completion_words import COMPLETIONS
from gslcosim.cli.main import list_groups, main

GROUPS = list_groups()

# Asks for the words of each line as bash does at the Tab key, and prints them in a line.
ASK = """
eval "$(gslcosim completion bash)"
while IFS= read -r COMP_LINE; do
    COMP_POINT=${#COMP_LINE} COMPREPLY=()
    _python_argcomplete gslcosim
    echo "${COMPREPLY[*]}"
done
"""
PARSER = build_parser(GROUPS, version="")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a scenario and two runs, with gslcosim on the path."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    for name in ("runs/hall-1", "runs/hall-2", "others/room-1", ".hidden"):
        Path(name).mkdir(parents=True)
    Path("mine.yaml").touch()
    Path("mine.txt").touch()
    return tmp_path


def needs(shell):
    return pytest.mark.skipif(shutil.which(shell) is None, reason=f"needs {shell}: apt-get install {shell}")


def words_of(*lines):
    call = ["bash", "--norc", "-c", ASK]
    told = subprocess.run(
        call, input="".join(f"{line}\n" for line in lines), capture_output=True, text=True, check=True
    )
    return [line.split() for line in told.stdout.splitlines()]


def commands(*path):
    parser = PARSER
    for word in path:
        parser = command_parsers(parser)[word]
    return set(command_parsers(parser))


def options(*path):
    parser = PARSER
    for word in path:
        parser = command_parsers(parser)[word]
    return {option for action in parser._actions for option in action.option_strings if option.startswith("--")}


@pytest.mark.slow
def test_bash_completes_commands_options_names_and_paths(folder):
    wanted = {
        "gslcosim ": commands(),
        "gslcosim bench ": commands("bench"),
        "gslcosim bench ru": {"run"},
        "gslcosim up --": options("up"),
        "gslcosim runs --": options("runs", "list"),
        "gslcosim up --processes ": {"separate", "grouped", "one"},
        "gslcosim list ": set(KINDS),
        "gslcosim up ": {*bundled_scenarios(), "mine.yaml", "runs/", "others/"},
        "gslcosim up --quiet mine": {"mine.yaml"},
        "gslcosim bench plan ": {*bundled_suites(), "mine.yaml", "runs/", "others/"},
        "gslcosim bench tune tiny_room --entry sur": {name for name in bundled_agents() if name.startswith("sur")},
        "gslcosim train open_halls": {name for name in bundled_train_files() if name.startswith("open_halls")},
        "gslcosim view ha": {"hall-1", "hall-2"},
        "gslcosim view runs/": {"runs/hall-1/", "runs/hall-2/"},
        "gslcosim compare hall-1 ha": {"hall-1", "hall-2"},
        "gslcosim replay --runs-dir others ": {"room-1", "runs/", "others/"},
        "gslcosim plot hall-1 --figure gas,tr": {"gas,track", "gas,track_3d"},
        "gslcosim environment export .h": {".hidden/"},
        "gslcosim agent new ": {"python", "c", "cpp", "go", "java", "octave", "rust", "shell", "typescript"},
        "gslcosim up --seed ": set(),
    }  # fmt: skip
    assert {line: set(words) for line, words in zip(wanted, words_of(*wanted), strict=True)} == wanted


def press_tab(call, *, script, line, until):
    """Type a line and a Tab into a shell on a terminal; return what it shows up to `until`, or all within a minute."""
    terminal, inner = pty.openpty()
    process = subprocess.Popen(call, stdin=inner, stdout=inner, stderr=inner, start_new_session=True)
    os.close(inner)
    shown = ""
    try:
        # Not as typed, so that the echo of it is no sign.
        os.write(terminal, f'{script}; echo REA""DY\n'.encode())
        for sign, typed in (("READY", f"{line}\t"), (until, "")):
            shown = ""
            while sign not in shown and select.select([terminal], [], [], 60)[0]:
                shown += os.read(terminal, 4096).decode(errors="replace")
            os.write(terminal, typed.encode())
    finally:
        process.kill()
        process.wait()
        os.close(terminal)
    return shown


SWITCH_ON = {
    "bash": (["bash", "--norc", "-i"], 'eval "$(gslcosim completion bash)"'),
    "zsh": (["zsh", "-f", "-i"], 'autoload -Uz compinit; compinit -u -D; eval "$(gslcosim completion zsh)"'),
}


@pytest.mark.slow
@pytest.mark.parametrize("shell", [pytest.param(name, marks=needs(name)) for name in SWITCH_ON])
def test_a_press_of_tab_completes_the_word(folder, shell):
    call, script = SWITCH_ON[shell]
    assert "warehouse_empty" in press_tab(call, script=script, line="gslcosim up warehouse_e", until="mpty")


@pytest.mark.slow
@needs("fish")
def test_fish_completes_with_what_a_command_does(folder):
    script = "gslcosim completion fish | source; complete -C 'gslcosim bench ru'; complete -C 'gslcosim up warehouse_e'"
    told = subprocess.run(["fish", "--no-config", "-c", script], capture_output=True, text=True, check=True).stdout
    assert told.splitlines() == ["run\trun a suite; repeat the command to resume", "warehouse_empty"]


def parsers_below(parser):
    yield parser
    for below in command_parsers(parser).values():
        yield from parsers_below(below)


def keys_of(parser):
    return {key for action in parser._actions for key in (*action.option_strings, action.metavar)}


def test_every_completion_is_of_an_argument_that_there_is():
    every = [*parsers_below(PARSER)]
    assert sorted(set(COMPLETIONS).difference(*map(keys_of, every))) == []
    assert {parser.prog: wrong for parser in every if (wrong := {*parser.completes} - keys_of(parser))} == {}


def test_a_shell_that_there_is_not_is_refused_with_those_that_there_are(capsys):
    assert main(["completion", "csh"]) == 2
    told = capsys.readouterr().err
    assert all(shell in told for shell in SHELLS)
