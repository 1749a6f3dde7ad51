"""Agents' programs are looked for before anything starts."""

import shutil
import sys

import pytest

from gslcosim.base.bundled import bundled_agents, bundled_scenarios, find_bundled_agent
from gslcosim.base.errors import ScenarioError
from gslcosim.scenario.checks import program_checks
from gslcosim.scenario.loader import load_scenario

PYTHON = "{python: dung_beetle}"
PLACE = "hall.yaml:10: agents[0].start"


@pytest.fixture
def agent_files(tmp_path):
    """A Python agent, a program, and a file that may not be executed, beside the scenario."""
    for name in ("mine.py", "prog", "plain"):
        (tmp_path / name).write_text("#!/bin/sh\n")
    (tmp_path / "prog").chmod(0o755)
    (tmp_path / "plain").chmod(0o644)


@pytest.mark.parametrize(
    "start",
    [
        "{python: dung_beetle}", "{python: mine.py}", "{python: ./mine.py}", "{command: [./prog, --fast]}",
        "{command: [sh, -c, '" + "x" * 6000 + "']}",
        "{command: [sh]}", "{command: [sh, ./mine.py]}", "{command: [sh, -c, 'exit']}", "{attach: true}",
    ],
)  # fmt: skip
def test_programs_that_are_there_are_accepted(agent_files, scenario_file, start):
    assert load_scenario(scenario_file((PYTHON, start))).scenario.agents[0].start


@pytest.mark.parametrize(
    ("start", "told_line"),
    [
        (r'{python: "a\0b"}',
         f"{PLACE}.python: expected a path that a file can have, was one with the character U+0000."),
        ("{python: ~no_such_user/x.py}", f"{PLACE}.python: expected a path that a file can have, was "
         "'~no_such_user/x.py', the home of a user that there is not."),
        (r'{command: [sh, -c, "\0"]}', f"{PLACE}.command[2]: expected a path that a file can have, was one with the "
         "character U+0000."),
        ("{python: dung_beatle}", f"{PLACE}.python: expected a bundled agent (`gslcosim list` names them) or a file "
         "like ./my_agent.py, was 'dung_beatle'. Did you mean dung_beetle?"),
        ("{python: mine}", f"{PLACE}.python: expected a bundled agent (`gslcosim list` names them) or a file "
         "like ./my_agent.py, was 'mine'. Did you mean ./mine.py?"),
        ("{python: ./yours.py}", f"{PLACE}.python: expected a Python file, was './yours.py'. There is no yours.py."),
        ("{command: [./none]}", f"{PLACE}.command[0]: expected a program, was './none'. There is no none."),
        ("{command: [./plain]}", f"{PLACE}.command[0]: expected a program that may be executed, was './plain'. "
         "Run: chmod +x plain"),
        ("{command: [prog]}", f"{PLACE}.command[0]: expected a program on the PATH, or a path like ./my_agent, was "
         "'prog'. Did you mean ./prog?"),
        ("{command: [no-such-program-here]}", f"{PLACE}.command[0]: expected a program on the PATH, or a path like "
         "./my_agent, was 'no-such-program-here'. Is it installed?"),
        ("{command: [sh, other.sh]}", f"{PLACE}.command[1]: expected a file, was 'other.sh'. There is no other.sh."),
        ("{command: []}", f"{PLACE}.command: expected a list of at least one text, was []."),
    ],
)  # fmt: skip
def test_a_missing_program_is_one_problem_with_a_remedy(agent_files, problem_lines, start, told_line):
    assert problem_lines((PYTHON, start)) == [told_line]


@pytest.mark.parametrize(
    ("first_line", "end"),
    [
        ("#!/opt/none/python3\n", "'./prog' with #!/opt/none/python3. Install it, or correct the first line of prog."),
        ("#!/usr/bin/env no-such-interpreter\n",
         "'./prog' with #!/usr/bin/env no-such-interpreter. Install it, or correct the first line of prog."),
        ("#!/usr/bin/env -S no-such-interpreter -u\n",
         "'./prog' with #!/usr/bin/env -S no-such-interpreter -u. Install it, or correct the first line of prog."),
        ("#!/bin/sh\r\n", "'./prog' with #!/bin/sh. The lines of prog end as on Windows; run: sed -i 's/\\r$//' prog"),
        ("#!\n", "'./prog' with #!. Name one in the first line of prog, for example #!/bin/sh."),
    ],
)  # fmt: skip
def test_a_script_without_its_interpreter_is_a_problem(agent_files, tmp_path, problem_lines, first_line, end):
    (tmp_path / "prog").write_bytes(first_line.encode())
    (line,) = problem_lines((PYTHON, "{command: [./prog]}"))
    assert line == f"{PLACE}.command[0]: expected a script whose interpreter is there, was {end}"


