"""Chunks of recordings."""

import warnings
from pathlib import Path

from rerun.chunk import Chunk, RrdReader

from gslcosim.base.checksums import check_files
from gslcosim.base.errors import RecordingError
from gslcosim_services.recorder.recording_file import APPLICATION_ID
from gslcosim_services.recorder.rerun_cli import has_footer, rerun_path


def read_chunks(path: Path) -> list[Chunk]:
    """Return all chunks of a recording."""
    if not path.is_file():
        raise RecordingError(f"recording: expected a file, was none.\nFile: {path}")
    if not has_footer(path):
        raise RecordingError(describe_broken_recording(path, "one that was cut off, or none at all"))
    check_files(path.parent, path.name)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            reader = RrdReader(rerun_path(path))
            stores = reader.recordings()
            if [store.application_id for store in stores] != [APPLICATION_ID]:
                of = ", ".join(store.application_id for store in stores) or "nothing"
                raise RecordingError(
                    f"recording: expected one of gslcosim, was one of {of}. Give the recording.rrd of a run.\n"
                    f"File: {path}"
                )
            return reader.store(store=stores[0]).stream().to_chunks()
    except (OSError, RuntimeError, ValueError, Warning) as error:
        raise RecordingError(describe_broken_recording(path, str(error))) from error


def describe_broken_recording(path: Path, found: str) -> str:
    """Return the error text for a recording that cannot be read."""
    return (
        f"recording: expected a whole one, was {found}. What is left of it is made whole by: "
        f"gslcosim runs repair {path.parent}\nFile: {path}"
    )
