"""Commands of the benchmark: suites from the plan to the report, and studies of methods."""

from gslcosim.cli.arguments import CommandFamily, CommandGroup
from gslcosim_bench.commands import failures, place, suites, sweep, tune

EXAMPLES = """  gslcosim bench list
  gslcosim bench plan gsl_bench_2023
  gslcosim bench run smoke
  gslcosim bench run methods --only entry=surge_cast,infotaxis --jobs 2
  gslcosim bench run gsl_bench_2023 --shard 2/8
  gslcosim bench report results/smoke
  gslcosim bench place my_suite.yaml --entry mine --against results/smoke
  gslcosim bench sweep tiny_room --entry dung_beetle --vary leg_m=0.4,0.8,1.6
  gslcosim bench failures surge_cast --budget 40"""

GROUPS = (
    CommandGroup(
        title="compare methods",
        commands=(
            CommandFamily(
                name="bench",
                summary="run suites of many trials, with statistics and a report",
                examples=EXAMPLES,
                is_computing=True,
                parts=(*suites.COMMANDS, place.COMMAND, sweep.COMMAND, tune.COMMAND, failures.COMMAND),
            ),
        ),
    ),
)
