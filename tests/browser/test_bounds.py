"""A page of thousands of episodes: bounded, quick to search, and it says what it left out."""

from __future__ import annotations

import re

import pytest
from conftest import ROOT
from playwright.sync_api import expect
from recordings import write_recording

N_EPISODES = 2_000
N_STEPS = 60
MAX_BYTES = 1_000_000


@pytest.fixture(scope="module")
def large_report(make_report, tmp_path_factory):
    folder = tmp_path_factory.mktemp("large")
    for part in range(4):
        episodes = range(part * N_EPISODES // 4, (part + 1) * N_EPISODES // 4)
        write_recording(folder / f"part-{part}.mcap", episodes, N_STEPS, {"env_id": f"env-{part}"}, n_joints=2)
    return make_report(folder, report=["--max-bytes", str(MAX_BYTES)])


def test_the_page_is_bounded_and_says_what_it_left_out(large_report, show):
    assert large_report.path.stat().st_size < 20_000_000
    n_embedded = int(re.search(r"traces of (\d+) of 2000 episodes", large_report.told)[1])
    page = show(large_report)
    traces = page.locator("script[id^=trace-]")
    assert traces.count() == n_embedded < N_EPISODES
    sizes = traces.evaluate_all("all => all.map((e) => e.textContent.length)")
    assert sum(sizes) < 2 * MAX_BYTES
    note = page.locator("#list-note")
    assert "2,000 episodes; the first 200 listed" in note.inner_text()
    assert f"{n_embedded:,} of 2,000 have their traces here" in note.inner_text()
    page.get_by_label("only with traces").check()
    expect(note).to_contain_text(f"{n_embedded:,} episodes")


def test_an_episode_without_traces_says_how_to_get_them(large_report, show):
    page = show(large_report)
    with_traces = set(page.locator("script[id^=trace-]").evaluate_all("all => all.map((e) => e.id)"))
    left_out = next(i for i in range(N_EPISODES - 1, 0, -1) if f"trace-{i}" not in with_traces)
    name = f"part-{left_out * 4 // N_EPISODES}.mcap:{left_out}"
    page.get_by_label("Find an episode").fill(name)
    page.get_by_label("Find an episode").press("Enter")
    expect(page.locator("#episode-name")).to_have_text(name)
    expect(page.locator("#episode code")).to_have_text(f"coact report DIR --episode '{name}'")
    assert page.locator("#charts").count() == 0


def test_every_environment_has_traces(large_report, show):
    page = show(large_report)
    page.get_by_label("only with traces").check()
    for part in range(4):
        page.get_by_label("Find an episode").fill(f"env-{part}")
        assert page.locator("#list .option").count() > 10


def test_without_steps_it_shows_what_it_can(make_report, show):
    report = make_report(ROOT / "fixtures/recordings/cartpole.mcap", extract=["--steps", "none"])
    page = show(report, "#episode=cartpole.mcap%3A1")
    assert "no per-step table" in page.locator("#notes").inner_text()
    assert page.locator("#charts .chart").count() == 1
    n_segments = sum(s["episode"] == 1 for s in report.segments)
    assert page.locator("#episode details tbody tr").count() == n_segments
