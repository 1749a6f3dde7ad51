"""Tracks of a trial as bytes, for the journal, and as rows of `tracks.parquet`."""

import zlib
from typing import Any

import msgpack  # pyright: ignore[reportMissingTypeStubs]
import msgspec
import numpy as np
from numpy.typing import NDArray

from gslcosim.benchmark.store.columns import TRACK_COLUMNS

Tracks = dict[str, dict[str, NDArray[np.float32]]]
"""For each agent its series by the names of `TRACK_COLUMNS`, all of one length."""

SERIES = tuple(column.name for column in TRACK_COLUMNS if column.name not in ("trial", "agent"))
_msgpack: Any = msgpack


def packed(tracks: Tracks) -> bytes:
    """Return tracks as compressed bytes."""
    agents = {name: [series[key].astype("<f4").tobytes() for key in SERIES] for name, series in tracks.items()}
    return zlib.compress(_msgpack.packb(agents, use_bin_type=True), level=6)


def unpacked(payload: bytes) -> Tracks:
    """Return the tracks that `packed` has made bytes of.

    Raises:
        ValueError: the bytes are something else.
        zlib.error: they are not compressed.
    """
    try:
        agents = msgspec.msgpack.decode(zlib.decompress(payload), type=dict[str, list[bytes]])
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(str(error)) from error
    return {
        name: {key: np.frombuffer(part, dtype="<f4") for key, part in zip(SERIES, parts, strict=True)}
        for name, parts in agents.items()
    }
