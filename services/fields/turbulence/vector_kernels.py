# pyright: basic
"""Kernels on vectors of four or eight numbers: sums over pairs of eddy patterns, and columns of a table at a point.

Each instruction works on numbers that do not meet, so results are the same on every processor: nothing is added in
another order, and nothing is multiplied and added at once.
"""

from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core.cgutils import unpack_tuple
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

N_LATTICE = 32
"""Nodes along each axis of the lattice of random numbers, a power of two; beyond them it repeats."""
PADDED = N_LATTICE + 2
"""Nodes that are stored along each axis: the first two again at the end, for splines that reach over it."""
N_SUMS = 40
"""Numbers in `sums`: five vectors of two patterns with three components and one unused number each."""

_FLOAT = ir.FloatType()
_FOUR, _EIGHT, _INDEX = ir.VectorType(_FLOAT, 4), ir.VectorType(_FLOAT, 8), ir.IntType(32)
_BYTES = 4


class _Vectors:
    # Loads, and vectors of a number for each pattern, rounded to single precision.
    def __init__(self, builder: ir.IRBuilder) -> None:
        self.builder = builder

    def both(self, first, second):
        lanes = [ir.Constant(_INDEX, lane) for lane in range(8)]
        return self.builder.shuffle_vector(first, second, ir.Constant(ir.VectorType(_INDEX, 8), lanes))

    def same(self, number, kind=_FOUR):
        if number.type != _FLOAT:
            number = self.builder.fptrunc(number, _FLOAT)
        undefined, zero = ir.Constant(kind, ir.Undefined), ir.Constant(_INDEX, 0)
        lane = self.builder.insert_element(undefined, number, zero)
        return self.builder.shuffle_vector(
            lane, undefined, ir.Constant(ir.VectorType(_INDEX, kind.count), [zero] * kind.count)
        )

    def spread(self, pair):
        return self.both(*(self.same(number) for number in pair))

    def load(self, pointer, offset: int, kind=_FOUR):
        place = self.builder.gep(pointer, [ir.Constant(ir.IntType(64), offset)])
        return self.builder.load(self.builder.bitcast(place, kind.as_pointer()), align=_BYTES)

    def dot(self, weights, vectors):
        total = self.builder.fmul(weights[0], vectors[0])
        for weight, vector in zip(weights[1:], vectors[1:], strict=True):
            total = self.builder.fadd(total, self.builder.fmul(weight, vector))
        return total


# The three quadratic B-splines that reach a place, and their slopes; t in [0, 1) from the lower edge.
def _splines(builder: ir.IRBuilder, t):
    half, one, two = (ir.Constant(_EIGHT, [number] * 8) for number in (0.5, 1.0, 2.0))
    rest = builder.fsub(one, t)
    values = (
        builder.fmul(builder.fmul(half, rest), rest),
        builder.fadd(half, builder.fmul(t, rest)),
        builder.fmul(builder.fmul(half, t), t),
    )
    return values, (builder.fsub(t, one), builder.fsub(one, builder.fmul(two, t)), t)


