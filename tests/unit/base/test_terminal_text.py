"""No text of a stranger moves the cursor, sets a title, or ends a row."""

import json
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gslcosim.base.untrusted_input import escape_json_text, escape_terminal_text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain, ähnlich 場 ✓\tin a line\nand another", "plain, ähnlich 場 ✓\tin a line\nand another"),
        ("\x1b]0;owned\x07", r"\x1b]0;owned\x07"),
        ("\x1b[2J\x1b[H", r"\x1b[2J\x1b[H"),
        ("\x9b2J", r"\x9b2J"),
        ("100 %\rdone", r"100 %\x0ddone"),
        ("from a DOS file\r\nnext", "from a DOS file\nnext"),
        ("\u202egpj.exe\u2066", r"\u202egpj.exe\u2066"),
        ("a name of bytes \udcff", r"a name of bytes \udcff"),
    ],
)
def test_what_a_terminal_obeys_is_shown(text, shown):
    assert escape_terminal_text(text) == shown


def test_a_cell_stays_one_line():
    assert escape_terminal_text("a\nb\tc", is_one_line=True) == r"a\nb\tc"


@given(st.text(st.characters(codec=None)))
def test_no_control_character_is_left(text):
    shown = escape_terminal_text(text, is_one_line=True)
    assert not [c for c in shown if unicodedata.category(c) in ("Cc", "Cs")]
    assert escape_terminal_text(shown, is_one_line=True) == shown
    shown.encode()


@given(st.text(st.characters(codec=None)))
def test_json_stays_the_same_content(text):
    shown = escape_json_text(json.dumps([text], ensure_ascii=False))
    assert json.loads(shown) == [text]
    assert not [c for c in shown if unicodedata.category(c) in ("Cc", "Cs")]


def test_json_in_a_page_has_nothing_that_ends_a_script_element():
    content = {"a": "</script><!-- & \x1b\u2028"}
    text = escape_json_text(json.dumps(content, ensure_ascii=False), is_embedded=True)
    assert json.loads(text) == content
    assert not set(text) & set("<>&\x1b\u2028")
