"""Reads the charts of a page as a person does: by where they are, what is under the cursor, and their colours."""

from __future__ import annotations

from dataclasses import dataclass

from playwright.sync_api import Locator, Page

KINDS = ("raw", "change", "segments")


@dataclass(frozen=True)
class Plot:
    """The area of a chart in which its lines are."""

    page: Page
    chart: Locator

    @property
    def area(self) -> Locator:
        return self.chart.locator(".u-over")

    def point_at(self, share: float) -> None:
        """Moves the mouse to a share of the width."""
        box = self.area.bounding_box()
        assert box is not None
        self.page.mouse.move(box["x"] + share * (box["width"] - 1), box["y"] + box["height"] / 2)

    def drag(self, start: float, end: float) -> None:
        """Drags from one share of the width to another."""
        self.area.scroll_into_view_if_needed()
        self.point_at(start)
        self.page.mouse.down()
        self.point_at((start + end) / 2)
        self.point_at(end)
        self.page.mouse.up()

    def colours(self, shares: list[float], height: float) -> list[tuple[int, ...]]:
        """Colours at shares of the width, at a share of the height from the top."""
        pixels = self.chart.evaluate(
            """(chart, [shares, height]) => {
                const canvas = chart.querySelector("canvas");
                const [whole, area] = [canvas, chart.querySelector(".u-over")].map((e) => e.getBoundingClientRect());
                const scale = canvas.width / whole.width;
                const y = Math.round((area.top - whole.top + height * area.height) * scale);
                const x = (share) => Math.round((area.left - whole.left + share * area.width) * scale);
                // A copy: Chromium warns of reading from a canvas that is drawn on a graphics card.
                const copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
                const context = copy.getContext("2d", { willReadFrequently: true });
                context.drawImage(canvas, 0, 0);
                return shares.map((s) => Array.from(context.getImageData(x(s), y, 1, 1).data));
            }""",
            [shares, height],
        )
        return [tuple(pixel) for pixel in pixels]


def plot(page: Page, kind: str, joint: int = 0) -> Plot:
    """The chart of a kind, where all three are shown for each joint."""
    return Plot(page, page.locator("#charts .chart").nth(len(KINDS) * joint + KINDS.index(kind)))


def readout(page: Page) -> dict[str, str]:
    """What is said of the step under the cursor."""
    fields = page.locator("#readout [data-field]").evaluate_all("all => all.map((e) => [e.dataset.field, e.textContent])")
    return {name: text.replace("−", "-").replace(",", "") for name, text in fields}
