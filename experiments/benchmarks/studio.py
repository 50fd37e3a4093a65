"""Duration from a slider's movement in the studio to the new curve on the screen, in a headless Chromium.

    python -m experiments.benchmarks.studio        # eight minutes; writes studio.json and studio.md beside this file

Needs ``pip install 'jshape[studio]' playwright`` and a Chromium. The time runs from the key that moves the slider to
the second frame after the chart has the new curve. The server is a process of its own, the browser a third one.
"""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from experiments.benchmarks.record import about, keep, processor
from experiments.markdown import table

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

PRESSES = 40

DRAGGING = 300.0
"""Seconds of dragging, before and after which the server's memory is read."""

CASES = (
    ("Duffing pair", "TwoMass", "plant.m2"),
    ("double-pendulum crane", "DoublePendulumCrane", "plant.hook_length"),
)
"""Name, plant and the slider that is moved."""

WATCH = """(charts) => {
  window.taken = Object.fromEntries(Object.keys(charts).map((name) => [name, []]));
  let pressed = null;
  const waiting = new Set();
  document.addEventListener("keydown", () => {
    pressed = performance.now();
    Object.keys(charts).forEach((name) => waiting.add(name));
  }, true);
  for (const [name, id] of Object.entries(charts)) {
    const chart = getElement(id).chart, before = chart.setOption.bind(chart);
    chart.setOption = (...given) => {
      before(...given);
      if (!waiting.delete(name) || !given[0].series?.length) return;
      const begin = pressed;
      requestAnimationFrame(() => requestAnimationFrame(() => window.taken[name].push(performance.now() - begin)));
    };
  }
}"""


def chromium() -> str | None:
    """The path of a Chromium, if there is one."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


@contextmanager
def serving(*arguments: str) -> Iterator[tuple[str, list[str], subprocess.Popen]]:
    """A studio in a process of its own: its address, the lines that it prints after that, and the process."""
    command = [sys.executable, "-m", "jshape", "studio", "--no-show", *arguments]
    # NiceGUI has ways of its own where it finds pytest's variable.
    environment = {k: v for k, v in os.environ.items() if k != "PYTEST_CURRENT_TEST"} | {"PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment, encoding="utf-8"
    )
    assert process.stdout is not None
    lines: list[str] = []
    try:
        while not (found := re.search(r"http://\S+", line := process.stdout.readline())):
            lines.append(line)
            if process.poll() is not None:
                raise RuntimeError("".join(lines))
        yield found[0], lines, process
    finally:
        process.terminate()
        rest, _ = process.communicate(timeout=30)
        lines += rest.splitlines()


@contextmanager
def browsing() -> Iterator[Any]:
    """A headless Chromium."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium(), args=["--no-sandbox", "--disable-gpu"])
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def page_of(address: str, browser: Any, width: int = 1280, height: int = 800, dark: bool = False) -> Iterator[Any]:
    """The studio's page, in a context of its own."""
    size: Any = {"width": width, "height": height}
    context = browser.new_context(viewport=size, color_scheme="dark" if dark else "light")
    try:
        page = context.new_page()
        page.goto(address)
        computed(page)
        yield page
    finally:
        context.close()


def changes_of(page: Any) -> int:
    """How many changes of its state the page has taken up."""
    return int(page.evaluate("document.querySelector('.studio-main')?.dataset.change ?? 0"))


def computed(page: Any, after: int = -1, seconds: float = 200.0) -> str:
    """The page's summary, once everything is computed.

    Args:
        page: of the studio.
        after: how many changes there were before the one whose curves are waited for.
        seconds: that it may take.
    """
    page.wait_for_function(
        """(after) => { const main = document.querySelector(".studio-main");
        return main?.ariaBusy === "false" && Number(main.dataset.change) > after; }""",
        arg=after,
        timeout=1000 * seconds,
    )
    return page.locator("[data-testid=summary]").inner_text()


