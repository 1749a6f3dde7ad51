"""Escaping of foreign text, so that a terminal shows it and does not obey it."""

import re

# Control characters (C0 without tab and line feed, delete, C1), what reorders or breaks lines, and lone surrogates,
# which are bytes of file names that are no UTF-8 and which no stream takes.
_UNSAFE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ufff9-\ufffb\ud800-\udfff]"
)
_LINE_BREAK = re.compile("[\n\t]")


def escape_terminal_text(text: str, *, is_one_line: bool = False) -> str:
    r"""Return text with each character that a terminal would obey in place of showing it as `\x1b` or `\u202e`.

    Args:
        text: Any text.
        is_one_line: Whether line feeds and tabs are escaped too, as for a cell of a table.
    """
    escaped = _UNSAFE.sub(_escape_character, text.replace("\r\n", "\n"))
    return _LINE_BREAK.sub(_escape_character, escaped) if is_one_line else escaped


def escape_json_text(text: str) -> str:
    r"""Return JSON with the same characters as JSON's own escapes (`\u001b`): it stays the same content."""
    return _UNSAFE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def _escape_character(found: re.Match[str]) -> str:
    code = ord(found[0])
    if found[0] in "\n\t":
        return "\\n" if found[0] == "\n" else "\\t"
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
