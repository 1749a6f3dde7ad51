"""Text of others in tables: no cell is a formula, no Markdown is markup, and numbers stay numbers."""

import csv
import io
import re

import pytest
from markdown_it import MarkdownIt

from gslcosim_data.text_tables import (
    Markdown,
    escape_markdown,
    format_code,
    format_markdown_table,
    neutralise_cell,
    write_csv,
)

FORMULAS = [
    "=HYPERLINK(1)", "+1+cmd|' /C calc'!A0", "-2+3+cmd|' /C calc'!A0", "@SUM(1)", "\t=1+1", "\r=1+1", "\n=1+1",
    "  =1+1", "\u00a0=1+1", "\u3000=1+1", "\u200b=1+1", "\ufeff=1+1", '"=1+1',
    "\uff1d1+1", "\uff0b1+1", "\uff0d1+1", "\uff20SUM(1)",
    "= 1", "- found", "\ttab", "a;=1+1", "a;\t=1+1", "a\n=1+1", "a\t=1+1", "a; \"=1+1", "-1;=2", "-0x1", "1\n-2+x",
]  # fmt: skip
HARMLESS = [
    "", "-", "beetle", "a = b", "x-y", "ada@example.org", "3 - 2", "-0.5", "+1e-3", "-12 %", "-inf", ".5", "a; b",
    "a, -b",
    "gslcosim bench show results --trial 1",
]  # fmt: skip
MARKUP = [
    "<script>alert(1)</script>", "<img src=x onerror=alert(2)>", "&lt;b&gt;", "&#60;b&#62;", "[a](javascript:alert(1))",
    "![a](https://evil.example/x.png)", "![a][b]", "[a]: javascript:alert(1)", "[a] (b)", "<https://evil.example>",
    "https://evil.example", "www.evil.example", "**b**", "_b_", "__b__", "*b*", "~~b~~", "`code`", "``a`b``",
    "a | b", "a || b",
    "\\", "\\*b\\*", "\\|", "a\\", "\\](javascript:1)", "[[a](b)](c)", "# head", "<!-- a", "a  \nb", "$x$",
    "ada@evil.example",
]  # fmt: skip
MARKDOWN = MarkdownIt("commonmark", {"html": True}).enable(["table", "strikethrough"])


@pytest.mark.parametrize("text", FORMULAS)
def test_no_separator_of_any_locale_leaves_a_cell_that_is_evaluated(text: str) -> None:
    file = io.StringIO()
    write_csv(file, [["head", text], ["=HEAD()", 1.0]])
    (_, written), (head, _) = csv.reader(io.StringIO(file.getvalue()))
    assert head == "'=HEAD()"
    for cell in re.split(r"[;\n\t]", written):
        plain = cell.strip('\u00a0\u3000\u200b "')
        assert not re.match(r"[=+@\uff1d\uff0b\uff0d\uff20-]\s*\S", plain) or re.fullmatch(r"-\d", plain), (
            cell,
            written,
        )
    assert not re.search("[\x00-\x08\x0b-\x1f\ufeff]", written)


@pytest.mark.parametrize("text", HARMLESS)
def test_other_text_is_written_as_it_is(text: str) -> None:
    assert neutralise_cell(text) == text


def test_numbers_stay_numbers_to_the_bit() -> None:
    values = [-1.5, 0.1 + 0.2, -3, True, None, float("-inf")]
    assert [neutralise_cell(value) for value in values] == values
    file = io.StringIO()
    write_csv(file, [values[:3]], line_end="\n")
    assert [float(cell) for cell in file.getvalue().split(",")] == values[:3]


def test_what_a_terminal_obeys_is_escaped() -> None:
    assert neutralise_cell("\x1b[31mred\u202e") == "\\x1b[31mred\\u202e"
    assert "\x1b" not in escape_markdown("\x1b]0;title\x07")


@pytest.mark.parametrize("text", MARKUP)
@pytest.mark.parametrize("form", [escape_markdown, format_code], ids=["text", "code"])
def test_markdown_shows_foreign_text_as_it_is(text: str, form) -> None:
    """In a cell and on a line of its own: the same columns, no element but code, and the text itself."""
    cell = form(text)
    page = MARKDOWN.render("\n".join(format_markdown_table(("a", "b"), [(Markdown(cell), "end")])))
    assert page.count("<td>") == 2
    assert "<td>end</td>" in page
    for html in (page, MARKDOWN.render(f"- it is {cell}")):
        assert not re.search(r"<(?!/?(table|thead|tbody|tr|th|td|code|ul|li|p)>)", html), html
        assert not re.search(r"<script|<img|<a ", cell)
    if form is format_code and "|" in text:
        return
    # GitHub makes links of these wherever they stand.
    assert not re.search(r"://|www\.|(?<!\\)@", re.sub("^`.*`$", "", cell))
    shown = MARKDOWN.render(f"it is {cell}")
    plain = re.sub(r"</?(p|code)>", "", shown).strip().removeprefix("it is ")
    for entity, character in (("&lt;", "<"), ("&gt;", ">"), ("&quot;", '"'), ("&amp;", "&")):
        plain = plain.replace(entity, character)
    assert plain == " ".join(text.split())
