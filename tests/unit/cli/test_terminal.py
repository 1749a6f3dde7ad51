"""What commands print passes one place, which shows control characters in place of obeying them."""

import ast
import contextlib
import errno
import io
import json
import os
import pty
import re
import socket
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest
from rich.console import Console

import gslcosim
from gslcosim.base.errors import MachineError
from gslcosim.cli.main import main
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.run_output import format_agents_table, format_summary
from gslcosim.cli.terminal import drawn_table, open_console, table, write, write_json, write_note, write_prompt
from gslcosim.recordings import viewer
from gslcosim.runtime.status import RunResult, get_status_folder
from gslcosim_conformance.teleop import Terminal

PACKAGE = Path(gslcosim.__file__).parent
TITLE = "\x1b]0;owned\x07"
CLEAR = "\x1b[2J"
EVIL = f"{TITLE}{CLEAR}[red]evil[/red]\u202e"
SHOWN = r"\x1b]0;owned\x07\x1b[2J[red]evil[/red]\u202e"
# What writes elsewhere than `gslcosim.cli.terminal`, and only what is ours.
WRITERS = {
    "__main__.py",  # that a signal has ended it
    "cli/terminal.py",
    "cli/rendering_probe.py",  # JSON for the process that has started it
    "teleop.py",  # escapes each line itself
    "runtime/external/fmi/host.py",  # what a unit logs, into the log of its process
    "runtime/distributed/service_main.py",  # usage of a service's process, into its log
}


def obeyed(text):
    """Return the control characters that reach a terminal."""
    return set(re.findall("[^\\n\\t -~\xa0-\u200d\u2010-\u2027\u202f-\u2065\u206a-\U0010ffff]", text))


def test_each_writer_shows_what_is_foreign(capsys):
    write(EVIL)
    write_note(EVIL)
    output = capsys.readouterr()
    assert output.out == output.err == f"{SHOWN}\n"
    write_prompt(EVIL)
    assert capsys.readouterr().err == SHOWN
    write_json({EVIL: "\x9b"})
    text = capsys.readouterr().out
    assert not obeyed(text)
    assert json.loads(text) == {EVIL: "\x9b"}


def test_a_cell_can_neither_break_its_row_nor_its_column():
    lines = table(("name", "n"), [(f"{TITLE}\nforged   9", "1"), ("b", "2")]).splitlines()
    assert lines == [f"{'name':<30} n", r"\x1b]0;owned\x07\nforged   9   1"[:30] + " 1", f"{'b':<30} 2"]


def test_the_live_line_takes_neither_markup_nor_escape_sequences():
    with ProgressLine(EVIL, is_quiet=False) as line:
        line._drawn = (EVIL, f"{EVIL}\n2", 0.5)
    console = Console(file=io.StringIO(), width=240, force_terminal=True, color_system=None)
    console.print(line.render())
    drawn = console.file.getvalue()
    assert drawn.count(SHOWN) == 2
    assert not obeyed(drawn)


def test_a_drawn_table_takes_neither_markup_nor_escape_sequences():
    console = Console(file=io.StringIO(), width=240, force_terminal=True, color_system=None)
    console.print(drawn_table(("name", "n"), [(EVIL, "1"), (f"{EVIL}\n2", "-")]))
    drawn = console.file.getvalue()
    assert drawn.count(SHOWN) == 2
    assert not obeyed(drawn)


class Refusing(io.StringIO):
    """A terminal that takes nothing."""

    def isatty(self):
        return True

    def write(self, text):
        raise OSError(errno.EIO, "Input/output error")

    def fileno(self):
        raise ValueError("no file")


def test_a_terminal_that_is_gone_ends_no_work_and_is_told_of_results(monkeypatch):
    """As where a person has closed it while a suite goes on under nohup."""
    monkeypatch.setattr(sys, "stderr", Refusing())
    with ProgressLine("suite", is_quiet=False) as line:
        line.count(1, 2)
    monkeypatch.setattr(sys, "stdout", Refusing())
    with pytest.raises(MachineError, match="standard output"):
        open_console(sys.stdout).print("page")


def test_the_cockpit_shows_what_agents_say(monkeypatch):
    master, terminal = pty.openpty()
    with os.fdopen(terminal, "r+b", buffering=0) as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        monkeypatch.setattr(sys, "stdout", stream)
        with Terminal() as keyboard:
            keyboard.show([f"radio  {EVIL}"])
            drawn = ""
            while not drawn.endswith("\x1b[J"):
                drawn += os.read(master, 4096).decode()
    os.close(master)
    assert f"radio  {SHOWN}" in drawn
    assert TITLE not in drawn


AGENT = {
    "name": EVIL,
    "method": EVIL,
    "outcome": EVIL,
    "time_to_source_s": None,
    "steps": 1,
    "path_length_m": 1.0,
    "movement_overhead": None,
    "final_distance_m": 1.0,
}


def test_a_summary_shows_errors_of_agents(tmp_path, capsys):
    result = {
        "end_reason": EVIL,
        "valid": True,
        "agents": [AGENT],
        "sandboxes": {EVIL: EVIL},
        "faults": [{"participant": EVIL, "tick": 1, "text": EVIL}],
    }
    write(format_summary(RunResult(exit_code=1, run_dir=tmp_path / EVIL, result=result)))
    text = capsys.readouterr().out
    assert not obeyed(text)
    assert text.count(SHOWN) >= 7
    assert not obeyed(format_agents_table([AGENT], {}))


