"""Readers for foreign JSON and arrays, bounded in size, and escaping of foreign text for terminals.

Whatever a file of JSON or of rows contains, its reader gets values of the requested types, or one error that names the
file, the place in it and the expected value. Types are those of `typing`: a `TypedDict` for an object, whose further
keys are ignored, `list[float]`, `str | None`.
"""

import contextlib
import json
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from gslcosim.base.errors import UsageError, describe_os_error
from gslcosim.base.files import open_regular_file, read_regular_file

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from pydantic import ValidationError
    from pydantic_core import ErrorDetails

T = TypeVar("T")
JsonObject = dict[str, Any]
"""The type of an object without further requirements."""

MAX_LEVELS = 64
"""Depth to which lists and objects may be nested; ours are six deep."""

MAX_BYTES = 64_000_000
"""Default limit on the size of a file, or of a line of one."""

FROM_A_COPY = "Take the file from a copy."
_MAX_SHOWN, _MAX_REPORTED = 60, 20
_STRING = re.compile(rb'"(?:[^"\\]|\\.)*"?', re.DOTALL)
_BRACKET = re.compile(rb"[\[\]{}]")
# More digits than 64 bits have: no such number is ours, and Python is slow at thousands of digits.
_LONG_NUMBER = re.compile(rb"(?<![\d.eE+-])-?\d{21,}(?![\d.eE])")
_REPORTED_PLACE = re.compile(r"^(?P<what>.*?)(?: - at `(?:key in )?\$(?P<place>.*)`)?$", re.DOTALL)
_KINDS = {
    "str": "a text", "int": "a whole number", "float": "a number", "bool": "true or false", "object": "a block",
    "array": "a list", "null": "nothing",
}  # fmt: skip
MAX_UNPACKED_BYTES = 1 << 30
"""Default limit on the size of all arrays of a file."""

# Control characters (C0 without tab and line feed, delete, C1), characters that reorder or break lines, and lone
# surrogates, which stand for bytes of file names that are not UTF-8 and which no stream accepts.
_UNSAFE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ufff9-\ufffb\ud800-\udfff]"
)
_UNSAFE_IN_PAGE = re.compile(f"{_UNSAFE.pattern}|[&<>]")
_LINE_BREAK = re.compile("[\n\t]")


class MalformedFileError(UsageError):
    """A foreign file is malformed; the user restores it, or leaves it out."""


def read_json(path: Path, kind: type[T], *, remedy: str = FROM_A_COPY, max_bytes: int = MAX_BYTES) -> T:
    """Return the content of a JSON file."""
    with _reporting_file(path, remedy):
        return parse_json(read_regular_file(path, max_bytes=max_bytes), kind, place=_name_file(path))


def read_json_lines(path: Path, kind: type[T], *, remedy: str = FROM_A_COPY, max_bytes: int = MAX_BYTES) -> Iterator[T]:
    """Yield the values of a file of JSON lines; a last line without a line feed is ignored."""
    place = _name_file(path)
    with _reporting_file(path, remedy), open_regular_file(path) as file:
        for number, line in enumerate(iter(lambda: file.readline(max_bytes + 1), b""), 1):
            if len(line) > max_bytes:
                raise MalformedFileError(f"{place}:{number}: expected at most {max_bytes} bytes, was more.")
            if line.endswith(b"\n"):
                yield parse_json(line, kind, place=f"{place}:{number}")


def _name_file(path: Path) -> str:
    return f"{path.parent.name}/{path.name}"


@contextlib.contextmanager
def _reporting_file(path: Path, remedy: str) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError as error:
        folder = path.parent.name or path.resolve().parent.name
        raise MalformedFileError(f"{folder}: expected a folder with {path.name}, found none.\nFile: {path}") from error
    except OSError as error:
        found = f"expected a file that can be read, was {describe_os_error(error)}."
        raise MalformedFileError(f"{_name_file(path)}: {found} {remedy}\nFile: {path}") from error
    except MalformedFileError as error:
        raise MalformedFileError(f"{error} {remedy}\nFile: {path}") from error


def read_npz(path: Path, *, max_bytes: int = MAX_UNPACKED_BYTES) -> "dict[str, NDArray[Any]]":
    """Return the arrays of a `.npz` file by their names."""
    import numpy as np

    try:
        with open_regular_file(path) as file, zipfile.ZipFile(file) as archive:
            n_bytes = sum(member.file_size for member in archive.infolist())
            if n_bytes > max_bytes:
                raise ValueError(f"expected at most {max_bytes >> 20} MB of arrays, was {n_bytes >> 20} MB")
            arrays: dict[str, NDArray[Any]] = {}
            for member in archive.infolist():
                with archive.open(member) as content:
                    array = np.lib.format.read_array(content, allow_pickle=False)
                    if content.read(1):
                        raise ValueError(f"{member.filename}: expected one array, was more")
                arrays[member.filename.removesuffix(".npy")] = array
            return arrays
    # A malformed file raises any error of zipfile, zlib or the header's parser; a header may claim any size.
    except (OSError, ValueError):
        raise
    except Exception as error:
        raise ValueError(str(error) or type(error).__name__) from error


