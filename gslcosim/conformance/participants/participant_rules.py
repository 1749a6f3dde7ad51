"""The rules that every participant keeps, in the order in which a session meets them."""

from gslcosim.conformance.rules import Rule

_ALL = (
    Rule(
        id="hello",
        sentence="starts, and says hello with the ports that it reads and writes",
        remedy="Run the command by itself and read its log. Send {tick: 0, reads: […], writes: […]} as the first "
        "frame, before anything comes, and flush it; over tcp and unix after {token: GSLCOSIM_TOKEN}.",
    ),
    Rule(
        id="ports",
        sentence="names ports that there are, and a word for each of its outputs",
        remedy="Take ports from docs/messages.md, or participant/NAME/PORT. Outputs are ventilation or a word of your "
        "own of lower-case letters, digits and _.",
    ),
    Rule(
        id="contract",
        sentence="says of its contract, if anything, what this gslcosim speaks",
        remedy="Build it with the contract that `gslcosim schema export` writes, or leave `contract` out.",
    ),
    Rule(
        id="answers",
        sentence="answers the inputs of each tick, in time",
        remedy="Send one ParticipantOutputs for each ParticipantInputs, and flush it: a buffered line is not sent. "
        "Raise answer_within_s in the scenario (--timeout here) where a step takes longer.",
    ),
    Rule(
        id="encoding",
        sentence="sends each frame as one map with texts as keys, of at most 1 MiB",
        remedy="Pack one map a frame, in the --format you have chosen. Over stdio nothing else may be written to the "
        "standard output: notes go to the standard error.",
    ),
    Rule(
        id="tick",
        sentence="answers with the tick of the inputs, as an integer",
        remedy="Copy tick from ParticipantInputs; do not count by yourself: ticks leap where the period is longer.",
    ),
    Rule(
        id="outputs",
        sentence="answers with each of its outputs, and no other",
        remedy="Write the map under every word of its hello, at each tick.",
    ),
    Rule(
        id="values",
        sentence="sends finite numbers and truth values, and a share of the wind of at least 0",
        remedy="Look for a division by zero or a mean of nothing; ventilation needs share, other outputs have names.",
    ),
    Rule(
        id="once",
        sentence="answers once, and says nothing that it is not asked",
        remedy="Send the answer in one place only, after the inputs have come.",
    ),
    Rule(
        id="stays",
        sentence="stays until the end of the run",
        remedy="Read the end of its log: it crashed, exited, or closed its output while the run went on.",
    ),
    Rule(
        id="ending",
        sentence="exits within 2 s after Ending",
        remedy="Leave the loop when Ending comes, and end threads that would keep the process alive.",
    ),
    Rule(
        id="exit-code",
        sentence="exits with code 0 after Ending",
        remedy="Let the program return normally; another code says that it failed.",
    ),
    Rule(
        id="leaves-nothing",
        sentence="leaves no process behind when it has ended",
        remedy="End each program that it has started, and wait for it.",
    ),
    Rule(
        id="restart",
        sentence="starts and steps a second time",
        remedy="Leave nothing behind that stands in the way of the next start: lock files, fixed ports, half files.",
    ),
    Rule(
        id="determinism",
        sentence="gives the same outputs again when briefing and inputs are the same",
        remedy="Draw random numbers from a generator seeded with the briefing's seed; use neither clock nor process "
        "id, nor files of earlier runs, nor the order of a hash table that differs from run to run.",
    ),
    Rule(
        id="unknown-fields",
        sentence="ignores fields and a later minor version that it does not know",
        remedy="Read the fields you need by name and pass over the rest: later versions of the contract add some.",
    ),
    Rule(
        id="missing-inputs",
        sentence="does without an input where there is no message yet",
        remedy="A port is missing from inputs before tick 0 where it has a delay, and between the periods of its "
        "writer: keep the last value, or begin with one of your own.",
    ),
    Rule(
        id="early-ending",
        sentence="exits with code 0 when the run ends before the first inputs",
        remedy="Wait for Ending wherever you wait for inputs.",
    ),
    Rule(
        id="stream-end",
        sentence="exits when the link to the run is lost",
        remedy="Leave when reading gives the end of the stream. Otherwise it is left over when a run is killed.",
    ),
)

PARTICIPANT_RULES = {rule.id: rule for rule in _ALL}
