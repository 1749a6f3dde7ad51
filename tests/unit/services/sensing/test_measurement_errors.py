import numpy as np
import pytest
from built_messages import build_sample

from gslcosim.base.errors import ScenarioError
from gslcosim.base.rng import stream
from gslcosim.scenario.models.sensors import is_ideal, make_sensor_spec
from gslcosim_services.sensing import SENSOR_MODELS
from gslcosim_services.sensing.models import build_sensor

TICK_NS = 100_000_000
STILL = (0.0, 0.0, 0.0)


def sample(ppm, wind=STILL, gas="chlorine"):
    return build_sample("a", "s", wind_m_s=wind, **{gas: ppm})


def read(ppms, *, model="pid_ideal", seed=1, gas="chlorine", **more):
    """Read an ideal PID, which shows chlorine as it is, with some imperfections."""
    spec = make_sensor_spec(model=model, name="s", **more)
    sensor = build_sensor(SENSOR_MODELS[model], spec, TICK_NS, stream(seed, "test"))
    return [sensor.read(sample(ppm, gas=gas), STILL) for ppm in ppms]


def values(ppms, **more):
    return [reading.values[0] for reading in read(ppms, **more)]


def test_bias_and_drift_are_added():
    assert values([5.0] * 3, bias=0.5, drift_per_s=10.0) == pytest.approx([5.5, 6.5, 7.5])


def test_saturation_limits_the_value_and_is_reported():
    readings = read([3.0, 9.0, 12.0], max_value=9.0)
    assert [r.values[0] for r in readings] == [3.0, 9.0, 9.0]
    assert [r.is_saturated for r in readings] == [False, True, True]


def test_noise_has_its_spread_and_its_seed():
    noisy = np.array(values([5.0] * 3000, noise_std=0.4))
    assert (noisy.mean(), noisy.std()) == (pytest.approx(5.0, abs=0.03), pytest.approx(0.4, rel=0.06))
    assert values([5.0] * 5, noise_std=0.4) == values([5.0] * 5, noise_std=0.4)
    assert values([5.0] * 5, noise_std=0.4) != values([5.0] * 5, noise_std=0.4, seed=2)


def test_noise_is_drawn_at_readings_only():
    held = values([5.0] * 6, noise_std=0.4, period_s=0.3)
    assert held[0] == held[2] != held[3] == held[5]


def test_a_lag_runs_on_between_readings():
    slow = values([50.0] * 41, model="second_order", period_s=1.0)
    fast = values([50.0] * 41, model="second_order")
    assert slow[::10] == pytest.approx(fast[::10])


@pytest.mark.parametrize("key", ["period_s", "delay_s", "warm_up_s"])
def test_a_time_that_is_no_whole_number_of_ticks_is_refused(key):
    with pytest.raises(ScenarioError, match=rf"sensor s: {key}: expected a whole number of 100 ms ticks, was 0\.25"):
        read([1.0], **{key: 0.25})


def test_until_it_is_warm_a_sensor_shows_its_first_reading_and_says_so():
    readings = read([1.0, 2.0, 3.0, 4.0, 5.0], warm_up_s=0.3)
    assert [r.values[0] for r in readings] == [1.0, 1.0, 1.0, 4.0, 5.0]
    assert [r.is_warming_up for r in readings] == [True, True, True, False, False]


def test_a_warm_up_does_not_change_the_noise_after_it():
    plain = values([5.0] * 6, noise_std=1.0)
    assert values([5.0] * 6, noise_std=1.0, warm_up_s=0.3)[3:] == plain[3:]


def wind_values(wind, *, model, **more):
    silent = {"speed_noise_std_m_s": 0.0, **({"direction_noise_std_rad": 0.0} if model == "anemometer" else {})}
    silent |= {"gain_spread": 0.0}
    spec = make_sensor_spec(model=model, name="s", **silent, **more)
    reading = build_sensor(SENSOR_MODELS[model], spec, TICK_NS, stream(1, "test")).read(sample(0.0, wind), STILL)
    return reading.values, reading.is_saturated


def test_an_anemometers_errors_are_those_of_its_speed():
    """A limit of 2 m/s says nothing about a direction of 2.36 rad."""
    direction_rad = pytest.approx(0.75 * np.pi)
    assert wind_values((0.5, -0.5, 0.0), model="anemometer", max_value=2.0)[0][1] == direction_rad
    (speed_m_s, direction), is_saturated = wind_values((3.0, -3.0, 0.0), model="anemometer", max_value=2.0, bias=-0.5)
    assert (speed_m_s, direction, is_saturated) == (2.0, direction_rad, True)
    assert wind_values((0.5, -0.5, 0.0), model="anemometer", bias=-5.0)[0] == (0.0, direction_rad)


