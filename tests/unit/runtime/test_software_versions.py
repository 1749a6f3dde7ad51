"""What a host has otherwise than the run is reported in one sentence."""

import pytest

from gslcosim.runtime.remote_server import SoftwareVersions

RUN = SoftwareVersions(
    version="0.3.0",
    contract="c" * 32,
    code="0" * 32,
    python="3.11",
    packages={"numpy": "1.26.4", "numba": "0.60.0"},
)


def test_the_same_software_is_taken():
    assert RUN.find_mismatch(RUN.model_copy()) == ""


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"version": "0.2.0"}, "gslcosim 0.3.0, which the run has, was 0.2.0"),
        ({"contract": "d" * 32}, f"contract {'c' * 32}, which the run speaks, was {'d' * 32}"),
        ({"python": "3.12"}, "Python 3.11, with which the run is flown, was 3.12"),
        ({"packages": {"numpy": "2.0.0"}}, "numpy 1.26.4 (here 2.0.0), numba 0.60.0 (here missing)"),
        ({"code": "1" * 32}, "000000000000, was 111111111111"),
    ],
)
def test_what_differs_is_reported(changed, expected):
    refusal = RUN.find_mismatch(RUN.model_copy(update=changed))
    assert expected in refusal
    assert "\n" not in refusal


def test_this_process_is_like_itself():
    here = SoftwareVersions.here()
    assert here.find_mismatch(SoftwareVersions.here()) == ""
    assert here.code != ""
