"""First numbers of streams, equal to those of numpy's generator to the bit."""

import numpy as np
import pytest

from gslcosim.base.rng import list_stream_words, stream
from gslcosim.base.rng_kernels import draw_first_uniforms


@pytest.mark.parametrize("seed", [0, 7, 2**32 - 1, 2**32, 2**40 + 5, 2**70 + 3])
@pytest.mark.parametrize("name", ["gas", "fields.eddies.3.1.44", "fields.inner.12.0.1234567"])
def test_first_uniforms_are_those_of_the_stream(seed, name):
    expected = np.random.default_rng([seed, *name.encode()]).random(5).tolist()
    assert stream(seed, name).random(5).tolist() == expected
    assert draw_first_uniforms(list_stream_words(seed, name), 5).tolist() == expected


def test_first_uniforms_of_any_words_are_those_of_numpy():
    rng = np.random.default_rng(1)
    for n in range(4, 40):
        words = rng.integers(0, 2**32, n, dtype=np.uint32)
        expected = np.random.Generator(np.random.PCG64(words)).random(4)
        assert draw_first_uniforms(words, 4).tolist() == expected.tolist()
