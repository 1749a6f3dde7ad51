"""Stored gas as the gas of a scenario."""

import gaden_writers as gaden
import numpy as np
import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_services.fields.gas_field import PointGrid

SOURCE_M = (2.0, 5.0, 2.0)


@pytest.fixture
def played(tmp_path, make_scenario, make_room):
    """Build the gas of a scenario that plays GADEN's frames 0 and 2."""
    for i in (0, 2):
        (tmp_path / f"iteration_{i}").write_bytes(gaden.compressed(gaden.version_3()))

    def build(*, gas="methane", source_m=gaden.SOURCE_M, **playback):
        settings = {
            "model": "playback", "gas": gas, "sources": [{"position_m": source_m}],
            "playback": {"folder": str(tmp_path), **playback},
        }  # fmt: skip
        return build_gas_field(make_scenario(gas=settings), make_room())

    return build


def test_frames_are_played_at_their_period(played):
    inside_m = gaden.POSITIONS_M[:1]
    field = played(period_s=1.0)
    assert field.mixing_ratio_ppm_at(inside_m)[0, 0] == pytest.approx(10.0, rel=1e-5)
    np.testing.assert_allclose(field.filaments.sigma_m, gaden.SIGMAS_CM / 100)
    field.advance(25)
    assert field.mixing_ratio_ppm_at(inside_m)[0, 0] == pytest.approx(10.0, rel=1e-5)
    field.reset(5)
    assert field.step == 0


def test_stored_gas_of_another_name_or_place_is_refused(played):
    with pytest.raises(ScenarioError, match=r"gas\.gas: expected methane, the gas of the stored frames, was ethanol"):
        played(gas="ethanol")
    with pytest.raises(ScenarioError, match=r"gas\.sources\[0\]\.position_m: .* Write position_m: \[0\.5, 3, 1\]\."):
        played(source_m=(5.0, 5.0, 2.0))


def test_a_film_can_be_played(tmp_path, make_scenario, make_room):
    ppm = np.zeros((2, 30, 20, 1))
    ppm[1, 8, 10] = 7.0
    path = tmp_path / "film.npz"
    np.savez(path, time_s=[0.0, 1.0], mixing_ratio_ppm=ppm[..., 0], origin_m=np.zeros(3), cell_m=0.5)
    gas = {"model": "playback", "sources": [{"position_m": SOURCE_M}], "playback": {"folder": str(path)}}
    field = build_gas_field(make_scenario(gas=gas), make_room())
    place = np.array([(4.2, 5.2, 2.0)])
    values = []
    for _ in range(3):
        values.append(field.mixing_ratio_ppm_at(place)[0, 0])
        field.advance(5)
    assert values == [0.0, 0.0, 7.0]
    slice_ = field.mixing_ratio_ppm_on_grid(
        PointGrid(first_m=(0.25, 0.25, 1.0), spacing_m=0.5, shape=(30, 20, 1)), cutoff_sigma=3.0
    )
    assert np.argwhere(slice_).tolist() == [[8, 10, 0]]
