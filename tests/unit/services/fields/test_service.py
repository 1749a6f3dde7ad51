"""Registration of the fields service: a host that joins with it needs the gas that it plays."""

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import RunSetup
from gslcosim_services.fields.service import SERVICE


def test_a_host_without_the_stored_gas_is_told_before_it_builds_the_service(tmp_path, make_scenario, make_room):
    stored = tmp_path / "film.npz"
    sources = [{"position_m": (5.0, 1.0, 2.0)}]
    gas = {"model": "playback", "sources": sources, "playback": {"folder": str(stored)}}
    setup = RunSetup(
        run_dir=RunDir(tmp_path),
        scenario=make_scenario(gas=gas),
        environment_dir=tmp_path,
        environment=make_room(),
    )
    with pytest.raises(UsageError, match=r"expected the stored gas on the host of fields, found none"):
        SERVICE.check_host(setup)
    stored.touch()
    SERVICE.check_host(setup)


def test_a_host_needs_no_files_for_gas_that_is_computed(tmp_path, make_scenario, make_room):
    setup = RunSetup(
        run_dir=RunDir(tmp_path), scenario=make_scenario(), environment_dir=tmp_path, environment=make_room()
    )
    SERVICE.check_host(setup)
