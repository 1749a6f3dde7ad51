"""Columns of rows that wait until they are sent: appended every tick, sent for many ticks at once."""

from collections.abc import Iterable, Sequence
from operator import attrgetter
from typing import Any

from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.rows.archetypes import ARCHETYPES, Archetype, curves
from gslcosim_services.recorder.stream_table import Stream


class Rows:
    """Rows of one entity that wait until they are sent, each made of an item."""

    def __init__(self, entity: str, archetype: Archetype) -> None:
        self.entity = entity
        self._archetype = archetype
        self._ticks: list[int] = []
        self._items: list[Any] = []

    def add(self, tick: int, item: Any) -> None:
        """Append a row at the end of a tick."""
        self._ticks.append(tick)
        self._items.append(item)

    def extend(self, ticks: Sequence[int], items: Iterable[Any]) -> None:
        """Append rows at the ends of ticks."""
        self._ticks += ticks
        self._items.extend(items)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        if self._ticks:
            file.send(self.entity, self._ticks, self._archetype(self._items))
            self._ticks, self._items = [], []


class RecordingRows:
    """All waiting rows of a recording, by entity; `file` is where they are sent."""

    def __init__(self, file: RecordingFile) -> None:
        self.file = file
        self._rows: dict[str, Rows] = {}

    def of(self, stream: Stream, **names: str) -> Rows:
        """Return the rows of a stream, for names of the run: agent, sensor, gas and so on."""
        entity = stream.at(**names)
        return self._rows.get(entity) or self.at(entity, ARCHETYPES.get(stream, curves))

    def at(self, entity: str, archetype: Archetype) -> Rows:
        """Return the rows at a path that is in no table of streams."""
        return self._rows.setdefault(entity, Rows(entity, archetype))

    def send(self) -> None:
        """Write all waiting rows and forget them."""
        for rows in self._rows.values():
            rows.send(self.file)


def split_columns(
    ticks: Sequence[int], rows: Sequence[Sequence[Any]], *key: str
) -> Iterable[tuple[Any, tuple[Sequence[int], Sequence[Any]]]]:
    """Split rows of items, one row at each tick, into a column of ticks and items for each key.

    Nearly always all rows have the same keys in the same order and are transposed as a whole: sorting the items one by
    one takes several times as long.

    Args:
        ticks: Of the rows.
        rows: At most one item for a key in each.
        key: Attributes that make up the key of an item; of several their tuple is the key.

    Returns:
        Keys, and the ticks with an item of each key, with those items.
    """
    all_keys = [tuple(map(attrgetter(*key), row)) for row in rows]
    if all_keys and all_keys.count(all_keys[0]) == len(all_keys):
        return [(name, (ticks, column)) for name, column in zip(all_keys[0], zip(*rows, strict=True), strict=True)]
    columns: dict[Any, tuple[list[int], list[Any]]] = {}
    for tick, names, row in zip(ticks, all_keys, rows, strict=True):
        for name, item in zip(names, row, strict=True):
            column = columns.setdefault(name, ([], []))
            column[0].append(tick)
            column[1].append(item)
    return columns.items()
