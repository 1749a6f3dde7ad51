"""What an agent may say about its contract, and what follows."""

import pytest

from gslcosim.base.errors import ContractError
from gslcosim.contract.messages import CONTRACT_VERSION, Command
from gslcosim.contract.schema import (
    ContractVersionError,
    build_json_schema,
    check_contract,
    format_own_contract,
    get_contract_hash,
)

MAJOR, MINOR = CONTRACT_VERSION.split(".")


@pytest.mark.parametrize(
    "contract_text",
    [
        CONTRACT_VERSION,
        f"{CONTRACT_VERSION}+{get_contract_hash()}",
        f"{MAJOR}.0",
        f"{MAJOR}.0+{'0' * 32}",
        f"{MAJOR}.{int(MINOR) + 7}+{'f' * 32}",
    ],
)
def test_every_minor_version_fits_whatever_its_hash(contract_text):
    check_contract(contract_text)


def test_we_fit_ourselves():
    check_contract(format_own_contract())


@pytest.mark.parametrize(
    "contract_text", [f"{int(MAJOR) + 1}.0", "0.9", f"{int(MAJOR) + 1}.{MINOR}+{get_contract_hash()}"]
)
def test_another_major_version_does_not_fit(contract_text):
    with pytest.raises(
        ContractVersionError, match=rf"expected major version {MAJOR} .*, was {contract_text.split('+')[0]}\."
    ):
        check_contract(contract_text)


def test_the_same_version_with_another_hash_is_reported():
    with pytest.raises(
        ContractError, match=f"expected hash {get_contract_hash()} for version {CONTRACT_VERSION}"
    ) as caught:
        check_contract(f"{CONTRACT_VERSION}+{'0' * 32}")
    assert not isinstance(caught.value, ContractVersionError)


@pytest.mark.parametrize(
    "contract_text", ["", "1", "v1.1", "1.1.0", "1.1+", "1.1+xyz", "1.1 ", "one", "\u0661.1", "-1.0"]
)
def test_anything_else_is_named_but_is_not_another_contract(contract_text):
    with pytest.raises(ContractError, match=r"expected MAJOR\.MINOR or") as caught:
        check_contract(contract_text)
    assert not isinstance(caught.value, ContractVersionError)


def test_what_only_the_recording_reads_is_no_part_of_the_hash():
    """The hash of contract 1.3: a change of what only the recording reads keeps it, and with it the digests of runs."""
    assert get_contract_hash() == "740cccca7cc2c4226bbe234e030c1109"
    assert "note" in build_json_schema(Command)["properties"]
