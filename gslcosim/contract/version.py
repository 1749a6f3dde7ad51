"""Version and hash of the contract, and the check of the contract that the other side states.

`docs/contract-evolution.md` has the rules; decision 0008 explains why an agent's first command states its contract.
"""

import re

from gslcosim.base.errors import ContractError

CONTRACT_VERSION = "1.3"
# Of the canonical JSON Schemas of all messages without prose, equal in processes with the same contract;
# `make contract` writes it, because computing it takes a tenth of a second in every process.
CONTRACT_HASH = "740cccca7cc2c4226bbe234e030c1109"
_CONTRACT_PATTERN = re.compile(r"(?P<major>\d{1,6})\.(?P<minor>\d{1,6})(?:\+(?P<hash>[0-9a-f]{32}))?", re.ASCII)


class ContractVersionError(ContractError):
    """An agent was made for another major version of the contract; its author has to build it again for this one."""


def format_own_contract() -> str:
    """Return the contract of this code as an agent may state it: version and hash."""
    return f"{CONTRACT_VERSION}+{CONTRACT_HASH}"


def check_contract(stated: str) -> None:
    """Check the contract that the other side states.

    Another minor version is compatible in both directions: later fields are ignored or have defaults.

    Args:
        stated: `MAJOR.MINOR`, or `MAJOR.MINOR+HASH`.

    Raises:
        ContractVersionError: the major version is another one; no message of the other side can be trusted.
        ContractError: not of that form, or the same version with another hash; the messages may still fit.
    """
    found = check_version(stated, CONTRACT_VERSION)
    minor = CONTRACT_VERSION.split(".")[1]
    is_same = int(found["minor"]) == int(minor)
    if is_same and found["hash"] is not None and found["hash"] != CONTRACT_HASH:
        raise ContractError(
            f"contract: expected hash {CONTRACT_HASH} for version {CONTRACT_VERSION}, was {found['hash']}. "
            "The agent was made with another build of the contract; `gslcosim schema export` writes this one's."
        )


def check_version(stated: str, own: str) -> re.Match[str]:
    """Check the version that the other side states; return its parts: `major`, `minor`, `hash`.

    Args:
        stated: `MAJOR.MINOR`, or `MAJOR.MINOR+HASH`.
        own: The version of this side.

    Raises:
        ContractVersionError: the major version is another one.
        ContractError: not of that form.
    """
    found = _CONTRACT_PATTERN.fullmatch(stated)
    if found is None:
        raise ContractError(f"contract: expected MAJOR.MINOR or MAJOR.MINOR+HASH, was {stated[:60]!r}.")
    major = own.split(".")[0]
    if int(found["major"]) != int(major):
        raise ContractVersionError(
            f"contract: expected major version {major} (this run speaks {own}), was "
            f"{found['major']}.{found['minor']}. Build the agent with the contract of this gslcosim: "
            "`gslcosim schema export` writes it."
        )
    return found
