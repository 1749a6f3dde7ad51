"""Sandbox of an agent's processes, and the limits of what they may use."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from gslcosim.scenario.models.base import Positive, Spec, broken_rule_error

# What a run gives its processes there.
_OUR_PREFIX = "GSLCOSIM_"


def _without_ours(variables: "dict[str, str | None]") -> "dict[str, str | None]":
    if ours := next((name for name in variables if name.startswith(_OUR_PREFIX)), None):
        raise broken_rule_error(
            key=ours,
            expected="variables of the agent's own",
            found=f"one that begins with {_OUR_PREFIX}",
            remedy="gslcosim sets those itself. Leave it out.",
        )
    return variables


EnvironmentVariables = Annotated[
    dict[
        Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,127}$")],
        Annotated[str, Field(max_length=32_768, pattern=r"^[^\x00]*$")] | None,
    ],
    Field(max_length=100),
    AfterValidator(_without_ours),
]

SandboxChoice = Literal["auto", "required", "bubblewrap", "landlock", "none"]


class AgentLimitsSpec(Spec):
    """The bounds of what an agent's processes use together; to reach one is the agent's failure.

    `cpu_s` is processor time [s], `memory_mb` is memory held [MB], `n_processes` is how many run at once. `n_files` is
    how many files each process has open at once: it gets an error where it opens more. Absent: no bound.
    """

    cpu_s: Positive | None = Field(default=None, description="processor time")
    memory_mb: Annotated[float, Field(ge=8)] | None = Field(
        default=None, description="memory held, in MB; what processes share counts for each"
    )
    n_files: Annotated[int, Field(ge=16, le=1_000_000)] | None = Field(
        default=None, description="files that each process has open at once"
    )
    n_processes: Annotated[int, Field(ge=1, le=100_000)] | None = Field(
        default=None, description="processes that run at once"
    )

    @property
    def are_given(self) -> bool:
        """True if there is any bound."""
        return any(value is not None for value in (self.cpu_s, self.memory_mb, self.n_files, self.n_processes))
