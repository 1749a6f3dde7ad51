import pytest
from mast_campaigns import write_campaign


@pytest.fixture(scope="session")
def yard(tmp_path_factory):
    """A folder of measured data with a leak at the well."""
    return write_campaign(tmp_path_factory.mktemp("data") / "our_yard")
