import math
import subprocess
import sys

import numpy as np
import pytest

from gslcosim.base.rng import RandomStream, stream
from gslcosim.base.scalar_kernels import NORMAL_TAIL, tail_normal

NAMES = ["fields.release", "fields.disperse", "sensing.nose", "sensing.nosf", ""]


def test_a_stream_is_repeatable():
    assert np.array_equal(stream(7, "fields.release").random(8), stream(7, "fields.release").random(8))


@pytest.mark.parametrize("seed", [0, 7, 2**32 - 1, 2**32, 2**40 + 5, 2**70 + 3])
def test_a_stream_begins_as_numpys_of_seed_and_name(seed):
    name = "fields.eddies.3.1.44"
    assert stream(seed, name).random(5).tolist() == np.random.default_rng([seed, *name.encode()]).random(5).tolist()


def test_streams_differ_by_seed_and_by_name():
    first_draws = {float(stream(seed, name).random()) for seed in range(50) for name in NAMES}
    assert len(first_draws) == 50 * len(NAMES)


def test_a_stream_does_not_depend_on_what_others_drew():
    other = stream(7, "fields.disperse")
    mine = stream(7, "fields.release")
    first = mine.random()
    other.random(1000)
    assert [first, mine.random()] == stream(7, "fields.release").random(2).tolist()


@pytest.mark.slow
def test_a_stream_is_the_same_in_another_process():
    """Python salts its own hash of strings for each process; streams must not use it."""
    code = "from gslcosim.base.rng import stream; print(stream(7, 'fields.release').integers(2**62))"
    answers = {
        subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONHASHSEED": salt}, capture_output=True, text=True, check=True
        ).stdout
        for salt in ("1", "2")
    }
    assert answers == {f"{stream(7, 'fields.release').integers(2**62)}\n"}


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_tails_are_as_frequent_and_as_long_as_those_of_the_distribution(dtype):
    n = 2_000_000
    numbers = np.abs(stream(1, "x").standard_normal(n, dtype))
    for limit in (NORMAL_TAIL, 4.0, 4.3):
        expected = n * math.erfc(limit / math.sqrt(2.0))
        assert abs(np.count_nonzero(numbers >= limit) - expected) < 4.0 * math.sqrt(expected)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_arrays_hold_what_single_draws_give_tails_among_them(dtype):
    one, few, many = stream(2, "x"), stream(2, "x"), stream(2, "x")
    drawn = [float(dtype(one.standard_normal(None, dtype))) for _ in range(30_000)]
    assert np.concatenate([few.standard_normal((2, 3), dtype) for _ in range(5_000)]).reshape(-1).tolist() == drawn
    assert many.standard_normal((10_000, 3), dtype).reshape(-1).tolist() == drawn
    assert max(map(abs, drawn)) > NORMAL_TAIL
    assert one.random() == few.random() == many.random()


def test_tails_keep_the_sign_and_no_draw_of_the_c_library():
    """Where one number of a few is a tail, it is drawn again from the two uniform numbers that follow."""
    seeds = [i for i in range(3_000) if abs(np.random.default_rng(i).standard_normal()) >= NORMAL_TAIL]
    assert seeds
    for seed in seeds:
        of_numpy = np.random.default_rng(seed)
        drawn, numbers = of_numpy.standard_normal(), RandomStream(np.random.PCG64(seed))
        redrawn = 0.0
        while not redrawn:
            redrawn = tail_normal(of_numpy.random(), of_numpy.random())
        assert numbers.standard_normal() == math.copysign(redrawn, drawn)
