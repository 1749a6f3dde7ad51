"""Site of the documentation: it builds without a warning, holds every page, and no link leads nowhere."""

import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import PROCESS_S

pytestmark = [pytest.mark.slow, pytest.mark.extras]
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "--fail-on-warning", "--keep-going", "-c", "docs", "-d"]
    built = subprocess.run(
        [*command, str(folder / "doctrees"), ".", str(folder / "site")],
        cwd=ROOT, capture_output=True, text=True, timeout=3 * PROCESS_S, check=False,
    )  # fmt: skip
    assert built.returncode == 0, built.stdout + built.stderr
    return folder / "site"


def test_every_page_of_the_repository_is_in_the_site(site):
    pages = [page.relative_to(ROOT) for page in (*ROOT.glob("docs/**/*.md"), *ROOT.glob("agents/*/README.md"))]
    missing = [page for page in pages if page.parts[1] != "_build" and not (site / page.with_suffix(".html")).exists()]
    assert missing == []


def test_the_index_lists_pages_by_what_they_are_for(site):
    index = (site / "docs" / "README.html").read_text(encoding="utf-8")
    for caption in ("Get started", "Concepts", "Reference", "Extend"):
        assert f'<span class="caption-text">{caption}</span>' in index


def test_the_api_has_signatures_and_docstrings(site):
    page = (site / "docs" / "api" / "agent-kit.html").read_text(encoding="utf-8")
    assert "gslcosim.agent_kit.Agent.decide" in page
    assert "Return the command that answers an observation" in page