def parse_json(data: bytes | str, kind: type[T], *, place: str) -> T:
    """Return the value of a JSON text."""
    raw = data if isinstance(data, bytes) else data.encode(errors="surrogatepass")
    _check_levels(raw, place)
    try:
        value = json.loads(data.decode("utf-8-sig") if isinstance(data, bytes) else data)
    except UnicodeDecodeError as error:
        raise MalformedFileError(f"{place}: expected UTF-8 text, was something else.") from error
    except json.JSONDecodeError as error:
        raise MalformedFileError(
            f"{place}: expected JSON, was text that cannot be read (line {error.lineno}, column {error.colno}: "
            f"{error.msg[:1].lower()}{error.msg[1:]})."
        ) from error
    return validate_value(value, kind, place=place)


def validate_value(value: object, kind: type[T], *, place: str) -> T:
    """Return a plain value of JSON as it is, if it has the requested type."""
    # Commands that list runs avoid this import, and start sooner.
    if kind == JsonObject:
        if isinstance(value, dict):
            return cast("T", value)
        raise MalformedFileError(f"{place}: expected a block, was {_kind_of(value)}.")
    import msgspec

    try:
        msgspec.convert(value, kind)
    except (msgspec.ValidationError, OverflowError) as error:
        raise MalformedFileError(_describe_problem(str(error), place)) from error
    except UnicodeEncodeError as error:
        # JSON can escape half a surrogate pair, which no text can contain.
        raise MalformedFileError(f"{place}: expected text, was half of a surrogate pair in it.") from error
    return cast("T", value)


def describe_validation_errors(error: "ValidationError") -> list[str]:
    """Return the problems found by pydantic, one per line: `boxes[0].rgba: expected a valid list, was 'x'`."""
    return [_described(each) for each in error.errors(include_url=False, include_context=False)[:_MAX_REPORTED]]


def _described(problem: "ErrorDetails") -> str:
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in problem["loc"]).removeprefix(".")
    if problem["type"] == "missing":
        return f"{place}: expected a value, was missing"
    wanted = problem["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    found = repr(problem["input"])
    return f"{place}: expected {wanted}, was {found if len(found) <= _MAX_SHOWN else f'{found[:_MAX_SHOWN]}...'}"


# Checked before anything is built, so that neither Python's reader nor a later writer recurses that deep.
def _check_levels(raw: bytes, place: str) -> None:
    n_levels = 0
    plain = _STRING.sub(b"", raw)
    for bracket in _BRACKET.findall(plain):
        n_levels += 1 if bracket in b"[{" else -1
        if n_levels > MAX_LEVELS:
            raise MalformedFileError(f"{place}: expected lists and blocks at most {MAX_LEVELS} deep, was a deeper one.")
    if _LONG_NUMBER.search(plain):
        raise MalformedFileError(f"{place}: expected numbers of at most 20 digits, was a longer one.")


# Turns msgspec's "Expected `str`, got `int` - at `$.agents[0].name`" into place, expected and found.
def _describe_problem(text: str, place: str) -> str:
    match = cast("re.Match[str]", _REPORTED_PLACE.match(text))
    inner = (match["place"] or "").removeprefix(".")
    where = f"{place}: {inner}" if inner else place
    what = re.sub(r"`([^`]*)`", _shown_kind, match["what"])
    if missing := re.match(r"Object missing required field (.*)", what):
        return f"{where}: expected the key {missing[1]}, was missing."
    expected, got, found = what.removeprefix("Expected ").partition(", got ")
    return f"{where}: expected {expected}, was {found if got else 'another one'}."


def _shown_kind(found: re.Match[str]) -> str:
    return " or ".join(_KINDS.get(kind, kind) for kind in found[1].split(" | "))


def _kind_of(value: object) -> str:
    kinds = ((bool, "bool"), (str, "str"), (int, "int"), (float, "float"), (dict, "object"), (list, "array"))
    return _KINDS[next((name for kind, name in kinds if isinstance(value, kind)), "null")]


def escape_terminal_text(text: str, *, is_one_line: bool = False) -> str:
    r"""Return text with each character that a terminal would interpret escaped as `\x1b` or `\u202e`.

    Args:
        text: Any text.
        is_one_line: Whether to escape line feeds and tabs too, as for a cell of a table.
    """
    escaped = _UNSAFE.sub(_escape_character, text.replace("\r\n", "\n"))
    return _LINE_BREAK.sub(_escape_character, escaped) if is_one_line else escaped


def escape_json_text(text: str, *, is_embedded: bool = False) -> str:
    r"""Return JSON with the same characters in JSON's own escapes (`\u001b`): its content is unchanged.

    Args:
        text: JSON.
        is_embedded: Whether to escape `&`, `<` and `>` too, so that a script element of a page can hold it.
    """
    unsafe = _UNSAFE_IN_PAGE if is_embedded else _UNSAFE
    return unsafe.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def _escape_character(found: re.Match[str]) -> str:
    code = ord(found[0])
    if found[0] in "\n\t":
        return "\\n" if found[0] == "\n" else "\\t"
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
