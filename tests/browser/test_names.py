"""Names that would be markup, script or another link if a page took them for that."""

from __future__ import annotations

import json

import pytest
from playwright.sync_api import expect
from recordings import write_recording

ENVIRONMENT = "</script><script>document.title = 'taken'</script><img src=x onerror=alert(1)>\"'`&amp;\u2028\x01\x7f"
JOINT = "<b onmouseover='alert(1)'>\"grip\"</b> ${1} \\u003c &lt;\x1b[31m"
EPISODES = ["</script>", "a:b#c&joint=1", "%3A+ 'quoted' \"twice\"", "日本語 ↵\n\t", "__proto__", "<!--<script>"]
FILE = "it's <i>a</i> & \"b\" #1 %20.mcap"


@pytest.fixture(scope="module")
def hostile_report(make_report, tmp_path_factory):
    folder = tmp_path_factory.mktemp("hostile")
    (folder / FILE).parent.mkdir()
    write_recording(folder / FILE, EPISODES, 120, {"env_id": ENVIRONMENT, "action_names": json.dumps([JOINT])})
    write_recording(folder / "plain.mcap", [0], 120, {"env_id": "plain"})
    comparison = folder / "comparison.json"
    row = {"measure": ENVIRONMENT, "profile": JOINT, "environment": ENVIRONMENT}
    row |= {"n_episodes": 1, "mean_segments": 1.0, "mean_length": None, "mean_steps": 5.0, "seconds": 0.1}
    pair = {"environment": ENVIRONMENT, "a": ENVIRONMENT, "b": JOINT, "f1": 0.5}
    comparison.write_text(json.dumps({"measures": [row], "agreement": [pair], "tolerance_steps": 5}))
    return make_report(folder, report=["--compare", comparison])


def test_hostile_names_are_text_everywhere(hostile_report, show):
    page = show(hostile_report)
    assert page.title() == "out – coact report"
    elements = page.evaluate("document.querySelectorAll('main img, main script, main b:not([data-field]), main i:not(.legend i)').length")
    assert elements == 0
    assert page.locator("#environments tbody th").first.evaluate("e => e.textContent") == ENVIRONMENT
    expect(page.locator("#charts h4")).to_have_count(1)
    assert page.locator("#comparison-tables tbody th").first.evaluate("e => e.textContent") == ENVIRONMENT


@pytest.mark.parametrize("place", range(len(EPISODES)))
def test_a_link_opens_an_episode_of_any_name(hostile_report, show, place):
    page = show(hostile_report)
    page.locator("#list .option").nth(place).click()
    name = f"{FILE}:{EPISODES[place]}"
    shown = "() => document.getElementById('episode-name').textContent"
    page.wait_for_function(f"(name) => ({shown})() === name", arg=name)
    assert page.locator("#charts h4").evaluate("e => e.textContent") == JOINT
    # The address alone opens it again.
    again = show(hostile_report, page.evaluate("location.hash"))
    assert again.evaluate(shown) == name


def test_a_link_to_no_episode_says_so(hostile_report, show):
    page = show(hostile_report, "#episode=%3Cimg%20src%3Dx%3E")
    assert page.locator("#episode").inner_text() == "There is no episode <img src=x> in this page."
    # A fragment that is no valid encoding is not followed, and harms nothing.
    assert show(hostile_report, "#episode=%E0%A4%A").locator("#episode").inner_text()
