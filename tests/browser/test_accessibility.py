"""axe-core finds nothing serious in the page, in light and dark, on a desk and on a phone."""

from __future__ import annotations

import json

import pytest
from axe_playwright_python.sync_playwright import Axe
from conftest import DESKTOP, PHONE


@pytest.mark.parametrize("viewport", [DESKTOP, PHONE], ids=["desktop", "phone"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious(compared_report, show, scheme, viewport):
    page = show(compared_report, color_scheme=scheme, viewport=viewport)
    check(page)
    page.evaluate("location.hash = '#episode=cartpole.mcap%3A1&joint=0&segment=3'")
    page.wait_for_function("document.getElementById('episode-name').textContent === 'cartpole.mcap:1'")
    for summary in page.locator("summary").all():
        summary.click()
    check(page)


def check(page):
    found = Axe().run(page).response
    assert len(found["passes"]) > 20
    serious = [v for v in found["violations"] if v["impact"] in ("serious", "critical")]
    told = [(v["id"], v["help"], [n["html"][:160] for n in v["nodes"][:4]], [n["any"][0]["message"] if n["any"] else "" for n in v["nodes"][:2]]) for v in serious]
    assert not serious, json.dumps(told, indent=1)