@cast(Any, intrinsic)
def add_pattern_pair(typingctx, lattice, sums, starts, fractions, slopes, weights):
    """Add two patterns' random vectors psi and their slopes at a place, by quadratic B-splines, to `sums`.

    Args:
        lattice: (PADDED^3 3 + 1,) float32 vectors at nodes, x y z, and a number after them that is not used.
        sums: (N_SUMS,) float32: the slopes of psi along x, y and z of the world, psi, and psi again; modified.
        starts: Two int64: index in `lattice` of the lowest node that reaches the place, for each pattern.
        fractions: Six float32, x y z of the first, then of the second pattern: place above that node's cell, 0 to 1.
        slopes: Eighteen float32, nine of each pattern: of its coordinate x along x, y, z of the world, then of y and z.
        weights: Six float32: factor of the slopes, of psi, and of psi again, for each pattern.

    Held by:
        tests/unit/services/fields/turbulence/test_eddies.py (against splines of scipy, and differences)
    """

    def build(context, builder: ir.IRBuilder, signature, arguments):
        kinds = signature.args
        table, total = (make_array(kinds[i])(context, builder, arguments[i]).data for i in (0, 1))
        start, place, along, factor = (unpack_tuple(builder, each) for each in arguments[2:])
        make = _Vectors(builder)
        first = [builder.gep(table, [index]) for index in start]
        (wx, dx), (wy, dy), (wz, dz) = (_splines(builder, make.spread(place[axis::3])) for axis in range(3))
        planes = []
        for a in range(3):
            rows = []
            for b in range(3):
                offset = 3 * PADDED * (PADDED * a + b)
                nodes = [make.both(*(make.load(pointer, offset + 3 * c) for pointer in first)) for c in range(3)]
                rows.append((make.dot(wz, nodes), make.dot(dz, nodes)))
            values, rises = zip(*rows, strict=True)
            planes.append((make.dot(wy, values), make.dot(dy, values), make.dot(wy, rises)))
        values, aside, rises = zip(*planes, strict=True)
        psi, own = make.dot(wx, values), (make.dot(dx, values), make.dot(wx, aside), make.dot(wx, rises))
        of_slopes, of_psi, of_psi_again = (make.spread(factor[i::3]) for i in range(3))
        found = [
            builder.fmul(of_slopes, make.dot([make.spread(along[3 * m + axis :: 9]) for m in range(3)], own))
            for axis in range(3)
        ]
        found += [builder.fmul(of_psi, psi), builder.fmul(of_psi_again, psi)]
        for i, each in enumerate(found):
            where = builder.bitcast(builder.gep(total, [ir.Constant(ir.IntType(64), 8 * i)]), _EIGHT.as_pointer())
            builder.store(builder.fadd(builder.load(where, align=_BYTES), each), where, align=_BYTES)
        return context.get_dummy_value()

    return types.none(lattice, sums, starts, fractions, slopes, weights), build


def _make_interpolation(n_columns: int):
    kind = ir.VectorType(_FLOAT, n_columns)

    @cast(Any, intrinsic)
    def interpolate(typingctx, table, start, steps, weights, per_m):
        def build(context, builder: ir.IRBuilder, signature, arguments):
            data = make_array(signature.args[0])(context, builder, arguments[0]).data
            step, weight, scale = (unpack_tuple(builder, each) for each in arguments[2:])
            make = _Vectors(builder)
            (a, b, c), scales = ([make.same(each, kind) for each in numbers] for numbers in (weight, scale))
            corners = [arguments[1]]
            for each in step:
                corners = [place for corner in corners for place in (corner, builder.add(corner, each))]
            f = [make.load(builder.gep(data, [corner]), 0, kind) for corner in corners]
            # Between pairs of corners along x, then y, then z; and the slopes along x of those that are left.
            rise = [builder.fsub(f[4 + i], f[i]) for i in range(4)]
            f = [builder.fadd(f[i], builder.fmul(a, rise[i])) for i in range(4)]
            aside = [builder.fsub(f[2 + i], f[i]) for i in range(2)]
            f = [builder.fadd(f[i], builder.fmul(b, aside[i])) for i in range(2)]
            rise = [builder.fadd(rise[i], builder.fmul(b, builder.fsub(rise[2 + i], rise[i]))) for i in range(2)]
            up = builder.fsub(f[1], f[0])
            value = builder.fadd(f[0], builder.fmul(c, up))
            slopes = [*(builder.fadd(e[0], builder.fmul(c, builder.fsub(e[1], e[0]))) for e in (rise, aside)), up]
            found = [value, *(builder.fmul(slope, each) for slope, each in zip(slopes, scales, strict=True))]
            lanes = [
                builder.extract_element(each, ir.Constant(_INDEX, lane)) for each in found for lane in range(n_columns)
            ]
            return context.make_tuple(builder, signature.return_type, lanes)

        return types.UniTuple(types.float32, 4 * n_columns)(table, start, steps, weights, per_m), build

    interpolate.__doc__ = f"""Return {n_columns} columns of a table between eight corners, and their slopes.

    Args:
        table: (n,) float32, {n_columns} numbers for each corner.
        start: int64 index of the lowest corner's first number.
        steps: Three int64: numbers from a corner to the next along x, y and z.
        weights: Three weights of the upper corners along x, y and z.
        per_m: Three inverse distances of corners [1/m], zero where they are the same.

    Returns:
        Float32: the columns' values, then their slopes along x, along y and along z.

    Held by:
        tests/unit/services/fields/turbulence/test_air.py
    """
    return interpolate


interpolate_4, interpolate_8 = _make_interpolation(4), _make_interpolation(8)
