"""What a host computes with, and how that of two hosts differs."""

import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

import gslcosim
from gslcosim._code_identity import COMPUTING_PACKAGES, deciding_code_hash
from gslcosim.contract.schema import contract_hash

# Printed here, and written by another host.
_Word = Annotated[str, StringConstraints(pattern=r"^[ -~]{0,200}$")]
_PACKAGES = (*COMPUTING_PACKAGES, "eclipse-zenoh")


class Software(BaseModel):
    """All that has to be the same on the hosts of a run, so that it has the digest that it has on one.

    `code` is a hash of gslcosim's own code without comments and layout, `contract` that of the messages. `processor`
    is told and not compared: on another one the last bits of a result may be others.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    version: _Word
    contract: _Word
    code: _Word
    python: _Word
    packages: Annotated[dict[_Word, _Word], Field(max_length=200)]
    processor: _Word

    @classmethod
    @cache
    def here(cls) -> "Software":
        """Return what this process computes with; the first time after a change of code takes seconds."""
        # Slow to import, and needed by nobody else here.
        from llvmlite.binding import get_host_cpu_name  # pyright: ignore[reportMissingTypeStubs]

        return cls(
            version=gslcosim.__version__,
            contract=contract_hash(),
            code=deciding_code_hash(),
            python=f"{sys.version_info[0]}.{sys.version_info[1]}",
            packages={name: _version(name) for name in _PACKAGES},
            processor=get_host_cpu_name(),
        )

    def refusal_of(self, here: "Software") -> str:
        """Return in one sentence what another host has otherwise; empty where nothing of it matters.

        Args:
            here: What the other host has; `self` is that of the run.
        """
        if here.version != self.version:
            return f"expected gslcosim {self.version}, which the run has, was {here.version}."
        if here.contract != self.contract:
            return f"expected contract {self.contract}, which the run speaks, was {here.contract}."
        if here.python != self.python:
            return f"expected Python {self.python}, with which the run is flown, was {here.python}."
        others = [
            f"{name} {wanted} (here {here.packages.get(name, 'missing')})"
            for name, wanted in self.packages.items()
            if here.packages.get(name) != wanted
        ]
        if others:
            return f"expected the packages of the run, {', '.join(others)}."
        if here.code != self.code:
            return (
                f"expected gslcosim's code as the run has it, {self.code[:12]}, was {here.code[:12]}: it was changed."
            )
        return ""


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"
