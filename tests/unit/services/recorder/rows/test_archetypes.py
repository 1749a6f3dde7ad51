"""The table of archetypes: only sensors' numbers are without an entry."""

from gslcosim_services.recorder import stream_table as streams
from gslcosim_services.recorder.rows.archetypes import ARCHETYPES


def test_each_stream_but_numbers_of_readings_and_documents_has_an_archetype():
    written_otherwise = {streams.TRACK_ATTITUDE, streams.SUMMARY, streams.LEGEND}
    missing = {stream for stream in streams.STREAMS if stream not in ARCHETYPES} - written_otherwise
    assert all(stream.table == "readings" and stream.component == streams.SCALARS for stream in missing), missing
    assert not written_otherwise & set(ARCHETYPES)
