"""A run that compiles kernels at its start says so, whichever process compiles, and says it once in a log."""

import threading

from gslcosim.cli.run_output import PlainLines
from gslcosim.runtime.kernel_compilation import KernelFolder
from gslcosim.runtime.run import CompilationReporter
from gslcosim.runtime.status import RunStatus


def add_kernel(folder):
    folder.mkdir(parents=True)
    (folder / "step.py311.1.nbc").touch()


def test_a_folder_that_was_not_there_is_new(tmp_path):
    """As in the first run of a version."""
    folder = KernelFolder(tmp_path / "numba")
    assert not folder.has_new()
    add_kernel(tmp_path / "numba" / "physics")
    assert folder.has_new()
    assert 0 < folder.estimate_fraction() < 1


def test_the_status_says_so_although_nothing_else_is_reported(tmp_path):
    """A run in one process compiles on the thread that reports."""
    reports, is_told = [], threading.Event()

    def report(status):
        reports.append(status)
        if status.is_compiling:
            is_told.set()

    with CompilationReporter(report, KernelFolder(tmp_path)) as reporter:
        reporter(RunStatus(state="starting", run_dir=tmp_path))
        add_kernel(tmp_path / "physics")
        assert is_told.wait(60)
        reporter(RunStatus(state="starting", text="waiting for world"))
        reporter(RunStatus(state="flying", sim_time_s=1.0))
    assert reporter.has_compiled
    assert [(status.state, status.text, status.is_compiling) for status in reports] == [
        ("starting", "", False), ("starting", "compiling kernels", True),
        ("starting", "compiling kernels, waiting for world", True), ("flying", "", False),
    ]  # fmt: skip
    assert [status.run_dir for status in reports] == [tmp_path, None, None, None]


def test_a_run_that_compiles_nothing_says_nothing(tmp_path):
    reports = []
    with CompilationReporter(reports.append, KernelFolder(tmp_path)) as reporter:
        reporter(RunStatus(state="starting"))
    assert not reporter.has_compiled
    assert reports == [RunStatus(state="starting")]


def test_preparation_says_that_it_compiles_and_that_only_a_first_run_does(tmp_path):
    reports, is_told = [], threading.Event()

    def report(status):
        reports.append(status)
        if status.is_compiling:
            is_told.set()

    with CompilationReporter(report, KernelFolder(tmp_path)) as reporter:
        reporter(RunStatus(state="preparing", text="Building the room", fraction=0.0))
        add_kernel(tmp_path / "flow")
        assert is_told.wait(60)
    assert reports[0].text == "Building the room"
    assert reports[-1].text.startswith("Building the room, compiling kernels, about a minute")


def test_long_work_tells_a_pipe_how_long_it_still_takes(capsys):
    now_s = [0.0]
    lines = PlainLines("room", clock=lambda: now_s[0])
    for time_s, fraction in [(0, 0.0), (3, 0.01), (60, 0.2), (70, 0.25), (120, 0.4)]:
        now_s[0] = time_s
        lines(RunStatus(state="preparing", text="Solving the wind", fraction=fraction))
    assert capsys.readouterr().err.splitlines() == [
        "room: Solving the wind",
        "room: Solving the wind, 20 %, about 4 min left",
        "room: Solving the wind, 40 %, about 3 min left",
    ]


def test_a_log_has_it_once(capsys):
    lines = PlainLines("room")
    lines(RunStatus(state="starting", text="waiting for world, fields"))
    for text in ("waiting for world, fields", "waiting for world"):
        lines(RunStatus(state="starting", text=f"compiling kernels, {text}", is_compiling=True))
    assert capsys.readouterr().err.splitlines() == [
        "room: starting, waiting for world, fields",
        "room: starting, compiling kernels, waiting for world, fields",
    ]
