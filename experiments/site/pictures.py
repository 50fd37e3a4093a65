"""Pictures of the studio for its page, taken while the site is built where there is a Chromium."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from experiments.benchmarks.studio import browsing, changes_of, choose, chromium, computed, page_of, serving
from jshape.studio import words

PICTURE = re.compile(r"!\[[^\]]*\]\(studio/(\w+)\.png\)\n+")
"""A picture of the page, with the line's end."""


def machine(page: Any) -> None:
    choose(page, "Crane")


def energy(page: Any) -> None:
    choose(page, "DoublePendulumCrane")
    for chart, view in (("deflection", words.ENERGY), ("vibration", words.SPECTRUM)):
        page.locator(f"[data-testid=view-{chart}]").get_by_role("button", name=view).click()


def shaper(page: Any) -> None:
    choose(page, "Crane")
    page.get_by_role("tab", name="Shaper").click()
    page.locator("[data-testid=pin-it]").click()
    before = changes_of(page)
    page.get_by_role("button", name="ZVD", exact=True).click()
    computed(page, before)


def dark(page: Any) -> None:
    choose(page, "DoublePendulumCrane")
    page.locator("[data-testid=dark]").click()


def away(page: Any) -> None:
    page.get_by_role("tab", name="Take away").click()
    page.get_by_role("button", name="Show").click()


def printer(page: Any) -> None:
    page.get_by_role("tab", name="Printer").click()
    record = Path(__file__).parents[1] / "calibration" / "raw_data_x_simulated.csv"
    with page.expect_file_chooser() as chooser:
        page.locator("[data-testid=records] .q-btn").last.click()
    chooser.value.set_files(record)
    page.get_by_label(f"remove {record.name}").wait_for()
    page.locator("[data-testid=calibrate]").click()
    page.get_by_text("done: choices").wait_for(timeout=300_000)


def learn(page: Any) -> None:
    page.get_by_role("tab", name="Learn").click()
    page.locator("[data-testid=episode]").click()
    page.get_by_text("moves are beside this").wait_for(timeout=300_000)


STEPS: dict[str, Callable[[Any], None]] = {
    "machine": machine, "energy": energy, "shaper": shaper, "away": away, "dark": dark, "printer": printer,
    "learn": learn, "phone": machine,
}  # fmt: skip
"""What is done on the page before each picture."""


def illustrate(document: Path) -> None:
    """Take the pictures of a document and put them beside it; where there is no Chromium, take them out of its text.

    Args:
        document: a page in Markdown, which names its pictures as ``studio/NAME.png``.
    """
    text = document.read_text(encoding="utf-8")
    if chromium() is None:
        without_pictures(document)
        return
    folder = document.parent / "studio"
    folder.mkdir(exist_ok=True)
    with browsing() as browser, serving() as (address, _, _):
        for name in PICTURE.findall(text):
            size = {"width": 390, "height": 844} if name == "phone" else {}
            with page_of(address, browser, **size) as page:
                STEPS[name](page)
                page.evaluate("scrollTo(0, 0)")
                page.wait_for_timeout(1500)
                page.screenshot(path=folder / f"{name}.png")


def without_pictures(document: Path) -> None:
    """Take the pictures out of a document's text."""
    document.write_text(PICTURE.sub("", document.read_text(encoding="utf-8")), encoding="utf-8")
