"""Draws strait.png, the picture of the README, from a recording of the default scenario.

    crossfix run scenarios/strait.toml -o strait.mcap
    python docs/images/draw.py strait.mcap

Needs the extras `view` and `test`, and Chromium.
"""

from __future__ import annotations

import io
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from crossfix.report.writing import write_page

IMAGE = Path(__file__).with_name("strait.png")
WIDTH, HEIGHT = 1280, 1000
COLOURS = 256
MAX_BYTES = 200_000
DRAWN = "window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle"
ONLY_THE_PICTURE = (
    "header, .notice, #tactical > h2, #tactical > p { display: none } main { margin-top: 16px }"
    # How fast it was says more of the machine that drew it.
    ".tile:last-child { display: none }"
)


def main(recording: Path) -> None:
    """Draw the report, take the part that says it at a glance, and make it small."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        sys.exit("Chromium is not installed (Debian: apt-get install chromium)")
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        report = Path(folder) / "report.html"
        write_page(recording, report)
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto(report.as_uri())
        picture = screenshot(page)
        browser.close()
    small = picture.quantize(COLOURS, dither=Image.Dither.NONE)
    small.save(IMAGE, optimize=True)
    print(f"{IMAGE.name}: {small.width} x {small.height}, {IMAGE.stat().st_size} bytes")  # noqa: T201
    if IMAGE.stat().st_size > MAX_BYTES:
        sys.exit(f"larger than {MAX_BYTES} bytes: take fewer colours")


def screenshot(page: Page) -> Image.Image:
    """The tiles and the tactical picture with its legend."""
    page.add_style_tag(content=ONLY_THE_PICTURE)
    page.wait_for_function(DRAWN)
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    top = page.locator(".tiles").bounding_box()
    bottom = page.locator("#tactical").bounding_box()
    if top is None or bottom is None:
        sys.exit("the report has no picture")
    height = bottom["y"] + bottom["height"] - top["y"] + 24
    clip = {"x": 0, "y": top["y"] - 12, "width": WIDTH, "height": height}
    data = page.screenshot(clip=clip, full_page=True)
    return Image.open(io.BytesIO(data)).convert("RGB")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
