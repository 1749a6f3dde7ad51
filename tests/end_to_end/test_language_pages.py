"""The pages of docs/agents are followed literally: programs saved as they stand, commands run as they stand."""

import re

import pytest
from deadlines import BUILD_S, PROCESS_S
from languages import stub_of
from page_commands import type_block
from real_runs import ROOT

# What takes longer, for building and fetching packages, is for `make soak`.
QUICK_PAGES = ("c", "shell")
PAGES = (*QUICK_PAGES, "cpp", "go", "java", "octave", "rust", "typescript")

pytestmark = [pytest.mark.debian, pytest.mark.timeout(BUILD_S + PROCESS_S)]
SAVED = re.compile(r"Save this as `([^`]+)`[^\n]*\n\n```\w+\n(.*?)```", re.DOTALL)
COMMANDS = re.compile(r"```sh\n(.*?)```", re.DOTALL)


def page_of(language: str) -> str:
    return (ROOT / "docs" / "agents" / f"{language}.md").read_text()


def commands_of(page: str) -> list[str]:
    """The commands of a page, without those that change the machine."""
    return [block for block in COMMANDS.findall(page) if not block.startswith("sudo ")]


@pytest.mark.parametrize(
    "language", [pytest.param(page, marks=() if page in QUICK_PAGES else pytest.mark.soak) for page in PAGES]
)
def test_a_page_followed_literally_ends_in_a_running_agent(tmp_path, language):
    if lacks := stub_of(language).lacks:
        pytest.skip(f"docs/agents/{language}.md is not tried: this machine has no {lacks}")
    page = page_of(language)
    for name, program in SAVED.findall(page):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(program)
    followed = type_block("".join(commands_of(page)), tmp_path, limit_s=BUILD_S)
    assert followed.returncode == 0, followed.stdout + followed.stderr
    assert followed.stdout.count("The source was found") == page.count("gslcosim up ")


@pytest.mark.parametrize("language", PAGES)
def test_what_a_page_installs_is_what_tests_install(language):
    """Otherwise the page would be tested with other packages than it names."""
    installed = (ROOT / "tests" / "install_debian_packages.sh").read_text()
    for line in re.findall(r"^sudo apt-get install (.*)$", page_of(language), re.MULTILINE):
        missing = [
            package for package in line.split() if not re.search(rf"(^|\s){re.escape(package)}(\s|$)", installed)
        ]
        assert not missing
