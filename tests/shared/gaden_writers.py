"""Writers of GADEN's frame formats, for tests of the readers."""

import struct
import zlib

import numpy as np

CELLS = (7, 5, 4)
MIN_M = (-1.0, 2.0, 0.5)
CELL_M = 0.5
MAX_M = tuple(low + n * CELL_M for low, n in zip(MIN_M, CELLS, strict=True))
SOURCE_M = (0.5, 3.0, 1.0)
GAS_CODE = 1
MOLES = 6.440745139e-06
AIR = 4.0894632701667424e-05
WIND = 12
POSITIONS_M = np.array([(0.25, 3.5, 1.25), (1.5, 2.75, 2.0), (-0.75, 4.25, 0.75)])
SIGMAS_CM = np.array([10.0, 25.0, 31.5])


def _grid():
    return struct.pack("<3i7f", *CELLS, *MIN_M, *MAX_M, CELL_M)


def _records(layout, positions_m=POSITIONS_M, sigmas_cm=SIGMAS_CM):
    rows = zip(positions_m.tolist(), sigmas_cm.tolist(), strict=True)
    return b"".join(struct.pack(f"<i4{layout}", i, *place, sigma) for i, (place, sigma) in enumerate(rows))


def _text(word):
    return struct.pack("<Q", len(word)) + word.encode()


def version_1(**more):
    head = struct.pack("<i6d3i3d3d", 1, *MIN_M, *MAX_M, *CELLS, *(CELL_M,) * 3, *SOURCE_M)
    return head + struct.pack("<i2di", GAS_CODE, MOLES, AIR, WIND) + _records("d", **more)


def version_2(minor=3):
    head = struct.pack("<2i", 2, minor) + _grid() + struct.pack("<3f", *SOURCE_M)
    return head + struct.pack("<i2di", GAS_CODE, MOLES, AIR, WIND) + _records("d")


def version_2_6_simulated():
    """As GADEN 2.6's own simulator writes it."""
    head = struct.pack("<2i", 2, 6) + _grid() + struct.pack("<3fi", *SOURCE_M, GAS_CODE)
    return head + struct.pack("<2fi", MOLES, AIR, WIND) + _records("f")


def version_2_6():
    """As GADEN's later readers of 2.6 expect it."""
    return struct.pack("<2i", 2, 6) + _grid() + struct.pack("<2fi", MOLES, AIR, WIND) + _records("f")


def wind_2_6(wind, minor=6):
    """The result or `.csv_gaden` of a wind (nx, ny, nz, 3): x y z of each cell, x running fastest."""
    return struct.pack("<2i", 2, minor) + wind.transpose(2, 1, 0, 3).astype("<f4").tobytes()


def _version_3_head(shape, sizes):
    source = _text(shape) + struct.pack(f"<{len(sizes)}f", *sizes) + struct.pack("<3fi", *SOURCE_M, GAS_CODE)
    return struct.pack("<2i", 3, 0) + _grid() + source + struct.pack("<2fi", MOLES, AIR, WIND)


def version_3(shape="point", sizes=(), active=(1, 1, 1)):
    rows = zip(POSITIONS_M.tolist(), SIGMAS_CM.tolist(), active, strict=True)
    records = b"".join(struct.pack("<4fB3x", *place, sigma, is_active) for place, sigma, is_active in rows)
    return _version_3_head(shape, sizes) + _text("filaments") + struct.pack("<Q", len(POSITIONS_M)) + records


def version_3_early():
    return _version_3_head("point", ()) + _records("f")


def version_3_concentrations():
    """The value of cell (i, j, k) is i + 10 j + 100 k."""
    values = np.add.outer(np.add.outer(100 * np.arange(CELLS[2]), 10 * np.arange(CELLS[1])), np.arange(CELLS[0]))
    return (
        _version_3_head("point", ())
        + _text("concentrations")
        + struct.pack("<Q", values.size)
        + values.astype("<f4").tobytes()
    )


def compressed(content, *, is_late=False):
    body = zlib.compress(content)
    return b"GADEN_RESULT\0" + struct.pack("<Q", len(content)) + body if is_late else body
