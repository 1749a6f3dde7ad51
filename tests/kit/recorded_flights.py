"""Fixtures that record scripted runs, and read what a recording has."""

import pytest


@pytest.fixture
def record(make_room, tmp_path):
    """Record a scripted run, with its inboxes edited, into a folder of that name and return the file."""
    from scripted_flight import ScriptedFlight

    from gslcosim.contract.participant import Episode
    from gslcosim_services.recorder.core import RecorderCore

    def run(*, run_id="run", room=None, until=None, edit=lambda inbox: inbox, **flight_arguments):
        flight = ScriptedFlight(**flight_arguments)
        path = tmp_path / run_id / "recording.rrd"
        core = RecorderCore(flight.scenario, room or make_room(), path)
        core.reset(Episode(seed=0))
        for tick in range(until or flight.n_ticks):
            core.step(tick, edit(flight.inbox(tick)))
        core.close()
        return path

    return run


@pytest.fixture
def rows_of():
    """Return how many rows each entity of a recording has, static ones as -1."""
    from rerun.chunk import RrdReader

    def read(path):
        rows: dict[str, int] = {}
        for chunk in RrdReader(path).store().stream().to_chunks():
            entity = str(chunk.entity_path)
            if not chunk.is_static:
                rows[entity] = max(rows.get(entity, 0), 0) + chunk.to_record_batch().num_rows
            else:
                rows.setdefault(entity, -1)
        return rows

    return read
