"""Numbers that no view draws, kept for those who read a recording."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from gslcosim.contract.messages import Reading
from gslcosim.recording.run_file import RunFile

# What they are called in the file.
NUMBERS_COMPONENT = "numbers"


class NumberRows:
    """Numbers that no view draws, some a row, in single precision."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._ticks: list[int] = []
        self._values: list[Sequence[float]] = []

    def add(self, tick: int, values: Sequence[float]) -> None:
        """Append the numbers of a tick."""
        self._ticks.append(tick)
        self._values.append(values)

    def send(self, file: RunFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        if self._ticks:
            numbers: Any = {NUMBERS_COMPONENT: np.concatenate(self._values, dtype=np.float32)}
            columns = rr.AnyValues.columns(**numbers)
            file.send(self._entity, self._ticks, columns.partition([len(values) for values in self._values]))
            self._ticks, self._values = [], []


class ValueRows(NumberRows):
    """All numbers of a sensor's readings, for what its curves leave out."""

    def add(self, tick: int, reading: Reading) -> None:  # type: ignore[override]
        """Append a reading, unless it means nothing yet."""
        if not reading.is_warming_up:
            super().add(tick, reading.values)