@pytest.mark.parametrize(
    "first_line", ["#!/usr/bin/env sh", "#!/usr/bin/env -S A=1 sh -e", "#! /bin/sh -e", "#!./prog2"]
)
def test_a_script_with_its_interpreter_is_accepted(agent_files, tmp_path, scenario_file, first_line):
    (tmp_path / "prog").write_text(f"{first_line}\n")
    (tmp_path / "prog2").write_text("#!/bin/sh\n")
    (tmp_path / "prog2").chmod(0o755)
    assert load_scenario(scenario_file((PYTHON, "{command: [./prog]}"))).scenario.agents[0].start


def test_bundled_scenarios_and_agents_are_found_by_name():
    assert {"warehouse_empty", "tiny_room"} <= set(bundled_scenarios())
    assert bundled_agents()["dung_beetle"].name == "agent.py"
    assert bundled_agents()["infotaxis"].name == "method.yaml"
    assert {name: find_bundled_agent(name) for name in bundled_agents()} == bundled_agents()


@pytest.mark.parametrize("name", ["", ".", "..", "no_such_agent", "dung_beetle/", "./dung_beetle", "contract", "a\0b"])
def test_what_names_no_bundled_agent_finds_none(name):
    assert find_bundled_agent(name) is None


@pytest.mark.parametrize("name", sorted(bundled_scenarios()))
def test_every_bundled_scenario_is_valid_and_named_like_its_file(name):
    assert load_scenario(name).name == name


@pytest.mark.skipif(sys.platform != "linux", reason="what Linux can execute")
@pytest.mark.parametrize(
    ("content", "expected", "remedy"),
    [
        (b"echo no interpreter\n", "a program, or a script that names its interpreter", "Name that in the first line"),
        (b"", "a program, or a script that names its interpreter", "Name that in the first line"),
        (b"\x7fELF\x02\x01\x01" + bytes(11) + b"\xf3\x00", "a program for this machine's processor", "build it here"),
    ],
    ids=["text", "empty", "another processor's"],
)
def test_what_the_system_cannot_execute_is_a_problem(tmp_path, scenario_file, monkeypatch, content, expected, remedy):
    """Unless somebody has registered an interpreter for other kinds of files."""
    monkeypatch.setattr(program_checks, "_TAKEN_ON", tmp_path / "nothing registered")
    (tmp_path / "prog").write_bytes(content)
    (tmp_path / "prog").chmod(0o755)
    path = scenario_file((PYTHON, "{command: [./prog]}"))
    with pytest.raises(ScenarioError) as raised:
        load_scenario(path)
    assert f"agents[0].start.command[0]: expected {expected}" in str(raised.value)
    assert remedy in str(raised.value)
    (tmp_path / "registered").mkdir()
    (tmp_path / "registered" / "qemu-riscv64").touch()
    monkeypatch.setattr(program_checks, "_TAKEN_ON", tmp_path / "registered")
    assert load_scenario(path)


@pytest.mark.skipif(sys.platform != "linux", reason="what Linux can execute")
def test_a_program_of_this_machine_is_accepted(tmp_path, scenario_file):
    shutil.copy(shutil.which("true"), tmp_path / "prog")
    assert load_scenario(scenario_file((PYTHON, "{command: [./prog]}")))


@pytest.mark.parametrize(
    ("content", "remedy"),
    [
        (b"x = 1\ndef step(:\n", ":2: invalid syntax."),
        (b"x = '\xff'\n", "(unicode error) 'utf-8' codec can't decode byte 0xff"),
        (b"x = 1\0\n", "null bytes"),
        (b"(" * 500, ":1: too many nested parentheses."),
    ],
)
@pytest.mark.parametrize("start", ["python: agent.py", "command: [PYTHON, agent.py]"])
def test_a_python_program_that_cannot_be_parsed_is_a_problem_of_the_scenario(tmp_path, start, content, remedy):
    (tmp_path / "agent.py").write_bytes(content)
    file = tmp_path / "hall.yaml"
    text = load_scenario("tiny_room").text
    assert PYTHON in text
    file.write_text(text.replace(PYTHON, f"{{{start.replace('PYTHON', sys.executable)}}}"))
    with pytest.raises(ScenarioError, match=r"a Python file that can be parsed, was 'agent\.py'") as raised:
        load_scenario(file)
    assert remedy in str(raised.value)


def test_a_program_for_another_python_is_not_parsed(tmp_path):
    (tmp_path / "agent.py").write_text("print 'of Python 2'\n")
    (tmp_path / "python2").write_text("#!/bin/sh\n")
    (tmp_path / "python2").chmod(0o755)
    file = tmp_path / "hall.yaml"
    file.write_text(load_scenario("tiny_room").text.replace(PYTHON, "{command: [./python2, agent.py]}"))
    load_scenario(file)
