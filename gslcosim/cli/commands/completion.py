"""`gslcosim completion`: the script by which a shell completes words, and the candidates at the cursor.

The script runs gslcosim itself with `_ARGCOMPLETE` in the environment and reads its output, so that the words are
always those of the installed version, folder and packages. argcomplete handles the shells, and finds the argument at
the cursor.
"""

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from gslcosim.cli.arguments import Command, CommandFamily, CommandGroup, FindWords, Parser, command_parsers
from gslcosim.cli.completion_words import COMPLETIONS
from gslcosim.cli.terminal import write

SHELLS = ("bash", "zsh", "fish")
EXAMPLES = """  gslcosim completion bash > ~/.local/share/bash-completion/completions/gslcosim
  gslcosim completion zsh > ~/.zfunc/_gslcosim     where fpath has that folder
  gslcosim completion fish > ~/.config/fish/completions/gslcosim.fish"""


def complete(parser: argparse.ArgumentParser, groups: Sequence[CommandGroup]) -> None:
    """Answer a shell's request for words, on the descriptor that its script reads, and end the process."""
    import argcomplete

    for family in (each for group in groups for each in group.commands if isinstance(each, CommandFamily)):
        for part in family.parts:
            if part.name == family.default:
                _add_options(command_parsers(parser)[family.name], part)
    for action, sources in _pair_with_sources(parser):
        action.completer = _build_completer(sources)
    nothing: Any = _build_completer(())
    argcomplete.autocomplete(parser, always_complete_options=False, default_completer=nothing)


# The options of the default part.
def _add_options(parser: argparse.ArgumentParser, part: Command) -> None:
    options = argparse.ArgumentParser(add_help=False)
    part.add_arguments(options)
    for action in options._actions:
        if action.option_strings:
            parser._add_action(action)


def _pair_with_sources(parser: argparse.ArgumentParser) -> Iterator[tuple[Any, Sequence[FindWords]]]:
    own = parser.completes if isinstance(parser, Parser) else {}
    for action in (each for each in parser._actions if not each.choices):
        keys = (*action.option_strings, str(action.metavar))
        if found := next((words[key] for words in (own, COMPLETIONS) for key in keys if key in words), None):
            yield action, found
    for below in command_parsers(parser).values():
        yield from _pair_with_sources(below)


def _build_completer(sources: Sequence[FindWords]) -> Callable[..., Iterable[str]]:
    def find(prefix: str, parsed_args: argparse.Namespace, **_: Any) -> Iterable[str]:
        return [word for source in sources for word in source(prefix, parsed_args)]

    return find


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help=f"{', '.join(SHELLS[:-1])} or {SHELLS[-1]}")


def _run(arguments: argparse.Namespace) -> int:
    from argcomplete.shell_integration import shellcode

    # Bash would offer file names where no word fits.
    write(shellcode(["gslcosim"], shell=arguments.shell, complete_arguments=["-o", "nospace"]).strip())
    return 0


COMMAND = Command(
    name="completion",
    summary=("print the script for completion of commands, options, scenarios, suites, methods and runs"),
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
