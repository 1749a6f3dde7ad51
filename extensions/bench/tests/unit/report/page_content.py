"""What stands on a page, read back from its HTML."""

import json
import re
from html.parser import HTMLParser


class Page(HTMLParser):
    """Ids, links, tags, and cells of the leaderboard by view and entry."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.html, self.ids, self.links, self.tags, self.text = html, [], [], set(), []
        self.labelled_by: list[str] = []
        self.board: dict[tuple[str, str], list[dict]] = {}
        self._view = self._row = None
        self._in_board = self._in_cell = False
        self._skipped = 0
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.add(tag)
        self.ids += [attributes["id"]] if "id" in attributes else []
        self.labelled_by += [attributes["aria-labelledby"]] if "aria-labelledby" in attributes else []
        self.links += [attributes[key] for key in ("href", "src") if key in attributes]
        self._skipped += tag in ("script", "style")
        if tag == "table":
            self._in_board = "board" in attributes.get("class", "")
        elif tag == "tbody" and self._in_board:
            self._view = attributes["data-view"]
        elif tag == "tr":
            self._row = [] if self._in_board and self._view is not None else None
        elif tag in ("td", "th") and self._row is not None:
            self._row.append({"v": attributes.get("data-v"), "title": attributes.get("title"), "text": ""})
            self._in_cell = True

    def handle_endtag(self, tag):
        self._skipped -= tag in ("script", "style")
        if tag in ("td", "th"):
            self._in_cell = False
        elif tag == "tr" and self._row:
            self.board[self._view, self._row[1]["v"]] = self._row
            self._row = None
        elif tag == "table":
            self._in_board, self._view = False, None

    def handle_data(self, data):
        if not self._skipped:
            self.text.append(data)
        if self._in_cell and self._row:
            self._row[-1]["text"] += data


def data_of(html: str) -> dict:
    """Return the JSON that the page's plots are drawn from."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.S)[1])
