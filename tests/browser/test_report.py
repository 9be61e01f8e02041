"""The page of the fixtures in a browser, held against the tables: what is read there is what Parquet says."""

from __future__ import annotations

import math
from collections import Counter
from urllib.parse import quote

import pytest
from playwright.sync_api import expect
from charts import plot, readout
from conftest import PHONE, Report

CARTPOLE = {"recording": "cartpole.mcap", "episode": 1}
LINK = "#episode=cartpole.mcap%3A1"


def steps_of(report: Report) -> list[dict]:
    """The steps of the CartPole episode; it has one joint."""
    return report.rows("steps", **CARTPOLE)


def is_said(text: str, value: float, places: float) -> bool:
    """Whether a number is the one that is meant, as far as its digits go and 16 bits hold it."""
    return math.isclose(float(text), value, rel_tol=6e-4, abs_tol=places)


def check_readout(said: dict[str, str], rows: list[dict], segments: list[dict]) -> None:
    """Holds all that is said of a step against its row."""
    row = rows[int(said["step"])]
    seconds = (row["time"] - rows[0]["time"]) / 1e9
    assert said["time"].endswith(" s") and is_said(said["time"][:-2], seconds, 6e-4)
    assert said["joint"] == row["joint_name"]
    assert is_said(said["action"], row["action"], 0)
    for field in ("action_measure", "state_measure"):
        assert is_said(said[field.replace("_", "-")], row[field], 1e-4), field
    for field in ("action_change", "state_change"):
        assert is_said(said[field.replace("_", "-")], row[field], 8e-5), field
    for field in ("action_mask", "state_mask", "correlated"):
        assert said[field.replace("_", "-")] == ("yes" if row[field] else "no"), field
    if row["segment"] < 0:
        assert said["segment"] == "outside"
    else:
        segment = segments[row["segment"]]
        assert said["segment"] == f"{row['segment']} ({segment['start_step']}–{segment['end_step']})"


def test_the_overview_counts_what_the_tables_hold(fixtures_report, show):
    page = show(fixtures_report)
    tiles = page.locator("#tiles > div").evaluate_all("all => all.map((e) => Array.from(e.children, (c) => c.textContent))")
    said = {name: (value.replace(",", ""), more) for name, value, more in tiles}
    episodes, segments = fixtures_report.episodes, fixtures_report.segments
    assert said["recordings"] == (str(len(fixtures_report.rows("recordings"))), "all read whole")
    assert said["episodes"][0] == str(len(episodes))
    assert said["steps"][0] == str(sum(e["n_steps"] for e in episodes))
    assert said["composite actions"] == (str(len(segments)), f"{len(segments) / len(episodes):.1f} an episode")
    assert said["mean length"][0] == f"{sum(s['n_steps'] for s in segments) / len(segments):.1f}"


def test_the_environments_are_those_of_the_tables(fixtures_report, show):
    page = show(fixtures_report)
    environment_of = {(e["recording"], e["episode"]): e["env_id"] for e in fixtures_report.episodes}
    n_episodes = Counter(environment_of.values())
    n_segments: Counter = Counter()
    n_steps: Counter = Counter()
    for s in fixtures_report.segments:
        key = (environment_of[s["recording"], s["episode"]], s["joint_name"])
        n_segments[key] += 1
        n_steps[key] += s["n_steps"]
    rows = page.locator("#environments tbody tr").evaluate_all("all => all.map((r) => Array.from(r.cells, (c) => c.textContent))")
    found = {}
    for cells in rows:
        if len(cells) == 8:
            environment = cells[0]
            assert int(cells[1]) == n_episodes[environment]
        joint, count, per_episode, length = cells[-5:-1]
        found[environment, joint] = int(count)
        assert per_episode == f"{n_segments[environment, joint] / n_episodes[environment] + 1e-9:.1f}"
        assert length == f"{n_steps[environment, joint] / n_segments[environment, joint] + 1e-9:.1f}"
    assert found == dict(n_segments)


