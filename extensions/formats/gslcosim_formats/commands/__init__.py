"""Command family `environment`: generate, import, export and sample."""

from gslcosim.cli.arguments import CommandFamily, CommandGroup
from gslcosim_formats.commands import export, generate, import_, sample

ENVIRONMENT = CommandFamily(
    name="environment",
    summary="generate, import and export environments (rooms with their wind); sample gas or wind in them",
    examples="  gslcosim environment generate warehouse_complex\n"
    "  gslcosim environment import environments/001 --out gsl_bench_001\n"
    "  gslcosim environment export hall --to gaden --out hall_gaden",
    parts=(generate.COMMAND, import_.COMMAND, export.COMMAND, sample.COMMAND),
)
GROUPS = (CommandGroup(title="environments", commands=(ENVIRONMENT,)),)
