#!/usr/bin/env python3
"""Takes the pictures of the report that README.md and docs/report.md show, from the fixtures.

Output: PNG of 256 colours in docs/images. Chromium is CHROMIUM, or that of the system; scripts/test_browser.sh makes
the environment, and installs Chromium.

    cargo build --release
    .venv-browser/bin/python scripts/picture_report.py
"""

import os
import shutil
import subprocess
import tempfile
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

ROOT = Path(__file__).resolve().parent.parent
BINARY = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release/coact"
IMAGES = ROOT / "docs/images"
DESKTOP = {"viewport": {"width": 1280, "height": 1100}}
PHONE = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True, "device_scale_factor": 2}
EPISODE = "#episode=cartpole.mcap%3A1"


def main() -> None:
    """Makes the page, opens it, and takes the pictures."""
    path = os.environ.get("CHROMIUM") or shutil.which("chromium")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        directory, page = Path(folder) / "fixtures", Path(folder) / "report.html"
        subprocess.run([BINARY, "extract", ROOT / "fixtures", "-o", directory, "-q"], check=True)
        subprocess.run([BINARY, "report", directory, "-o", page], check=True)
        browser = playwright.chromium.launch(executable_path=path)
        address = page.as_uri()
        keep("report-overview.png", opened(browser, address, "light", DESKTOP).screenshot(clip={"x": 0, "y": 0, "width": 1280, "height": 800}))
        for scheme in ("light", "dark"):
            episode = opened(browser, address + EPISODE, scheme, DESKTOP)
            episode.locator("#charts .chart").nth(1).locator(".u-over").hover()
            keep(f"report-episode-{scheme}.png", episode.screenshot(clip=around(episode)))
        phone = opened(browser, address + EPISODE, "dark", PHONE)
        phone.locator("#charts .chart").nth(1).locator(".u-over").hover()
        phone.locator("#episode").evaluate("e => scrollTo(0, e.getBoundingClientRect().top + scrollY)")
        keep("report-phone.png", phone.screenshot())
        browser.close()


def around(page: Page, margin: float = 12) -> dict[str, float]:
    """An episode from its name to its last chart."""
    whole, charts = (page.locator(name).bounding_box() for name in ("#episode", "#charts"))
    bottom = charts["y"] + charts["height"]
    return {
        "x": whole["x"] - margin, "y": whole["y"] - margin,
        "width": whole["width"] + 2 * margin, "height": bottom - whole["y"] + 2 * margin,
    }


def opened(browser: Browser, address: str, scheme: str, kind: dict) -> Page:
    """The page as a reader with these colours and this screen sees it."""
    page = browser.new_context(color_scheme=scheme, **kind).new_page()
    page.goto(address)
    page.wait_for_selector("html[data-ready]", state="attached")
    return page


def keep(name: str, png: bytes) -> None:
    """Keeps a picture with as few colours as it needs."""
    image = Image.open(BytesIO(png)).convert("RGB").quantize(256, dither=Image.Dither.NONE)
    image.save(IMAGES / name, optimize=True)
    print(f"{name}: {image.width} × {image.height}, {(IMAGES / name).stat().st_size / 1e3:.0f} KB")


if __name__ == "__main__":
    main()
