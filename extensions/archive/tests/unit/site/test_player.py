"""The player of flights on a case's page, in a browser."""

import pytest
import synthetic
from headless_browser import Page, needs_browser

from gslcosim_archive.site.writer import write_site

pytestmark = [pytest.mark.slow, needs_browser]

PLAN = synthetic.Plan(starts_m=synthetic.STARTS_M[:1], n_scenarios=1, repetitions=2, controls_frac=0.5, n_points=20)
STATE = """(() => {
  const one = (selector) => document.querySelector(selector);
  const all = (selector) => [...document.querySelectorAll(selector)];
  return {clock: one(".player output").textContent, play: one(".play").textContent,
    ways: all(".stage path[stroke-linejoin]").map((path) => path.getAttribute("d").length),
    rows: all(".player tbody tr").length, slider: +one(".player input").value};
})()"""
# At the highest speed; the promise is kept when the button offers to play again.
PLAY = """new Promise((resolve) => {
  const speed = document.querySelector(".controls select"), play = document.querySelector(".play");
  speed.value = 100; speed.dispatchEvent(new Event("change"));
  play.click();
  const begun = document.querySelector(".player output").textContent, label = play.textContent;
  const watch = () => { if (play.textContent === "Play") resolve([label, begun]); };
  new MutationObserver(watch).observe(play, {childList: true});
})"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Page(tmp_path_factory.mktemp("browser")) as page:
        yield page


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """The address of a case's page."""
    root = tmp_path_factory.mktemp("player")
    write_site([synthetic.make_results(root / "results", PLAN)], root / "site")
    (path,) = (root / "site" / "cases").glob("*.html")
    return path.as_uri()


@pytest.fixture
def page(browser, case):
    browser.open(case)
    yield browser
    assert browser.complaints == []


def test_it_plays_from_the_start_to_the_end_of_the_longest_flight(page):
    whole = page.evaluate(STATE)
    length = whole["clock"].split(" of ")[1]
    assert whole["clock"] == f"{length.removesuffix(' s')} of {length}"
    assert page.evaluate(PLAY) == ["Pause", f"0.0 of {length}"]
    assert page.evaluate(STATE) == whole


def test_the_slider_moves_all_flights_by_keyboard_too(page):
    whole = page.evaluate(STATE)
    page.evaluate("""(() => { const slider = document.querySelector(".player input");
        slider.focus(); slider.value = 0; slider.dispatchEvent(new Event("input")); })()""")
    start = page.evaluate(STATE)
    assert start["clock"].startswith("0.0 of ")
    assert sum(start["ways"]) < sum(whole["ways"])
    page.press("ArrowRight", 39)
    later = page.evaluate(STATE)
    assert later["slider"] == 5
    assert 0 < float(later["clock"].split()[0]) < float(whole["clock"].split()[0])


def test_a_link_of_the_table_shows_its_flight_alone(page):
    several = page.evaluate(STATE)["rows"]
    name = page.evaluate("""new Promise((resolve) => { const link = document.querySelector("a.run");
        addEventListener("hashchange", () => resolve(link.closest("tr").querySelector("th").textContent), {once: true});
        link.click(); })""")
    assert several > page.evaluate(STATE)["rows"] == 1
    assert page.evaluate('document.querySelector(".player tbody th").textContent').strip() == str(name).strip()
    assert page.evaluate('document.querySelector("a.run").getAttribute("aria-current")') == "true"
