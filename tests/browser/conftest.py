"""What the tests in a browser share: Chromium, reports made by the binary, and the tables that they are held against."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

ROOT = Path(__file__).resolve().parents[2]
DESKTOP = {"width": 1280, "height": 900}
PHONE = {"width": 390, "height": 844}

Run = Callable[[Sequence[str | Path]], str]


@dataclass(frozen=True)
class Report:
    """A page, and the output directory that it was made from."""

    path: Path
    directory: Path
    told: str
    comparison: dict[str, Any] | None = None

    @cached_property
    def segments(self) -> list[dict[str, Any]]:
        return self.rows("segments")

    @cached_property
    def episodes(self) -> list[dict[str, Any]]:
        return self.rows("episodes")

    def rows(self, table: str, **where: Any) -> list[dict[str, Any]]:
        """Rows of a table whose columns have the values of `where`; times in nanoseconds since the Unix epoch."""
        filters = [(column, "==", value) for column, value in where.items()] or None
        found = pq.read_table(self.directory / table, filters=filters)
        for i, field in enumerate(found.schema):
            if pa.types.is_timestamp(field.type):
                found = found.set_column(i, field.name, found.column(i).cast(pa.int64()))
        return found.to_pylist()


@pytest.fixture(scope="session")
def run() -> Run:
    """Runs the binary and gives what it prints."""
    binary = Path(os.environ.get("COACT", ROOT / "target/release/coact")).resolve()
    if not binary.is_file():
        pytest.fail(f"no binary at {binary}: cargo build --release, or set COACT")

    def run(args: Sequence[str | Path]) -> str:
        done = subprocess.run([binary, *args], capture_output=True, text=True, timeout=300, check=False)
        # 3: done, with something refused.
        assert done.returncode in (0, 3), done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="session")
def make_report(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Report]:
    """Extracts recordings and makes their page."""

    def make(inputs: Path, extract: Sequence[str] = (), report: Sequence[str | Path] = ()) -> Report:
        folder = tmp_path_factory.mktemp("report")
        directory, page = folder / "out", folder / "report.html"
        run(["extract", inputs, "--output", directory, "--quiet", *extract])
        told = run(["report", directory, "--output", page, *report])
        return Report(page, directory, told)

    return make


@pytest.fixture(scope="session")
def fixtures_report(make_report: Callable[..., Report]) -> Report:
    """The page of all recordings of the repository."""
    return make_report(ROOT / "fixtures")


@pytest.fixture(scope="session")
def compared_report(make_report: Callable[..., Report], run: Run, tmp_path_factory: pytest.TempPathFactory) -> Report:
    """The same with a comparison of the measures by both profiles."""
    comparison = tmp_path_factory.mktemp("comparison") / "comparison.json"
    comparison.write_text(run(["compare", ROOT / "fixtures", "--profiles", "both", "--json"]))
    report = make_report(ROOT / "fixtures", report=["--compare", comparison])
    return replace(report, comparison=json.loads(comparison.read_text()))


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium: CHROMIUM, that of the system, or Playwright's own."""
    path = os.environ.get("CHROMIUM") or shutil.which("chromium") or None
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path)
        yield browser
        browser.close()


@pytest.fixture
def show(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Opens pages from disk. In none of them may the console say anything, or anything be loaded but the page."""
    complaints: list[str] = []
    contexts = []

    def show(report: Report, fragment: str = "", **context: Any) -> Page:
        contexts.append(browser.new_context(**{"viewport": DESKTOP, **context}))
        page = contexts[-1].new_page()
        address = report.path.as_uri()
        page.on("console", lambda message: complaints.append(f"console: {message.text}"))
        page.on("pageerror", lambda error: complaints.append(f"error: {error}"))
        page.on("request", lambda r: r.url.split("#")[0] == address or complaints.append(f"request: {r.url[:200]}"))
        page.goto(address + fragment)
        page.wait_for_selector("html[data-ready]", state="attached")
        return page

    yield show
    for context in contexts:
        context.close()
    assert complaints == []
