"""Jinja environment of the templates of pages and of Markdown files."""

from collections.abc import Sequence
from pathlib import Path

import jinja2

from gslcosim_bench.report.number_formats import format_duration
from gslcosim_data.text_tables import escape_markdown, format_code


def build_environment(folders: Sequence[Path], *, is_html: bool = True) -> jinja2.Environment:
    """Return the Jinja environment of folders of templates; where several have a template, the first folder counts.

    Args:
        is_html: Whether each value is escaped for HTML; Markdown templates escape by the filters `md` and `code`.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folders), autoescape=is_html, trim_blocks=True, lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    environment.filters |= {"duration": format_duration, "md": escape_markdown, "code": format_code}
    return environment