def choose(page: Any, plant: str) -> None:
    """Choose another machine."""
    from jshape.studio.state import plants

    before, machine = changes_of(page), page.get_by_role("combobox", name="machine")
    if machine.input_value() == plants()[plant]:
        return
    machine.click()
    page.get_by_role("option", name=plants()[plant]).click()
    # The machine, and its simplest shaper.
    computed(page, before + 1)


def measured(page: Any, slider: str) -> dict[str, list[float]]:
    """Chart → milliseconds from each key to the new curve."""
    names = ("position", "sensitivity")
    charts = {name: int(page.locator(f"[data-testid=chart-{name}]").get_attribute("id")[1:]) for name in names}
    page.evaluate(WATCH, charts)
    page.locator(f'[data-testid="slider-{slider}"] [tabindex]').first.focus()
    for i in range(PRESSES):
        page.keyboard.press("ArrowRight" if i // 10 % 2 == 0 else "ArrowLeft")
        page.wait_for_timeout(700)
    return page.evaluate("window.taken")


def started(browser: Any) -> dict[str, float]:
    """Seconds from the command, in a process of its own, to the page and to all curves of it."""
    begin = time.perf_counter()
    with serving() as (address, _, _):
        context = browser.new_context(viewport={"width": 1280, "height": 800})
        page = context.new_page()
        page.goto(address)
        page.locator("[data-testid=summary]").wait_for()
        shown = time.perf_counter() - begin
        computed(page)
        found = {"first_page": shown, "first_curves": time.perf_counter() - begin}
        context.close()
    return found


def dragged(page: Any, process: subprocess.Popen, slider: str) -> dict[str, float]:
    """Megabytes of the server before and after some minutes of dragging, and how many keys that were."""
    page.locator(f'[data-testid="slider-{slider}"] [tabindex]').first.focus()
    before = memory(process)
    end, keys = time.monotonic() + DRAGGING, 0
    while time.monotonic() < end:
        page.keyboard.press("ArrowRight" if keys // 40 % 2 == 0 else "ArrowLeft")
        page.wait_for_timeout(25)
        keys += 1
    return {"before": before, "after": memory(process), "keys": keys}


def memory(process: subprocess.Popen) -> float:
    """Megabytes of a process."""
    lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


def main() -> None:
    record: dict[str, Any] = {"cases": {}}
    with browsing() as browser:
        # The first process of a version compiles what the others find.
        started(browser)
        record |= started(browser)
        with serving() as (address, _, process), page_of(address, browser) as page:
            for name, plant, slider in CASES:
                choose(page, plant)
                # The tab keeps its state; what was watched before goes.
                page.reload()
                computed(page)
                record["cases"][name] = measured(page, slider)
            record["memory"] = dragged(page, process, CASES[-1][2])
    record["load"] = os.getloadavg()
    write(record)


def write(record: dict[str, Any]) -> None:
    head = ("from the key to the new curve", "median (ms)", "95th percentile (ms)", "keys")
    rows = []
    for case, charts in record["cases"].items():
        for chart, times in charts.items():
            words = "sensitivity" if chart == "sensitivity" else "response"
            rows.append((f"{case}, {words}", *(f"{x:.0f}" for x in np.quantile(times, [0.5, 0.95])), str(len(times))))
    lines = table(head, rows)
    lines += [
        "",
        f"From the command, in a second process, to the page: {record['first_page']:.1f} s; to all of its curves: "
        f"{record['first_curves']:.1f} s.",
    ]
    if (held := record.get("memory")) is not None:
        lines.append(
            f"Memory of the server before and after {held['keys']:.0f} keys in {DRAGGING / 60:.0f} minutes: "
            f"{held['before']:.0f} and {held['after']:.0f} MB."
        )
    lines += [f"Load of the machine, others' included: {record['load'][0]:.1f} on {os.cpu_count()} cores."]
    ran = about(f"{processor()}, {os.cpu_count()} cores", "jshape", "jax", "nicegui")
    keep(__file__, dict(about=ran) | record, lines)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
