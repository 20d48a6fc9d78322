"""The page in a real browser: it draws, is silent, asks nobody for anything, and can be used."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from crossfix.report.style import CARRIERS, DARK, SEA, TRUTH
from crossfix.report.writing import write_page
from schemas import keys
from tests.crossfix import report_recordings as recordings

playwright = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed (extra `test`)"
)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium here (Debian: apt-get install chromium)"
)
DEADLINE_MS = 60_000
IDLE = "window.Bokeh && Bokeh.documents.length === 1 && Bokeh.documents[0].is_idle"
KINDS: dict[str, Callable[[Path, Path], Path]] = {
    "whole": lambda whole, folder: whole,
    "blind": lambda whole, folder: recordings.without(
        whole, folder / "blind.mcap", keys.TRUTH_CARRIERS, keys.TRUTH_TARGETS
    ),
    "torn": lambda whole, folder: recordings.torn(whole, folder / "torn.mcap"),
    "uncorrected": lambda whole, folder: recordings.without(
        whole, folder / "uncorrected.mcap", keys.CORRECTION
    ),
    "crowded": lambda whole, folder: recordings.crowded(folder),
    "hostile": lambda whole, folder: recordings.hostile(folder),
}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="module")
def whole(folder: Path) -> Path:
    return recordings.whole(folder)


class Opened:
    """A report in the browser, and everything it said and asked for."""

    def __init__(self, browser: Any, report: Path, width: int = 1280) -> None:
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page = browser.new_page(viewport={"width": width, "height": 900})
        self.page.on("console", self._hear)
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(report.as_uri())
        self.await_drawn()

    def await_drawn(self) -> None:
        """Return when every plot is drawn."""
        self.page.wait_for_function(IDLE, timeout=DEADLINE_MS)
        self.page.evaluate(
            "new Promise(d => requestAnimationFrame(() => requestAnimationFrame(d)))"
        )

    def ask(self, expression: str) -> Any:
        """Evaluate with `picture` the figure and `view` what draws it."""
        return self.page.evaluate(
            "() => { const picture = Bokeh.documents[0].get_model_by_name('picture');"
            f" const view = Bokeh.index.find_one(picture); return {expression} }}"
        )

    def _hear(self, message: Any) -> None:
        if message.type in ("error", "warning", "assert"):
            self.said.append(f"{message.type}: {message.text}")


@pytest.fixture
def opened(browser: Any, folder: Path, whole: Path) -> Iterator[Callable[..., Opened]]:
    """Opens the report of a kind of recording; draws each kind once."""
    pages = []

    def opened(kind: str, width: int = 1280) -> Opened:
        report = folder / f"{kind}.html"
        if not report.exists():
            write_page(KINDS[kind](whole, folder), report)
        pages.append(Opened(browser, report, width))
        return pages[-1]

    yield opened
    for page in pages:
        page.page.close()


@pytest.mark.parametrize("kind", KINDS)
def test_it_draws_says_nothing_and_asks_nobody(kind: str, opened: Callable[..., Opened]) -> None:
    report = opened(kind)
    assert report.said == []
    assert [url for url in report.asked if not url.startswith("file:")] == []
    assert len(report.asked) == 1
    plots = report.ask("Bokeh.documents[0].roots().length")
    assert report.page.locator(".bk-Figure").count() == plots >= 2
    sizes = report.page.locator(".bk-Figure canvas").evaluate_all("all => all.map(c => c.width)")
    assert len(sizes) >= plots
    assert min(sizes) > 100
    assert report.ask("window.hurt ?? null") is None


def test_the_picture_is_drawn_in_the_colours_of_the_carriers(
    opened: Callable[..., Opened],
) -> None:
    drawn = pixels(opened("whole"))
    assert min(drawn.get(channels(colour), 0) for colour in CARRIERS[:2]) > 50


def test_who_wants_a_dark_page_has_one(opened: Callable[..., Opened]) -> None:
    report = opened("whole")
    report.page.emulate_media(color_scheme="dark")
    report.page.reload()
    report.page.wait_for_function(
        f"window.Bokeh && Bokeh.documents[0]?.is_idle && "
        f"Bokeh.documents[0].get_model_by_name('picture').background_fill_color == '{DARK[SEA]}'",
        timeout=DEADLINE_MS,
    )
    drawn = pixels(report)
    assert min(drawn.get(channels(DARK[colour]), 0) for colour in CARRIERS[:2]) > 50
    assert not any(drawn.get(channels(colour), 0) for colour in (TRUTH, SEA, CARRIERS[1]))


def channels(colour: str) -> str:
    """`#rrggbb` as the canvas has it."""
    return ",".join(str(int(colour[n : n + 2], 16)) for n in (1, 3, 5))


def pixels(report: Opened) -> dict[str, int]:
    """How many pixels of the picture have each colour."""
    found: dict[str, int] = report.page.locator("#picture canvas").first.evaluate(
        """canvas => {
            const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
            const seen = {};
            for (let i = 0; i < data.length; i += 4) {
                const colour = [data[i], data[i + 1], data[i + 2]].join();
                seen[colour] = (seen[colour] ?? 0) + 1;
            }
            return seen;
        }"""
    )
    return found


@pytest.mark.parametrize("width", [1600, 1280, 390])
def test_scale_is_equal_and_nothing_overflows_at_any_width(
    width: int, opened: Callable[..., Opened]
) -> None:
    report = opened("whole", width)
    east, north = report.ask(
        "[(picture.x_range.end - picture.x_range.start) / picture.inner_width,"
        " (picture.y_range.end - picture.y_range.start) / picture.inner_height]"
    )
    assert east == pytest.approx(north, rel=0.01)
    assert report.page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_the_legend_switches_layers_off_and_on(opened: Callable[..., Opened]) -> None:
    report = opened("whole")
    layers = report.page.locator("input[data-layer]").evaluate_all(
        "all => all.map(b => b.dataset.layer)"
    )
    named = report.ask("picture.renderers.map(r => r.name).filter(Boolean)")
    assert set(layers) == set(named)
    box = report.page.locator('input[data-layer="bravo: track as reported"]')
    hidden = "picture.renderers.filter(r => !r.visible).map(r => r.name)"
    box.uncheck()
    assert set(report.ask(hidden)) == {"bravo: track as reported"}
    box.check()
    assert report.ask(hidden) == []


@pytest.mark.parametrize(
    ("kind", "layer", "told"),
    [
        ("whole", "bravo: logs as corrected", "bravo, logs as corrected"),
        ("whole", "alpha: target logs", "t-00"),
        ("hostile", "alpha: target logs", recordings.HOSTILE),
    ],
)
def test_hovering_tells_the_name_as_text(
    kind: str, layer: str, told: str, opened: Callable[..., Opened]
) -> None:
    report = opened(kind)
    report.page.locator("#picture").scroll_into_view_if_needed()
    x, y = report.ask(
        "(() => { const at = view.el.getBoundingClientRect();"
        f" const {{data}} = picture.renderers.find(r => r.name === {layer!r}).data_source;"
        " return [at.x + view.frame.x_scale.compute(data.x[0]),"
        " at.y + view.frame.y_scale.compute(data.y[0])] })()"
    )
    report.page.mouse.move(x - 30, y)
    report.page.mouse.move(x, y)
    tip = report.page.locator(".bk-Tooltip", has_text=told).first
    tip.wait_for(state="attached", timeout=DEADLINE_MS)
    assert report.page.locator(".bk-Tooltip img").count() == 0
    assert report.ask("window.hurt ?? null") is None


def test_the_wheel_scrolls_the_page_and_zooms_with_ctrl(opened: Callable[..., Opened]) -> None:
    report = opened("whole")
    span = "picture.x_range.end - picture.x_range.start"
    report.page.locator("#picture").hover()
    before, top = report.ask(span), report.page.evaluate("scrollY")
    report.page.mouse.wheel(0, 200)
    report.page.wait_for_function(f"scrollY > {top}", timeout=DEADLINE_MS)
    assert report.ask(span) == before
    report.page.keyboard.down("Control")
    report.page.mouse.wheel(0, -200)
    report.page.wait_for_function(
        "([before]) => { const p = Bokeh.documents[0].get_model_by_name('picture');"
        " return p.x_range.end - p.x_range.start < before }",
        arg=[before],
        timeout=DEADLINE_MS,
    )
    report.page.keyboard.up("Control")
