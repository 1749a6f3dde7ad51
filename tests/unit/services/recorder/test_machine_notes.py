"""What the machine did in a run goes from its notes into the recording: decisions, faults, sandboxes."""

from recording_content import column
from rerun.chunk import RrdReader
from scripted_flight import ScriptedFlight

from gslcosim.contract.participant import Episode
from gslcosim.runtime.run_dir import NAME, MachineLog, MachineNotes, note_sandboxes, read_machine_notes
from gslcosim_services.recorder.core import RecorderCore


def _noted(folder):
    note_sandboxes(folder, {"agent_0": "landlock"})
    log = MachineLog(folder)
    log.decided("agent_0", 3, 0.0125)
    log.failed("agent agent_0", 4, "expected a command, was 'teleport'.")
    log.decided("agent_0", 5, 0.5)
    log.decided("agent_0", 900, 0.5)
    log.close()


def test_notes_are_read_back(tmp_path):
    _noted(tmp_path)
    notes = read_machine_notes(tmp_path)
    assert notes.decisions_ms == {"agent_0": [(3, 12.5), (5, 500.0), (900, 500.0)]}
    assert notes.faults == [(4, "agent agent_0", "expected a command, was 'teleport'.")]
    assert notes.sandboxes == {"agent_0": "landlock"}


def test_lines_that_are_none_of_ours_are_left_out_and_no_file_says_nothing(tmp_path):
    assert read_machine_notes(tmp_path) == MachineNotes()
    _noted(tmp_path)
    with (tmp_path / NAME).open("ab") as file:
        file.write(b'\xff\xfe\n[1]\nnull\n{"agent": 1}\n{"agent": "a", "tick": "x", "decided_ms": 1}\n{"tick": 1, "fau')
    assert len(read_machine_notes(tmp_path).faults) == 1
    assert list(read_machine_notes(tmp_path).decisions_ms) == ["agent_0"]


def test_a_folder_that_is_gone_keeps_no_run_from_going_on(tmp_path):
    log = MachineLog(tmp_path / "gone")
    log.decided("agent_0", 3, 0.0125)
    log.close()
    MachineLog().decided("agent_0", 3, 0.0125)


def test_decisions_faults_and_sandboxes_are_in_the_recording(make_room, tmp_path):
    flight = ScriptedFlight(n_ticks=20)
    path = tmp_path / "recording.rrd"
    core = RecorderCore(flight.scenario, make_room(), path)
    core.reset(Episode(seed=0))
    for tick in range(10):
        core.step(tick, flight.inbox(tick))
    # As they come while the recorder is behind.
    _noted(tmp_path)
    for tick in range(10, 20):
        core.step(tick, flight.inbox(tick))
    core.close()
    ticks, _, taken_ms = column(path, "/plots/decision_ms/agent_0", "Scalars:scalars")
    assert (ticks, taken_ms) == ([3, 5], [[12.5], [500.0]])
    ticks, _, texts = column(path, "/faults", "TextLog:text")
    assert (ticks, texts) == ([4], [["agent agent_0: expected a command, was 'teleport'."]])
    _, _, summaries = column(path, "/summary", "TextDocument:text")
    assert summaries[-1][0].endswith("- sandbox of agent_0: landlock\n")
    assert RrdReader(path).recordings()