def make_run(folder, **result):
    (folder / "logs").mkdir(parents=True)
    content = {"schema": "gslcosim/result/1", "end_reason": "success", "agents": [], "faults": [], **result}
    (folder / "result.json").write_text(json.dumps(content))


def test_runs_of_strangers_are_listed(tmp_path, capsys):
    make_run(tmp_path / EVIL.replace("/", "_"), scenario=EVIL, end_reason=f"{EVIL}\n")
    (tmp_path / os.fsdecode(b"no utf-8 \xff")).mkdir()
    for words in ((), ("--json",)):
        assert main(["runs", str(tmp_path), *words]) == 0
        text = capsys.readouterr().out
        assert not obeyed(text)
        assert "owned" in text


def test_names_of_files_and_words_of_a_call_are_shown(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path(f"{TITLE}.yaml").write_text('name: "\\e]0;owned\\a"\n"\\e[2J": 1\n')
    for words in (["validate", f"{TITLE}.yaml"], ["validate", EVIL], ["list", EVIL], ["compare", EVIL, EVIL], [EVIL]):
        assert main(words) == 2
        output = capsys.readouterr()
        assert not obeyed(output.out + output.err)
        assert r"\x1b" in output.out + output.err


@pytest.fixture
def short_folder():
    """The path of a socket has at most 107 bytes, which folders of tests may have by themselves."""
    with tempfile.TemporaryDirectory() as folder:
        yield folder


def test_runs_of_others_are_listed(monkeypatch, short_folder, capsys):
    """Whoever of the user listens in that folder is asked how its run goes."""
    monkeypatch.setattr("tempfile.tempdir", short_folder)
    folder = get_status_folder()
    folder.mkdir()
    texts = dict.fromkeys(("run_id", "run_dir", "processes", "began_at", "state", "text"), EVIL)
    numbers = dict.fromkeys(("wall_s", "sim_time_s", "time_limit_s", "real_time_factor"), 1.0)
    participant = dict.fromkeys(("name", "state"), EVIL) | {"waits_for": [EVIL], "cpu_s": None, "memory_bytes": None}
    participant |= {"pid": None, "tick": 1, "queued_ticks": 0, "n_resends": 0}
    facts = json.dumps({**texts, **numbers, "participants": [participant]}).encode()

    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(folder / f"{os.getpid()}-a.flight"))
        listener.listen()

        def answer():
            with contextlib.suppress(OSError):
                while True:
                    connection = listener.accept()[0]
                    connection.sendall(facts)
                    connection.close()

        threading.Thread(target=answer, daemon=True).start()
        for words in (
            ["runs", "active"],
            ["runs", "active", "--json"],
            ["runs", "top", "--once", "--every", "0.1"],
        ):
            assert main(words) == 0
            text = capsys.readouterr().out
            assert "owned" in text
            assert not obeyed(text)
        listener.shutdown(socket.SHUT_RDWR)


def test_messages_of_libraries_are_shown(tmp_path):
    """They quote names in the files that they read; asked in a process of its own, as the command line is one."""
    program = (
        "import sys, warnings, logging\n"
        "from gslcosim.cli import main as cli\n"
        "def call(words):\n"
        f"    warnings.warn({EVIL!r}); logging.getLogger('x').warning('%s', {EVIL!r}); return 0\n"
        "cli.run_command = call\n"
        "cli.main()\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stderr.count(SHOWN) == 2
    assert not obeyed(ended.stderr)


def test_what_the_viewer_logs_stays_away(monkeypatch, tmp_path, capfd):
    program = tmp_path / "rerun"
    program.write_text("#!/bin/sh\nprintf 'first\\n\\033]0;owned\\007last\\n'\nexit 4\n")
    program.chmod(0o755)
    recording = tmp_path / "a.rrd"
    recording.write_bytes(b"RRF2")
    monkeypatch.setenv("DISPLAY", ":9")
    monkeypatch.setattr(viewer, "rerun_program", lambda: program)
    with pytest.raises(viewer.RecordingError, match=r"was 4: .*owned.*last"):
        viewer.open_viewer(recording)
    assert capfd.readouterr() == ("", "")


def is_writing(node):
    """Return whether a node of a module's syntax writes to a standard stream or makes a console that does."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return node.func.id == "print"
    return isinstance(node, ast.Attribute) and node.attr == "write" and ast.unparse(node.value) in (
        "sys.stdout", "sys.stderr", "sys.__stdout__", "sys.__stderr__",
    )  # fmt: skip


@pytest.mark.slow
def test_nothing_else_writes_to_a_standard_stream():
    found = set()
    for path in PACKAGE.rglob("*.py"):
        name = path.relative_to(PACKAGE).as_posix()
        if "templates/" not in name and any(map(is_writing, ast.walk(ast.parse(path.read_text(encoding="utf-8"))))):
            found.add(name)
    assert found <= WRITERS
    assert "cli/terminal.py" in found


def test_rich_gets_no_foreign_text_as_markup():
    """Whoever makes a console or a bar of Rich is in the list, and is tested above."""
    users = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if re.search(r"^\s*(from|import) rich\b", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert users == {"cli/terminal.py", "cli/progress.py"}
