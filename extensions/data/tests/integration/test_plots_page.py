"""The gallery of docs/plots.md shows each figure there is, and `GSLCOSIM_REWRITE_GOLDEN=1` draws its pictures again."""

import os
import re
from pathlib import Path

import pytest
from PIL import Image

import gslcosim_data
from gslcosim.cli.main import main
from gslcosim_bench.report.figures import RESULT_FIGURES, write_result_figures
from gslcosim_data import figures
from gslcosim_data.figures.run_figures import RUN_FIGURES, SEVERAL_FIGURES

ROOT = Path(__file__).parents[4]
PAGE = ROOT / "docs" / "plots.md"
PICTURES = PAGE.parent / "images" / "plots"
MOST_BYTES = 100_000
DOTS_PER_INCH = 130
SEVERAL = [("warehouse_empty", seed, method) for method in ("dung_beetle", "surge_cast") for seed in ("3", "4", "5")]


def expected():
    return {*RUN_FIGURES, *(f"several_{name}" for name in SEVERAL_FIGURES), "starts"}


def test_the_gallery_has_a_small_picture_of_each_figure():
    shown = set(re.findall(r"!\[[^]]+\]\(images/plots/(\w+)\.png\)", PAGE.read_text()))
    assert shown == expected()
    assert {path.stem for path in PICTURES.iterdir()} == shown
    for path in PICTURES.iterdir():
        assert path.stat().st_size < MOST_BYTES, path.name
        with Image.open(path) as picture:
            assert picture.width == pytest.approx(3.5 * DOTS_PER_INCH, abs=2), path.name


def test_the_page_names_each_figure_and_each_function():
    text = PAGE.read_text()
    rows = set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE))
    assert set(RUN_FIGURES) <= rows
    assert all(f"`{name}" in text for name in (*SEVERAL_FIGURES, *RESULT_FIGURES))
    not_drawing = {"draw_run", "draw_runs", "write_run_figures", "write_figures_of_several"}
    assert all(name in text for name in set(figures.__all__) - not_drawing)


@pytest.mark.skipif(not os.environ.get("GSLCOSIM_REWRITE_GOLDEN"), reason="draws the gallery anew")
@pytest.mark.soak
def test_draw_the_gallery(tmp_path):
    def fly(scenario, seed, method=""):
        folder = tmp_path / f"{scenario}_{seed}_{method}"
        words = ["up", scenario, "--in-process", "--quiet", "--seed", seed, "--runs-dir", str(folder)]
        assert main([*words, *(["--set", f"agents[0].start.python={method}"] if method else [])]) in (0, 1)
        return gslcosim_data.open_run(next(folder.iterdir()))

    PICTURES.mkdir(exist_ok=True)
    one, swarm = fly("warehouse_racks", "2", "infotaxis"), fly("swarm_tiny", "3")
    several = {f"{method}, seed {seed}": fly(scenario, seed, method) for scenario, seed, method in SEVERAL}
    with figures.styled():
        for name in RUN_FIGURES:
            figure = figures.draw_run(swarm if name == "swarm" else one, name)
            figures.save(figure, PICTURES / name, ["png"], dots_per_inch=DOTS_PER_INCH)
        for name in SEVERAL_FIGURES:
            figure = figures.draw_runs(several, name)
            figures.save(figure, PICTURES / f"several_{name}", ["png"], dots_per_inch=DOTS_PER_INCH)
    assert main(["bench", "run", "smoke", "--jobs", "1", "--results", str(tmp_path / "results"), "--json"]) == 0
    write_result_figures(tmp_path / "results", tmp_path, names=("starts",), formats=("png",))
    with Image.open(tmp_path / "starts_tiny_room.png") as picture:
        width = round(3.5 * DOTS_PER_INCH)
        picture.resize((width, round(picture.height * width / picture.width)), Image.LANCZOS).save(
            PICTURES / "starts.png", optimize=True
        )