def test_the_page_opens_at_its_top_and_a_link_at_its_episode(fixtures_report, show):
    assert show(fixtures_report).evaluate("scrollY") == 0
    page = show(fixtures_report, LINK)
    expect(page.locator("#episode-name")).to_be_in_viewport()


def test_an_episode_is_found_chosen_and_read_step_by_step(fixtures_report, show):
    page = show(fixtures_report)
    page.get_by_label("Find an episode").fill("cartpole :1")
    page.locator("#list").get_by_role("option").click()
    expect(page.locator("#episode-name")).to_have_text("cartpole.mcap:1")
    assert page.evaluate("location.hash") == LINK
    rows = steps_of(fixtures_report)
    segments = [s for s in fixtures_report.segments if (s["recording"], s["episode"]) == tuple(CARTPOLE.values())]
    chart = plot(page, "change")
    chart.area.scroll_into_view_if_needed()
    for share in (0, 0.13, 0.4, 0.55, 0.81, 1):
        chart.point_at(share)
        said = readout(page)
        assert abs(int(said["step"]) - share * (len(rows) - 1)) <= 1
        check_readout(said, rows, segments)


def test_a_drag_zooms_all_charts_and_a_double_click_undoes_it(fixtures_report, show):
    page = show(fixtures_report, LINK)
    n_steps = len(steps_of(fixtures_report))

    def ends(kind: str) -> list[int]:
        found = []
        for share in (0, 1):
            plot(page, kind).point_at(share)
            found.append(int(readout(page)["step"]))
        return found

    plot(page, "change").drag(0.25, 0.5)
    for kind in ("raw", "change", "segments"):
        assert ends(kind) == pytest.approx([0.25 * n_steps, 0.5 * n_steps], abs=2), kind
    plot(page, "raw").area.dblclick()
    assert ends("segments") == [0, n_steps - 1]


def test_steps_of_the_three_charts_are_below_each_other(fixtures_report, show):
    page = show(fixtures_report, LINK)
    boxes = [plot(page, kind).area.bounding_box() for kind in ("raw", "change", "segments")]
    assert len({(round(box["x"]), round(box["width"])) for box in boxes}) == 1


def test_the_colours_are_where_the_tables_say(fixtures_report, show):
    """The middle of each step: the colour of its bands in (b), and of the ground of its composite action in (c)."""
    page = show(fixtures_report, "#episode=mountaincar.mcap%3A1")
    rows = fixtures_report.rows("steps", recording="mountaincar.mcap", episode=1)
    # The last step has its beginning at the edge.
    shares = [(step + 0.5) / (len(rows) - 1) for step in range(len(rows) - 1)]
    # From 1.06 down to −0.42, with three bands below −0.06.
    heights = [(1.12 + (k + 0.5) * 0.12) / 1.48 for k in range(3)]
    for height, column in zip(heights, ("action_mask", "state_mask", "correlated"), strict=True):
        colours = plot(page, "change").colours(shares, height)
        assert one_colour_each(colours, [row[column] for row in rows]) == {True, False}, column
    grounds = plot(page, "segments").colours(shares, 0.02)
    # Six colours in turn, and none outside.
    turns = [row["segment"] % 6 if row["segment"] >= 0 else -1 for row in rows]
    assert one_colour_each(grounds, turns) == {-1, 0, 1, 2, 3, 4, 5}


def one_colour_each(colours: list[tuple[int, ...]], values: list) -> set:
    """The values, each of which must have one colour that no other has."""
    pairs = set(zip(values, colours, strict=False))
    assert len(pairs) == len({value for value, _ in pairs}) == len({colour for _, colour in pairs}), pairs
    return {value for value, _ in pairs}


