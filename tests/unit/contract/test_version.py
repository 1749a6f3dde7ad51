"""What an agent may say about its contract, and what follows."""

import pytest
from contract_hash import build_hashed_schema

from gslcosim.base.errors import ContractError
from gslcosim.contract.messages import Command
from gslcosim.contract.record import get_pydantic_model
from gslcosim.contract.version import (
    CONTRACT_HASH,
    CONTRACT_VERSION,
    ContractVersionError,
    check_contract,
)

MAJOR, MINOR = CONTRACT_VERSION.split(".")


@pytest.mark.parametrize(
    "contract_text",
    [
        CONTRACT_VERSION,
        f"{CONTRACT_VERSION}+{CONTRACT_HASH}",
        f"{MAJOR}.0",
        f"{MAJOR}.0+{'0' * 32}",
        f"{MAJOR}.{int(MINOR) + 7}+{'f' * 32}",
    ],
)
def test_every_minor_version_fits_whatever_its_hash(contract_text):
    check_contract(contract_text)


@pytest.mark.parametrize("contract_text", [f"{int(MAJOR) + 1}.0", "0.9", f"{int(MAJOR) + 1}.{MINOR}+{CONTRACT_HASH}"])
def test_another_major_version_does_not_fit(contract_text):
    with pytest.raises(
        ContractVersionError, match=rf"expected major version {MAJOR} .*, was {contract_text.split('+')[0]}\."
    ):
        check_contract(contract_text)


def test_the_same_version_with_another_hash_is_reported():
    with pytest.raises(ContractError, match=f"expected hash {CONTRACT_HASH} for version {CONTRACT_VERSION}") as caught:
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
    """A change of what only the recording reads keeps the hash, and with it the digests of runs."""
    assert "note" in get_pydantic_model(Command).model_json_schema()["properties"]
    assert not build_hashed_schema(Command)["properties"].keys() & {"note"}
