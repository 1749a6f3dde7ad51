"""Whether an agent and a run understand each other: the rule of versions and hashes, in one place.

`docs/contract-evolution.md` has the rules; decision 0008 says why an agent tells its contract in its first command.
"""

import re

from gslcosim.contract.messages import CONTRACT_VERSION
from gslcosim.contract.schema import contract_hash
from gslcosim.errors import ContractError

_FORM = re.compile(r"(?P<major>\d{1,6})\.(?P<minor>\d{1,6})(?:\+(?P<hash>[0-9a-f]{32}))?", re.ASCII)


class OtherContractError(ContractError):
    """An agent was made for another major version of the contract; its author builds it again for this one."""


def spoken_contract() -> str:
    """Return what this code speaks, as an agent may tell it: version and hash."""
    return f"{CONTRACT_VERSION}+{contract_hash()}"


def check_contract(told: str) -> None:
    """Check what the other side says it speaks.

    Another minor version is fine in both directions: later fields are ignored or have defaults.

    Args:
        told: `MAJOR.MINOR`, or `MAJOR.MINOR+HASH`.

    Raises:
        OtherContractError: the major version is another one; nothing the other side says can be trusted.
        ContractError: not of that form, or the same version with another hash; the messages may still fit.
    """
    found = check_version(told, CONTRACT_VERSION)
    minor = CONTRACT_VERSION.split(".")[1]
    is_same = int(found["minor"]) == int(minor)
    if is_same and found["hash"] is not None and found["hash"] != contract_hash():
        raise ContractError(
            f"contract: expected hash {contract_hash()} for version {CONTRACT_VERSION}, was {found['hash']}. "
            "The agent was made with another build of the contract; `gslcosim schema export` writes this one's."
        )


def check_version(told: str, spoken: str) -> re.Match[str]:
    """Check the version in what the other side says it speaks, and return its parts: `major`, `minor`, `hash`.

    Args:
        told: `MAJOR.MINOR`, or `MAJOR.MINOR+HASH`.
        spoken: The version of this side.

    Raises:
        OtherContractError: the major version is another one.
        ContractError: not of that form.
    """
    found = _FORM.fullmatch(told)
    if found is None:
        raise ContractError(f"contract: expected MAJOR.MINOR or MAJOR.MINOR+HASH, was {told[:60]!r}.")
    major = spoken.split(".")[0]
    if int(found["major"]) != int(major):
        raise OtherContractError(
            f"contract: expected major version {major} (this run speaks {spoken}), was "
            f"{found['major']}.{found['minor']}. Build the agent with the contract of this gslcosim: "
            "`gslcosim schema export` writes it."
        )
    return found