def test_the_strongest_composite_action_is_the_first_and_leads_to_its_place(fixtures_report, show):
    page = show(fixtures_report)
    strongest = max(fixtures_report.segments, key=lambda s: s["state_change_sum"])
    row = page.locator("#ranking tbody tr").first
    assert row.locator("td").nth(2).inner_text() == f"{strongest['state_change_sum']:.3f}"
    assert row.locator("svg.spark path").count() == 1
    row.get_by_role("link").click()
    name = f"{strongest['recording']}:{strongest['episode']}"
    expect(page.locator("#episode-name")).to_have_text(name)
    assert readout(page)["step"] == str(strongest["start_step"])
    assert page.evaluate("location.hash") == f"#episode={quote(name, safe='')}&joint={strongest['joint']}&segment={strongest['segment']}"


def test_joints_are_small_multiples(fixtures_report, show):
    page = show(fixtures_report, "#episode=fetch_pickandplace.mcap%3A0")
    assert page.locator("#charts h4").all_inner_texts() == ["dx", "dy", "dz", "gripper"]
    assert page.locator("#charts .chart").count() == 4
    page.locator("#view-kind").select_option("all three")
    assert page.locator("#charts .chart").count() == 12
    page.locator("#view-joint").select_option("gripper")
    assert page.locator("#charts h4").all_inner_texts() == ["gripper"]
    plot(page, "segments").point_at(0.5)
    assert readout(page)["joint"] == "gripper"


def test_keys_alone_open_an_episode_and_walk_its_steps(fixtures_report, show):
    page = show(fixtures_report)
    page.get_by_label("Find an episode").focus()
    page.keyboard.type("cartpole")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    expect(page.locator("#episode-name")).to_have_text("cartpole.mcap:1")
    page.locator("#charts .chart").first.focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowRight")
    assert readout(page)["step"] == "13"
    assert "step 13" in page.locator("#charts .chart").first.get_attribute("aria-valuetext")
    page.keyboard.press("Home")
    page.keyboard.press("PageDown")
    first = next(s for s in fixtures_report.segments if (s["recording"], s["episode"]) == tuple(CARTPOLE.values()))
    assert readout(page)["step"] == str(first["start_step"])


def test_every_episode_opens(fixtures_report, show):
    page = show(fixtures_report)
    for episode in fixtures_report.episodes:
        name = f"{episode['recording']}:{episode['episode']}"
        page.evaluate("(name) => { location.hash = '#episode=' + encodeURIComponent(name); }", name)
        page.wait_for_function("(name) => document.getElementById('episode-name').textContent === name", arg=name)
        assert page.locator("#charts .chart").count() >= episode["n_joints"], name


@pytest.mark.parametrize("fragment", ["", LINK, "#strongest"])
def test_on_a_phone_nothing_is_wider_than_the_screen(fixtures_report, show, fragment):
    page = show(fixtures_report, fragment, viewport=PHONE, has_touch=True, is_mobile=True, device_scale_factor=2)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]


def test_a_finger_reads_values(fixtures_report, show):
    page = show(fixtures_report, LINK, viewport=PHONE, has_touch=True, is_mobile=True)
    area = plot(page, "change").area
    area.scroll_into_view_if_needed()
    box = area.bounding_box()
    page.touchscreen.tap(box["x"] + 0.25 * box["width"], box["y"] + box["height"] / 2)
    expect(page.locator("#readout [data-field=step]")).to_have_text("30")


def test_the_colours_follow_the_system_until_the_button_is_pressed(fixtures_report, show):
    light, dark = "rgb(255, 255, 255)", "rgb(20, 23, 27)"
    page = show(fixtures_report, color_scheme="dark")
    ground = page.locator("body")
    expect(ground).to_have_css("background-color", dark)
    page.emulate_media(color_scheme="light")
    expect(ground).to_have_css("background-color", light)
    page.get_by_role("button", name="Switch to dark colours").click()
    expect(ground).to_have_css("background-color", dark)
    page.reload()
    expect(ground).to_have_css("background-color", dark)
