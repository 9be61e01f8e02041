#!/usr/bin/env python3
"""Times what a reader of a report waits for: the page being made, opened, and an episode of it being chosen.

Input: output directories of `coact extract`. Output: a row for each, medians, and what the page holds. Chromium is
CHROMIUM, or that of the system; scripts/test_browser.sh makes the environment.

    cargo run --release --example generate_recording -- many 2000 many
    cargo run --release -- extract many -o out
    .venv-browser/bin/python scripts/measure_report.py out --rounds 5
"""

import argparse
import os
import shutil
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

ROOT = Path(__file__).resolve().parent.parent
BINARY = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release/coact"

# Milliseconds from the click on an episode to the first frame with its charts.
CHOOSE = """() => new Promise((done) => {
    const start = performance.now();
    const options = document.querySelectorAll("#list .option");
    options[options.length >> 1].click();
    const name = options[options.length >> 1].querySelector(".name").textContent;
    const look = () => document.getElementById("episode-name").textContent === name
        ? requestAnimationFrame(() => done(performance.now() - start)) : requestAnimationFrame(look);
    look();
})"""


def measure(browser: Browser, directory: Path, rounds: int) -> None:
    """Makes the page of one directory and opens it, each round in a browser context of its own."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.html"
        made, opened, chosen = [], [], []
        for _ in range(rounds):
            start = time.perf_counter()
            subprocess.run([BINARY, "report", directory, "-o", report], check=True, capture_output=True)
            made.append(time.perf_counter() - start)
            context = browser.new_context(viewport={"width": 1280, "height": 900})
            page = context.new_page()
            start = time.perf_counter()
            page.goto(report.as_uri(), wait_until="commit")
            page.wait_for_selector("#list .option")
            opened.append(time.perf_counter() - start)
            page.wait_for_selector("html[data-ready]", state="attached")
            chosen.append(page.evaluate(CHOOSE) / 1e3)
            n_traces = page.locator("script[id^=trace-]").count()
            n_episodes = page.evaluate("JSON.parse(document.getElementById('data').textContent).n_episodes")
            context.close()
        said = [f"{statistics.median(seconds):.2f} s" for seconds in (made, opened, chosen)]
        size = report.stat().st_size / 1e6
        print(f"{directory}: {n_episodes:,} episodes, {n_traces:,} with traces, {size:.1f} MB; "
              f"made in {said[0]}, list shown after {said[1]}, episode shown after {said[2]}")


def main() -> None:
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, nargs="+", help="directory that coact extract has written")
    parser.add_argument("--rounds", type=int, default=5, help="how often (default 5)")
    args = parser.parse_args()
    path = os.environ.get("CHROMIUM") or shutil.which("chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path)
        for directory in args.directory:
            measure(browser, directory, args.rounds)
        browser.close()


if __name__ == "__main__":
    main()
