"""The section that `coact report --compare` adds, held against what `coact compare --json` printed."""

from __future__ import annotations

from statistics import mean

import pytest
from playwright.sync_api import Page, expect


def table_of(page: Page, place: int) -> dict[str, dict[str, str]]:
    """A table of the section: by its first column, then by the names of the others."""
    table = page.locator("#comparison-tables table").nth(place)
    cells = table.evaluate("t => Array.from(t.rows, (r) => Array.from(r.cells, (c) => c.textContent))")
    return {row[0]: dict(zip(cells[0][1:], row[1:], strict=True)) for row in cells[1:]}


def name_of(measure: str, profile: str) -> str:
    return f"{measure} ({profile})"


def is_said(text: str, value: float | None, digits: int) -> bool:
    """Whether a number is rounded as it must be; a half may go either way."""
    return text == "–" if value is None else abs(float(text.replace(",", "")) - value) <= 0.5 * 10**-digits + 1e-9


@pytest.mark.parametrize(
    ("what", "digits", "value"),
    [
        ("composite actions per episode", 1, lambda row: row["mean_segments"]),
        ("mean length, steps", 1, lambda row: row["mean_length"]),
        ("milliseconds", 2, lambda row: row["seconds"] * 1e3),
    ],
)
def test_each_measure_in_each_environment(compared_report, show, what, digits, value):
    page = show(compared_report, "#comparison")
    page.get_by_label("Show", exact=True).last.select_option(what)
    expect(page.locator("#comparison-tables caption").first).to_have_text(f"By measure: {what}")
    said = table_of(page, 0)
    measures = compared_report.comparison["measures"]
    assert len(measures) == 16 * len(said)
    for row in measures:
        cells = said[row["environment"]]
        assert cells["episodes"] == str(row["n_episodes"])
        assert is_said(cells["steps per episode"], row["mean_steps"], 0)
        assert is_said(cells[name_of(row["measure"], row["profile"])], value(row), digits), row


def test_the_agreement_of_all_environments_and_of_one(compared_report, show):
    page = show(compared_report, "#comparison")
    pairs = compared_report.comparison["agreement"]

    def check(chosen: list[dict]) -> None:
        said = table_of(page, 1)
        values: dict[frozenset, list[float]] = {}
        for p in chosen:
            key = frozenset((name_of(p["a"], p["a_profile"]), name_of(p["b"], p["b_profile"])))
            values.setdefault(key, []).append(p["f1"])
        assert len(values) == 16 * 15 / 2
        for a, b in values:
            assert said[a][b] == said[b][a] and is_said(said[a][b], mean(values[frozenset((a, b))]), 2)

    check(pairs)
    page.locator("#compared-environment").select_option("CartPole-v1")
    check([p for p in pairs if p["environment"] == "CartPole-v1"])


def test_without_a_comparison_there_is_no_section(fixtures_report, show):
    page = show(fixtures_report)
    assert not page.locator("#comparison").is_visible() and not page.locator("#comparison-link").is_visible()
