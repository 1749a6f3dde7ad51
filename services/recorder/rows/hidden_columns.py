"""Hidden columns: numbers beside a curve that no view draws, for readers of recordings."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from gslcosim.contract.messages import Reading
from gslcosim_services.recorder.entities import wind_speed_m_s
from gslcosim_services.recorder.recording_file import RecordingFile

# What they are called in the file: another component of the curve's entity, so that both share their times.
NUMBERS_COMPONENT = "numbers"


def encode_numbers(rows: Sequence[Sequence[float]]) -> Any:
    """Return rows of numbers in single precision, little-endian, as bytes: a `pyarrow` array."""
    numbers = np.array([number for row in rows for number in row], dtype="<f4")
    ends = np.cumsum([0, *(numbers.itemsize * len(row) for row in rows)], dtype=np.int32)
    return pa.Array.from_buffers(pa.binary(), len(rows), [None, pa.py_buffer(ends), pa.py_buffer(numbers)])


def decode_numbers(rows: Sequence[bytes]) -> NDArray[np.float64]:
    """Return the (n, k) numbers of rows of bytes."""
    return np.frombuffer(b"".join(rows), dtype="<f4").astype(np.float64).reshape(len(rows), -1)


class CurveWithHiddenColumns:
    """Curve of one number a row, and beside it hidden columns as bytes: the viewer would draw numbers, of any name."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._ticks: list[int] = []
        self._drawn: list[float] = []
        self._numbers: list[Sequence[float]] = []

    def add(self, tick: int, drawn: float, numbers: Sequence[float]) -> None:
        """Append what is drawn at a tick, and what is not."""
        self._ticks.append(tick)
        self._drawn.append(drawn)
        self._numbers.append(numbers)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        if self._ticks:
            rows: Any = {NUMBERS_COMPONENT: encode_numbers(self._numbers)}
            curve = rr.Scalars.columns(scalars=np.array(self._drawn))
            file.send(self._entity, self._ticks, [*curve, *rr.AnyValues.columns(**rows)])
            self._ticks, self._drawn, self._numbers = [], [], []


class AnemometerRows:
    """The speed that an anemometer reports as a curve, and beside it all that it reports."""

    def __init__(self, entity: str) -> None:
        self._rows = CurveWithHiddenColumns(entity)

    def add(self, tick: int, reading: Reading) -> None:
        """Append a reading, unless it means nothing yet."""
        if not reading.is_warming_up:
            (speed_m_s,) = wind_speed_m_s(reading)
            self._rows.add(tick, speed_m_s, reading.values)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        self._rows.send(file)
