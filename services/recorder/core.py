"""Recorder core: reads everything, writes one Rerun file."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, cast

from gslcosim.base.errors import RecordingError
from gslcosim.base.ticks import ticks_from_seconds
from gslcosim.contract import keys
from gslcosim.contract.messages import Verdict
from gslcosim.contract.participant import Episode, Inbox, Outbox
from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim_services.recorder.service import recorder_spec

if TYPE_CHECKING:
    from gslcosim_services.recorder.run_recording import RunRecording

# Rows are sent together: a call costs some 100 us, whether it carries one row or many.
FLUSH_TICKS = 512


class RecorderCore:
    """Writes a run into one .rrd file that opens with a layout of its own.

    Reads every port of the run with delay 0, writes none. Draws nothing random and reads no clock, so equal runs give
    equal content. Only messages up to the verdict, and between `recording.from_s` and `to_s`, are recorded. The file
    exists from `reset` on and is whole when `close` has returned. Steps only append; every `FLUSH_TICKS` ticks the rows
    are sent to the file.

    Raises RecordingError when the file cannot be written; the runtime then stops the run.
    """

    def __init__(self, scenario: Scenario, environment: Environment, path: Path) -> None:
        """Prepare a recording.

        Args:
            path: The file to write; an existing one is replaced at `reset`. The name of its folder is the recording's
                identity in the viewer.
        """
        self._scenario = scenario
        self._environment = environment
        self._path = path
        self._first_tick = ticks_from_seconds(scenario.recording.from_s, scenario.tick_ns)
        to_s = scenario.recording.to_s
        self._last_tick = sys.maxsize if to_s is None else ticks_from_seconds(to_s, scenario.tick_ns)
        self._run_id = path.resolve().parent.name
        self.spec = recorder_spec(scenario)
        self._recording: RunRecording | None = None

    def reset(self, episode: Episode) -> Outbox:
        """Open the file and draw the static scene."""
        del episode
        self.close()

        # Rerun takes half a second to import; participants that do not wait for the recorder begin meanwhile.
        from gslcosim_services.recorder.blueprint import default_blueprint, title
        from gslcosim_services.recorder.recording_file import RecordingFile
        from gslcosim_services.recorder.rows.events import WindLayer
        from gslcosim_services.recorder.run_recording import RunRecording

        wind_layer = WindLayer(self._environment, self._scenario.slice_height_m)
        file = RecordingFile(
            self._path,
            run_id=self._run_id,
            name=title(self._scenario),
            tick_ns=self._scenario.tick_ns,
            blueprint=default_blueprint(self._scenario, self._environment),
        )
        try:
            self._recording = RunRecording(file, self._scenario, self._environment, wind_layer, self._path.parent)
        except RecordingError:
            file.close()
            raise
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Record all messages of this tick."""
        recording = self._recording
        if recording is None or recording.is_over:
            return {}
        if self._first_tick <= tick <= self._last_tick:
            recording.note(tick, inbox)
        verdict = cast(Verdict | None, inbox.get(keys.VERDICT))
        if verdict is not None:
            recording.end(verdict)
        elif tick % FLUSH_TICKS == FLUSH_TICKS - 1:
            recording.send()
        return {}

    def close(self) -> None:
        """Send the waiting rows, write the file's footer and release it; without an open file, do nothing."""
        if self._recording is None:
            return
        recording, self._recording = self._recording, None
        recording.close()