def test_three_axes_saturate_on_both_sides():
    assert wind_values((-9.0, 1.0, 7.0), model="anemometer_3d", max_value=5.0) == ((-5.0, 1.0, 5.0), True)


def test_a_resistance_stays_positive():
    spec = make_sensor_spec(model="tgs2600", name="s", bias=-1e6)
    sensor = build_sensor(SENSOR_MODELS["tgs2600"], spec, TICK_NS, stream(1, "test"))
    assert sensor.read(sample(0.0), STILL).values == (500.0,)


def test_units_differ_by_a_factor_that_their_stream_draws():
    factors = np.array([values([5.0], seed=seed, gain_spread=0.2)[0] / 5.0 for seed in range(400)])
    assert np.log(factors).mean() == pytest.approx(0.0, abs=0.03)
    assert np.log(factors).std() == pytest.approx(0.2, rel=0.1)
    assert values([5.0] * 3, gain_spread=0.2) == [values([5.0], gain_spread=0.2)[0]] * 3


def test_units_drift_each_at_its_rate():
    rates = np.array([np.diff(values([5.0] * 2, seed=seed, drift_spread_per_s=0.3))[0] / 0.1 for seed in range(400)])
    assert (rates.mean(), rates.std()) == (pytest.approx(0.0, abs=0.05), pytest.approx(0.3, rel=0.1))


def test_a_reading_is_a_multiple_of_the_resolution():
    assert values([0.04, 0.05, 0.14, 0.16, 7.0], resolution=0.1) == pytest.approx([0.0, 0.1, 0.1, 0.2, 7.0])


@pytest.mark.parametrize("model", sorted(name for name in SENSOR_MODELS if is_ideal(name)))
def test_an_ideal_instrument_has_no_errors_and_a_real_one_has(model):
    truth = sample(40.0, (1.0, 0.2, 0.1)).model_copy(update={"beam_m": 4.0})

    def shown(name, seed):
        sensor = build_sensor(
            SENSOR_MODELS[name], make_sensor_spec(model=name, name="s"), TICK_NS, stream(seed, "test")
        )
        return [sensor.read(truth, STILL).values for _ in range(20)]

    assert shown(model, 1) == shown(model, 2)
    assert shown(model.removesuffix("_ideal"), 1) != shown(model.removesuffix("_ideal"), 2)


def test_a_real_pid_shows_steps_behind_its_lag_and_hardly_ever_gas_in_clean_air():
    """Nine tenths of a step after 3 s, in steps of 0.1 ppm; 0.2 ppm is five standard deviations of noise away."""
    step = np.mean([values([10.0] * 61, model="pid", seed=seed) for seed in range(60)], axis=0)
    assert step[29] == pytest.approx(9.0, abs=0.2)
    clean = np.array(values([0.0] * 5000, model="pid"))
    assert set(np.round(clean, 6)) <= {0.0, 0.1}
    assert 0.01 < np.count_nonzero(clean) / len(clean) < 0.1


@pytest.mark.parametrize(
    ("lamp_ev", "ppm", "share"), [(11.7, 0.31, 0.05), (11.7, 0.47, 0.5), (11.7, 0.6, 0.9), (10.6, 1.19, 0.5)]
)
def test_a_real_pid_is_above_a_tenth_of_a_ppm_where_it_shows_two(lamp_ev, ppm, share):
    """In true mixing ratios of ethanol, as documented: the reading is divided by its factor and comes in steps."""
    settings = {"model": "pid", "gas": "ethanol", "lamp_ev": lamp_ev}
    shown = np.array([values([ppm] * 160, seed=seed, **settings)[60:] for seed in range(40)])
    assert np.mean(shown > 0.1) == np.mean(shown > 0.15) == pytest.approx(share, abs=0.07)


def test_a_real_mox_sensors_noise_is_a_share_of_its_resistance():
    ohm = np.array(values([0.0] * 3000, model="tgs2600", baseline_walk=0.0))
    assert np.log(ohm).std() == pytest.approx(0.003, rel=0.1)
    walks = np.array([np.log(values([0.0] * 101, model="tgs2600", seed=s, noise_frac=0.0)) for s in range(200)])
    assert (walks[:, -1] - walks[:, 0]).std() == pytest.approx(0.0004 * np.sqrt(10.0), rel=0.2)


def test_an_anemometer_shows_nine_tenths_of_a_change_after_its_lag():
    model = "anemometer_3d_ideal"
    spec = make_sensor_spec(model=model, name="s", t90_s=2.0)
    sensor = build_sensor(SENSOR_MODELS[model], spec, TICK_NS, stream(1, "test"))
    shown = [sensor.read(sample(0.0, (wind, 0.0, 0.0)), STILL).values[0] for wind in [1.0] + [2.0] * 20]
    assert shown[0] == 1.0
    assert shown[-1] == pytest.approx(1.9)
