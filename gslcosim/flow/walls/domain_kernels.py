"""Which air is connected."""
# pyright: basic

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def flood(air, reached, seeds, stride_x, stride_y):
    """Mark all air that can be reached from the seeds through cell faces, breadth first.

    Args:
        air: (n,) flat padded cells, True is air; the padding is not air, so no index leaves the array.
        reached: (n,) all False at first, written.
        seeds: (m,) flat indices of air cells to start from.
        stride_x: Distance of x-neighbours in the flat array.
        stride_y: Same for y-neighbours; z-neighbours are adjacent.

    Held by:
        tests/unit/flow/walls/test_domain.py (a sealed chamber stays out)
    """
    queue = np.empty(np.count_nonzero(air) + 1, np.int64)
    head, tail = 0, 0
    for seed in seeds:
        reached[seed] = True
        queue[tail] = seed
        tail += 1
    while head < tail:
        cell = queue[head]
        head += 1
        for step in (stride_x, -stride_x, stride_y, -stride_y, 1, -1):
            neighbour = cell + step
            if air[neighbour] and not reached[neighbour]:
                reached[neighbour] = True
                queue[tail] = neighbour
                tail += 1
