"""CSV and Markdown for tables with foreign text: cells that spreadsheets do not evaluate, and that are no markup."""

import csv
import html
import re
from collections.abc import Iterable, Sequence
from typing import Any, TextIO

from gslcosim.base.untrusted_input import escape_terminal_text

# Spreadsheets take a text that begins like this for a formula, in some languages also in full width, behind spaces, and
# where another separator than the comma is set. A sign or a dash alone is none.
_BLANKS = r"[\s'\"\u200b-\u200d\u2060]*"
_FORMULA = re.compile(rf"(?:^|(?<=[;\n\t]))(?:(?=\t)|(?={_BLANKS}[=+\-@\uff1d\uff0b\uff0d\uff20]\s*\S))")
_NUMBER = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[+-]?[0-9]+)?(?: ?%)?|inf|nan)", re.IGNORECASE)

# An underscore within a word is no markup. Neither addresses nor names before @ become links.
_MARKUP = re.compile(
    r"[\\`*|#~$@]|(?<![^\W_])_|_(?![^\W_])|(?<=:)/(?=/)|(?<=www)\.|\](?=\s*[(\[:])|(?<=!)\[", re.IGNORECASE
)
_CODE = re.compile(r"[\w ./:+,=|-]+")


class Markdown(str):
    """Text that is Markdown already, with foreign parts of it escaped."""

    __slots__ = ()


def neutralise_cell(value: Any) -> Any:
    r"""Return a value for CSV: text that a spreadsheet would evaluate begins with `'`, control characters are `\x1b`.

    Numbers stay as they are, also as text (`-0.5`).
    """
    if not isinstance(value, str) or _NUMBER.fullmatch(value):
        return value
    return _FORMULA.sub("'", escape_terminal_text(value))


def write_csv(file: TextIO, rows: Iterable[Iterable[Any]], *, line_end: str = "\r\n") -> None:
    """Write rows as CSV; numbers as Python writes them, which reads back to the bit."""
    csv.writer(file, lineterminator=line_end).writerows([neutralise_cell(value) for value in row] for row in rows)


def escape_markdown(text: str) -> str:
    """Return foreign text as Markdown of one line that shows it as it is: no HTML, links, pictures or other markup."""
    plain = escape_terminal_text(" ".join(text.split()))
    return html.escape(_MARKUP.sub(lambda sign: "\\" + sign[0], plain), quote=False)


def format_code(text: str) -> Markdown:
    """Return foreign text as inline code of a cell."""
    return Markdown(
        f"`{text}`".replace("|", "\\|") if _CODE.fullmatch(text) else f"<code>{escape_markdown(text)}</code>"
    )


def format_markdown_table(
    headings: Sequence[str], rows: Iterable[Sequence[Any]], *, rules: Sequence[str] | None = None
) -> list[str]:
    """Return the lines of a Markdown table; cells that are no `Markdown` are escaped, None is empty.

    Args:
        rules: What stands below the headings, such as `--:`; absent: `---`.
    """
    cells = ([_format_cell(value) for value in row] for row in rows)
    heads, rule, *others = (f"| {' | '.join(line)} |" for line in (headings, rules or ["---"] * len(headings), *cells))
    return [heads, rule.replace(" ", "") if rules else rule, *others]


def _format_cell(value: Any) -> str:
    if isinstance(value, Markdown):
        return str(value)
    return "" if value is None else escape_markdown(str(value))
