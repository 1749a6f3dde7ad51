"""Scalar kernels give the same bits as plain functions and compiled, and a change of one leaves no old code in use."""
# pyright: reportCallIssue=false

import math

import numpy as np
import pytest

from gslcosim.base import kernel_cache
from gslcosim.base.rng import stream
from gslcosim.base.scalar_kernels import exact_sum
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, make_sensor_spec
from gslcosim_search.learned.encoding import CHANNELS
from gslcosim_services.sensing import SENSOR_MODELS
from gslcosim_services.sensing.models.base import KernelSensorKind
from gslcosim_training.batch.random_streams import seed_inplace
from gslcosim_training.batch.reference_free_kernels import reference_free_njit
from gslcosim_training.batch.scalar_compilation import (
    call_kernel,
    find_advance_address,
    find_encode_address,
    find_estimate_address,
)

GASES = ("ethanol", "methane", "neon")
KINDS = [kind for kind in SENSOR_MODELS.values() if isinstance(kind, KernelSensorKind)]
N_TICKS = 300


@reference_free_njit()
def _call(address, numbers):
    return call_kernel(address, numbers)


def address(array):
    return array.ctypes.data


def noisy_spec(model):
    names = ("noise_std", "speed_noise_std_m_s", "direction_noise_std_rad")
    return make_sensor_spec(
        model=model, name="s", **dict.fromkeys(names & SENSOR_BLOCKS[model].model_fields.keys(), 0.3)
    )


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize("n_gases", [0, 1, 3])
def test_instruments_are_the_same_compiled_to_the_bit(kind, n_gases):
    kernel = kind.kernel(noisy_spec(kind.name), GASES[:n_gases], 0.1)
    rng, plain_stream, bits = np.random.default_rng(3), stream(7, "sensing.a.s"), np.zeros(4, np.uint64)
    seed_inplace(bits, 7, np.frombuffer(b"sensing.a.s", np.uint8))
    parameters, state = np.array(kernel.parameters), np.array(kernel.state)
    plain_state, plain_values, values = list(kernel.state), [0.0] * kernel.n_values, np.zeros(kernel.n_values)
    compiled = find_advance_address(kernel.advance)
    for _ in range(N_TICKS):
        ppm = np.where(rng.random(n_gases) < 0.2, 0.0, rng.exponential(3.0, n_gases) * 10.0 ** rng.integers(-4, 3))
        air = rng.normal(size=6) * (rng.random(6) < 0.9)
        plain = kernel.advance(
            kernel.parameters, plain_state, ppm.tolist(), air[:3].tolist(), air[3:].tolist(), plain_stream, plain_values
        )
        seen = ppm.copy()
        saturated = _call(
            compiled,
            (
                address(parameters), len(parameters), address(state), len(state), address(seen), n_gases, address(air),
                address(bits), address(values), len(values),
            ),
        )  # fmt: skip
        assert (bool(saturated), values.tolist(), state.tolist()) == (plain, plain_values, plain_state)
    assert {type(value) for value in plain_values} == {float}


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.estimator], ids=lambda kind: kind.name)
def test_estimates_are_the_same_compiled_to_the_bit(kind):
    estimator = kind.estimator("ethanol")
    parameters, found, rng = np.array(estimator.parameters), np.zeros(1), np.random.default_rng(4)
    compiled = find_estimate_address(estimator.estimate)
    for ohm in [*(10.0 ** rng.uniform(1, 6, 500)), 0.0, -5.0, 1e-300]:
        values = np.array([ohm])
        _call(compiled, (address(parameters), len(parameters), address(values), 1, address(found)))
        assert found[0] == estimator.estimate(estimator.parameters, (float(ohm),))


@pytest.mark.parametrize(
    "channel", CHANNELS.values(), ids=" ".join(f"{q}-{u}" for q, u in CHANNELS).split()[0] and None
)
def test_numbers_of_readings_are_the_same_compiled_to_the_bit(channel):
    compiled, rng, n = find_encode_address(channel.encode), np.random.default_rng(5), len(channel.names)
    for _ in range(500):
        values, numbers, plain = rng.normal(size=6) * 10.0 ** rng.integers(-3, 6), np.zeros(n), [0.0] * n
        channel.encode(values.tolist(), plain)
        _call(compiled, (address(values), 6, address(numbers), n))
        assert numbers.tolist() == plain


def test_sums_are_those_of_fsum():
    rng = np.random.default_rng(2)
    for _ in range(500):
        n = int(rng.integers(1, 40))
        values = (rng.exponential(size=n) * 10.0 ** rng.integers(-12, 12, n)).tolist()
        first = int(rng.integers(0, n))
        assert exact_sum(values, first, n - first) == math.fsum(values[first:])


def test_a_kernel_lies_in_a_file_whose_changes_are_seen(tmp_path):
    """Numba looks at the file of the caller only: what it calls is part of the name of the cache's folder."""
    package = tmp_path / "package"
    package.mkdir()
    roots = {"package": package}
    formula = "from gslcosim.base.scalar_kernels import scalar_kernel\n\n@scalar_kernel\ndef f(): return {}\n"
    (package / "formula.py").write_text(formula.format(1))
    (package / "other.py").write_text("x = 1\n")
    before = kernel_cache._hash_kernels(roots)
    (package / "other.py").write_text("x = 2\n")
    assert kernel_cache._hash_kernels(roots) == before
    (package / "formula.py").write_text(formula.format(2))
    assert kernel_cache._hash_kernels(roots) != before
