"""The studio in a headless Chromium, clicked through as its user would; skipped where there is none."""

import json
import os
import random
import re
import signal
import time
import urllib.error
import urllib.request
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("nicegui")
pytest.importorskip("playwright")

from experiments.benchmarks.studio import browsing, changes_of, choose, chromium, computed, memory, serving
from jshape.memory import HELD
from jshape.problems.problem import load
from jshape.problems.reading import shipped
from jshape.studio import changes, charts, state

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(chromium() is None, reason="there is no Chromium"),
    # Playwright's and asyncio's own, at their end.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


ACTIONS_MADE = int(os.environ.get("JSHAPE_ACTIONS", "60"))
"""Random actions; 2,000 of them take ten minutes: JSHAPE_ACTIONS=2000 python -m pytest -m slow -k random_actions."""


@pytest.fixture(scope="module")
def studio():
    # One context, in which the browser reads and compiles the page's code once.
    with browsing() as browser, serving("paper_001") as (address, lines, process), browser.new_context() as context:
        yield address, process, context
    errors = [line for line in lines if "Traceback" in line or "Error" in line]
    assert errors == [], "\n".join(lines[-60:])


@contextmanager
def opened(studio, width=1280, height=800, scheme="light"):
    """A page; what it says in the console and asks of other addresses is an error."""
    address, _, context = studio
    page, wrong = context.new_page(), []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    page.on("request", lambda asked: wrong.append(asked.url) if "//127.0.0.1:" not in asked.url else None)
    page.set_viewport_size({"width": width, "height": height})
    page.emulate_media(color_scheme=scheme)
    try:
        page.goto(address)
        computed(page)
        yield page
    finally:
        for each in context.pages:
            each.close()
    assert [each for each in wrong if not each.startswith(("data:", "blob:"))] == []


def curve(page, chart, series=0):
    """What a chart shows: the values of one of its curves."""
    element = page.locator(f"[data-testid=chart-{chart}]").get_attribute("id")[1:]
    return page.evaluate(f"getElement({element}).chart.getOption().series[{series}]?.data.map((pair) => pair[1])")


def until(page, holds, seconds=60):
    """Wait until something holds."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "it does not hold in time"
        page.wait_for_timeout(50)


def press(page, slider, key="ArrowRight", times=1):
    """Move a slider by keys, each of which is one change."""
    page.locator(f'[data-testid="{slider}"] [tabindex]').first.focus()
    for _ in range(times):
        before = changes_of(page)
        page.keyboard.press(key)
        until(page, lambda before=before: changes_of(page) > before)
    computed(page)


def changed_by(page, act):
    """The page's summary, once what follows from something that is done is computed."""
    before = changes_of(page)
    act()
    return computed(page, before)


def test_sliders_move_the_curves(studio):
    with opened(studio) as page:
        before = [curve(page, chart) for chart in ("position", "deflection", "sensitivity", "vibration")]
        assert len(before[2]) == 1000
        slider = page.locator('[data-testid="slider-plant.spring.k1"]')
        press(page, "slider-plant.spring.k1", times=5)
        after = [curve(page, chart) for chart in ("position", "deflection", "sensitivity", "vibration")]
        # V is of the shaper alone; it is drawn about the plant's frequencies.
        assert all(a != b for a, b in zip(before, after, strict=True))
        number = page.get_by_label("spring.k1", exact=True).first
        assert number.input_value() == "10.69"
        # The slider follows its number, back to where the page began, too.
        changed_by(page, lambda: number.fill("10"))
        until(page, lambda: slider.get_attribute("aria-valuenow") == "10")
        press(page, "slider-plant.spring.k1")
        assert number.input_value() == "10.14"


def test_a_closed_form_and_its_impulses(studio):
    with opened(studio) as page:
        page.get_by_role("tab", name="Shaper").click()
        words = changed_by(page, page.get_by_role("button", name="energy 2-impulse").click)
        assert float(words.split()[2]) < 1e-10
        press(page, "amplitude-0", times=10)
        amplitudes = curve(page, "impulses")
        assert amplitudes[0] == pytest.approx(0.55, abs=0.006)
        assert sum(amplitudes) == pytest.approx(1.0, abs=1e-4)
        changed_by(page, page.get_by_role("button", name="add").click)
        assert len(curve(page, "impulses")) == 3


def bar(page, index):
    """Where the end of an impulse's bar is on the screen."""
    chart = page.locator("[data-testid=chart-impulses]")
    element = chart.get_attribute("id")[1:]
    x, y = page.evaluate(
        f"""(() => {{ const chart = getElement({element}).chart, pair = chart.getOption().series[0].data[{index}];
        return chart.convertToPixel({{xAxisIndex: 0, yAxisIndex: 0}}, pair); }})()"""
    )
    box = chart.bounding_box()
    return box["x"] + x, box["y"] + y


def test_bars_are_dragged(studio):
    """To the left and up: time and amplitude follow the pointer, the sum stays, and the axes fit afterwards."""
    with opened(studio) as page:
        before = curve(page, "impulses")
        x, y = bar(page, 1)
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x - 40, y + 10, steps=8)
        # While it is dragged the bar is under the pointer.
        until(page, lambda: bar(page, 1) == pytest.approx((x - 40, y + 10), abs=1.5))
        page.mouse.up()
        # The axes fit again.
        until(page, lambda: bar(page, 1) != pytest.approx((x - 40, y + 10), abs=1.5))
        computed(page)
        after = curve(page, "impulses")
        assert after[1] < before[1] - 0.02
        assert sum(after) == pytest.approx(1.0, abs=1e-4)
        time = page.locator("[data-testid=summary]").inner_text().split("shaper ")[1].split()[0]
        assert 0.3 < float(time) < 0.9
        # The first one cannot leave 0, and none can be dragged to nowhere.
        page.mouse.move(*bar(page, 0))
        page.mouse.down()
        page.mouse.move(*(each + 25 for each in bar(page, 0)), steps=4)
        page.mouse.up()
        page.evaluate("emitEvent('impulse', {index: 7, time: 1e300, amplitude: 'x', done: true})")
        page.evaluate("emitEvent('impulse', 'nothing')")
        # What is sent after these has come after them.
        open_panel(page, "Shaper")
        changed_by(page, page.get_by_role("button", name="add").click)
        assert sum(curve(page, "impulses")) == pytest.approx(1.0, abs=1e-4)
        computed(page)


def test_designs_are_compared(studio):
    with opened(studio) as page:
        page.get_by_role("tab", name="Shaper").click()
        first = curve(page, "position", 1)
        changed_by(page, page.locator("[data-testid=pin-it]").click)
        changed_by(page, page.get_by_role("button", name="energy 2-impulse").click)
        page.wait_for_function("/leaves/.test(document.querySelector('[data-testid=pin]').innerText)", timeout=60_000)
        assert curve(page, "position", 3) == first
        assert curve(page, "position", 1) != first
        assert len(curve(page, "sensitivity", 2)) == 200
        changed_by(page, page.get_by_label("take A:").click)
        assert curve(page, "position", 1) == first
        changed_by(page, page.get_by_label("remove A:").click)
        assert curve(page, "position", 3) is None


def test_tune_with_progress_and_stop(studio):
    with opened(studio) as page:
        page.get_by_role("tab", name="Shaper").click()
        page.locator("[data-testid=tune]").click()
        said = "document.querySelector('[data-testid=said-tune]').innerText"
        page.wait_for_function(f"{said}.includes('best')", timeout=90_000)
        page.locator("[data-testid=stop-tune]").click()
        page.wait_for_function(f"/converged|interrupted|stopped/.test({said})", timeout=60_000)
        # The design is drawn a moment after it is said.
        until(page, lambda: len(curve(page, "impulses")) == 3)
        until(page, page.locator("[data-testid=tune]").is_enabled)


def test_a_front_to_click_on(studio):
    with opened(studio) as page:
        page.get_by_role("tab", name="Shaper").click()
        page.get_by_label("impulses up to").fill("2")
        page.get_by_label("durations").fill("3")
        page.locator("[data-testid=pareto]").click()
        page.wait_for_function(
            "/designs/.test(document.querySelector('[data-testid=said-pareto]').innerText)", timeout=300_000
        )
        until(page, lambda: curve(page, "front"))
        shown = page.locator("[data-testid=chart-front]")
        element = shown.get_attribute("id")[1:]
        (x, y), (time, _) = page.evaluate(
            f"""(() => {{ const chart = getElement({element}).chart, pair = chart.getOption().series[0].data.at(-1);
            return [chart.convertToPixel({{xAxisIndex: 0, yAxisIndex: 0}}, pair), pair]; }})()"""
        )
        shown.scroll_into_view_if_needed()
        box = shown.bounding_box()
        summary = changed_by(page, lambda: page.mouse.click(box["x"] + x, box["y"] + y))
        assert float(summary.split("shaper ")[1].split()[0]) == pytest.approx(time, rel=1e-3)


def test_take_away(studio, tmp_path):
    with opened(studio) as page:
        press(page, "slider-plant.m2", times=3)
        page.get_by_role("tab", name="Take away").click()
        saved = {}
        for name in ("Download", "Problem file", "Python script", "Responses, CSV", "Sensitivity, CSV"):
            with page.expect_download() as waiting:
                page.get_by_role("button", name=name).click()
            saved[name] = tmp_path / waiting.value.suggested_filename
            waiting.value.save_as(saved[name])
        assert "FUNCTION_BLOCK" in saved["Download"].read_text()
        assert float(load(saved["Problem file"]).plant.m2) == pytest.approx(1.041, abs=1e-3)
        assert "js.tune" in saved["Python script"].read_text()
        assert len(saved["Responses, CSV"].read_text().splitlines()) == 402
        assert len(saved["Sensitivity, CSV"].read_text().splitlines()) == 1001


def upload(page, path):
    with page.expect_file_chooser() as chooser:
        page.locator(".q-uploader .q-btn").last.click()
    chooser.value.set_files(path)


def test_uploads(studio, tmp_path):
    files = {
        "broken.toml": ("[[[", "malformed TOML"),
        "code.toml": ('distance = 1.0\n[plant]\ntype = "os:system"\n', "runs no code"),
        "large.toml": ("#" * 1_100_000, "must have at most"),
    }
    with opened(studio) as page:
        for name, (text, words) in files.items():
            (tmp_path / name).write_text(text)
            upload(page, tmp_path / name)
            page.get_by_text(words).wait_for(timeout=10_000)
        (tmp_path / "mine.toml").write_text(changes.with_value(state.begin("TwoMass"), "plant.m1", 1.25).text)
        upload(page, tmp_path / "mine.toml")
        page.wait_for_function("document.querySelector('[aria-label=m1]').value === '1.25'", timeout=10_000)


def test_machines_of_files(studio, tmp_path):
    """A URDF that is dropped is drawn; one that names other files is refused."""
    (tmp_path / "hostile.xml").write_text('<mujoco><include file="/etc/passwd"/></mujoco>')
    machine = tmp_path / "gantry.urdf"
    machine.write_bytes((shipped()["paper_001"].parent / "gantry.urdf").read_bytes())
    with opened(studio) as page:
        before = curve(page, "position", 1)
        upload(page, tmp_path / "hostile.xml")
        page.get_by_text("names other files or code").wait_for(timeout=20_000)
        upload(page, machine)
        page.locator("[data-testid=driven]").wait_for(timeout=60_000)
        until(page, lambda: curve(page, "position", 1) not in (None, before), seconds=120)
        page.wait_for_function("jshapeScene.data.kind === 'bodies'", timeout=60_000)
        assert page.get_by_label("body.mast.mass", exact=True).input_value() == "12"


def test_an_episode_and_the_leaderboard(studio):
    """Two strategies are watched beside each other; the leaderboard keeps what was judged when it is stopped."""
    pytest.importorskip("gymnasium")
    with opened(studio) as page:
        open_panel(page, "Learn")
        page.get_by_label("moves", exact=True).fill("1")
        page.get_by_role("combobox", name="strategy B").click()
        page.get_by_role("option", name="zvd", exact=True).click()
        page.locator("[data-testid=episode]").click()
        said = "document.querySelector('[data-testid=said-episode]').innerText"
        page.wait_for_function(f"{said}.startsWith('done: 1 moves')", timeout=120_000)
        page.wait_for_function("jshapeEpisode.data?.titles?.join() === 'A: zv,B: zvd'")
        left = curve_of_bars(page)
        assert 0 < left[1] < left[0]
        for field in ("episodes", "seeds"):
            page.get_by_label(field, exact=True).fill("1")
        page.locator("[data-testid=leaderboard]").click()
        said = "document.querySelector('[data-testid=said-leaderboard]').innerText"
        page.wait_for_function(f"/ [1-9]/.test({said})", timeout=300_000)
        page.locator("[data-testid=stop-leaderboard]").click()
        page.wait_for_function(f"{said}.includes('strategies judged')", timeout=60_000)
        table = page.locator("[data-testid=leaderboard-table]")
        names = lambda: [cell.inner_text() for cell in table.locator("tbody tr td:first-child").all()]
        first = names()
        assert "zv" in first
        table.get_by_role("columnheader", name="strategy").click()
        until(page, lambda: names() == sorted(first))
        table.get_by_role("columnheader", name="strategy").click()
        until(page, lambda: names() == sorted(first, reverse=True))


def curve_of_bars(page):
    """What both strategies leave of the first move."""
    element = page.locator("[data-testid=chart-residuals]").get_attribute("id")[1:]
    return page.evaluate(f"getElement({element}).chart.getOption().series.map((one) => one.data[0])")


def test_by_keyboard_alone(studio):
    """From the address to a shaper: every step is reached by Tab and taken by keys; focus is seen."""
    with opened(studio) as page:
        page.get_by_role("tab", name="Machine").focus()
        page.keyboard.press("ArrowRight")
        page.keyboard.press("Enter")
        for _ in range(30):
            page.keyboard.press("Tab")
            if page.evaluate("document.activeElement.innerText").strip() == "ZVD":
                break
        assert page.evaluate("document.activeElement.innerText").strip() == "ZVD"
        page.keyboard.press("Enter")
        page.wait_for_function("/3 impulses|1.987 s/.test(document.querySelector('[data-testid=summary]').innerText)")
        assert len(curve(page, "impulses")) == 3


def test_every_control_has_a_name(studio):
    """What can be reached by Tab says to a screen reader what it is; on a dark page words have their contrast."""
    with opened(studio, scheme="dark") as page:
        for name, part in PARTS.items():
            open_panel(page, name)
            page.locator(f'[data-testid="{part}"]').first.wait_for()
            assert page.evaluate(NAMELESS) == []
            # Once no colour fades into another any more.
            page.wait_for_function("document.getAnimations().every((one) => one.playState !== 'running')")
            assert page.evaluate(FAINT) == []


PARTS = {
    "Machine": "slider-plant.m2",
    "Shaper": "tune",
    "Take away": "export",
    "Printer": "calibrate",
    "Learn": "episode",
}
"""Of each panel."""


NAMELESS = """[...document.querySelectorAll("button, input, select, [tabindex='0']")]
  .filter((one) => one.offsetParent && one.tabIndex >= 0 && !one.closest("[aria-hidden=true]") && !one.disabled)
  .filter((one) => !(one.innerText || one.ariaLabel || one.labels?.length || one.getAttribute("aria-labelledby") ||
    one.closest("[aria-label]") || one.closest("label") || one.title))
  .map((one) => one.outerHTML.slice(0, 200))"""

FAINT = """(() => {
  const parts = (words) => (words.match(/[\\d.]+/g) ?? []).map(Number);
  const light = ([r, g, b]) => {
    const [x, y, z] = [r, g, b].map((v) => v / 255).map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * x + 0.7152 * y + 0.0722 * z;
  };
  const paper = (one) => {
    for (let at = one; at; at = at.parentElement) {
      const [r, g, b, a = 1] = parts(getComputedStyle(at).backgroundColor);
      if (a > 0.99) return [r, g, b];
    }
    return [255, 255, 255];
  };
  const found = [];
  for (const one of document.querySelectorAll("body *")) {
    const own = [...one.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    if (!own || !one.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    if (one.closest("i, .disabled, [disabled]")) continue;
    let opacity = 1;
    for (let at = one; at; at = at.parentElement) opacity *= Number(getComputedStyle(at).opacity);
    const back = paper(one), [r, g, b, a = 1] = parts(getComputedStyle(one).color);
    const ink = [r, g, b].map((v, i) => v * a * opacity + back[i] * (1 - a * opacity));
    const [high, low] = [light(ink), light(back)].sort((x, y) => y - x), contrast = (high + 0.05) / (low + 0.05);
    if (contrast < 4.5) found.push(`${one.textContent.trim().slice(0, 40)}: ${contrast.toFixed(2)}`);
  }
  return found;
})()"""


def test_a_printer(studio, tmp_path):
    """Two files are dropped; both choices, why, the picture and the lines to paste are there, after a reload, too."""
    record = Path(__file__).parents[1] / "experiments" / "calibration" / "raw_data_x_simulated.csv"
    (tmp_path / "raw_data_y.csv").write_bytes(record.read_bytes())
    (tmp_path / "raw_data_x.csv").write_text("nothing\n")
    said = "document.querySelector('[data-testid=said-calibrate]').innerText"
    with opened(studio) as page:
        page.get_by_role("tab", name="Printer").click()
        page.locator("[data-testid=calibrate]").click()
        page.get_by_text("drop a file first").wait_for()
        with page.expect_file_chooser() as chooser:
            page.locator("[data-testid=records] .q-btn").last.click()
        chooser.value.set_files([tmp_path / "raw_data_x.csv", tmp_path / "raw_data_y.csv"])
        page.get_by_label("remove raw_data_y.csv").wait_for()
        page.locator("[data-testid=calibrate]").click()
        page.wait_for_function(f"{said}.includes('raw_data_x.csv:1: the file must begin')", timeout=30_000)
        page.get_by_label("remove raw_data_x.csv").click()
        page.locator("[data-testid=calibrate]").click()
        page.wait_for_function(f"{said}.startsWith('done')", timeout=90_000)
        for _ in range(2):
            assert "shaper_type_y: mzv" in page.locator("[data-testid=paste]").inner_text()
            assert "Klipper's choice: mzv" in page.locator("[data-testid=axis-y]").inner_text()
            assert not page.locator("[data-testid=axis-x]").is_visible()
            until(page, lambda: curve(page, "printer-y"))
            assert max(curve(page, "printer-y")) == 1
            page.reload()
            computed(page)


def test_another_machine_and_a_telephone(studio):
    with opened(studio, width=390, height=844) as page:
        before = page.locator("[data-testid=summary]").inner_text()
        choose(page, "Crane")
        assert page.locator("[data-testid=summary]").inner_text() != before
        assert "residual energy" in page.locator("[data-testid=summary]").inner_text()
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert page.locator("#scene").is_visible()


def test_dark_and_light(studio):
    """The colours of the page change and stay after a reload; so do those of a chart that is made later."""
    text = "getComputedStyle(document.body).backgroundColor"
    with opened(studio) as page:
        light = page.evaluate(text)
        page.locator("[data-testid=dark]").click()
        page.wait_for_function(f"{text} !== {json.dumps(light)}")
        page.reload()
        computed(page)
        assert page.evaluate(text) != light
        element = page.locator("[data-testid=chart-position]").get_attribute("id")[1:]
        colour = page.evaluate(f"getElement({element}).chart.getOption().title[0].textStyle.color")
        assert colour == charts.colours(True)["title"]["textStyle"]["color"]


def test_a_click_before_the_answer_to_the_last_one_counts(studio):
    """To another panel and back at once: without waiting for the server the last click decides."""
    with opened(studio) as page:
        page.evaluate(
            """async () => { for (const i of [2, 0]) { document.querySelectorAll("[role=tab]")[i].click();
            await new Promise(requestAnimationFrame); } }"""
        )
        press(page, "slider-plant.m2")
        assert page.locator("[role=tab][aria-selected=true]").inner_text() == "Machine"
        assert page.locator('[data-testid="slider-plant.m2"]').is_visible()


def test_a_link_opens_what_it_was_made_of(studio):
    with opened(studio) as page:
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        page.evaluate("navigator.clipboard.writeText('')")
        press(page, "slider-plant.m2", times=8)
        page.get_by_role("tab", name="Take away").click()
        page.locator("[data-testid=link]").click()
        # The copy takes a moment.
        until(page, lambda: "?state=" in page.evaluate("navigator.clipboard.readText()"))
        address = page.evaluate("navigator.clipboard.readText()")
        summary = page.locator("[data-testid=summary]").inner_text()
        other = page.context.new_page()
        other.goto(address)
        assert computed(other) == summary
        assert other.get_by_label("m2", exact=True).first.input_value() == "1.11"
        press(other, "slider-plant.m2", times=2)
        changed = other.get_by_label("m2", exact=True).first.input_value()
        other.reload()
        computed(other)
        assert other.get_by_label("m2", exact=True).first.input_value() == changed
        other.goto(address.split("=")[0] + "=broken")
        computed(other)
        other.get_by_text("the link is damaged").wait_for()


def test_tabs_are_independent(studio):
    with opened(studio) as first:
        second = first.context.new_page()
        second.goto(studio[0])
        computed(second)
        press(first, "slider-plant.m2", times=8)
        assert second.get_by_label("m2", exact=True).first.input_value() == "1"
        first.reload()
        computed(first)
        assert first.get_by_label("m2", exact=True).first.input_value() == "1.11"


def status(url, **headers):
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers)) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def test_strangers_get_nothing(studio):
    base, token = studio[0].split("/?token=")
    cookie = {"Cookie": f"jshape_studio_{base.rpartition(':')[2]}={token}"}
    assert status(base) == 403
    assert status(f"{base}/?token=guess") == 403
    assert status(base, **cookie) == 200
    assert status(base, **cookie, Origin="http://evil.example") == 403
    assert status(base, **cookie, Host="evil.example") == 403
    for path in ("/_nicegui/../../../../etc/passwd", "/_nicegui/%2e%2e/%2e%2e/%2e%2e/etc/passwd", "/etc/passwd"):
        assert status(base + path, **cookie) in (400, 403, 404)
    socket = f"{base}/_nicegui_ws/socket.io/?EIO=4&transport=polling"
    assert status(socket) == 403
    assert status(socket, **cookie, Origin="http://evil.example") == 403


def open_panel(page, name):
    page.get_by_role("tab", name=name).click()


def move_a_slider(page, draw):
    open_panel(page, "Machine")
    sliders = page.locator("[data-testid^=slider-] [tabindex]")
    sliders.first.wait_for()
    sliders.nth(draw.randrange(sliders.count())).focus()
    for _ in range(draw.randrange(1, 6)):
        page.keyboard.press(draw.choice(["ArrowRight", "ArrowLeft", "PageUp", "Home", "End"]))


def click_on_the_shaper(page, draw):
    open_panel(page, "Shaper")
    name = draw.choice(["ZV", "ZVD", "EI", "add", "remove", "unshaped", "Pin this design", "Compute"])
    page.get_by_role("button", name=name, exact=True).click(force=True)
    page.locator("[data-testid=stop-pareto]").click(force=True)


def unpin(page, draw):
    open_panel(page, "Shaper")
    rows = page.get_by_label("remove ")
    if rows.count():
        rows.first.click()


def drag_anything(page, draw):
    open_panel(page, draw.choice(["Machine", "Shaper"]))
    page.locator("[data-testid=chart-impulses]").wait_for()
    box = page.locator("[data-testid=chart-impulses]").bounding_box()
    place = lambda: (box["x"] + draw.random() * box["width"], box["y"] + draw.random() * box["height"])
    page.mouse.move(*draw.choice([place(), bar(page, 0)]))
    page.mouse.down()
    for _ in range(draw.randrange(4)):
        page.mouse.move(*place())
    page.mouse.up()


def type_nonsense(page, draw):
    open_panel(page, "Machine")
    fields = page.locator(".studio-number input")
    fields.first.wait_for()
    words = draw.choice(["", "-1", "0", "1e300", "nan", "abc", "0.5", "1e-300"])
    fields.nth(draw.randrange(fields.count())).press_sequentially(words)


def take_something_away(page, draw):
    open_panel(page, "Take away")
    page.get_by_role("button", name=draw.choice(["Show", "Copy link"])).click()


def turn_the_page(page, draw):
    page.locator("[data-testid=dark]").click()
    open_panel(page, "Printer")
    page.locator("[data-testid=calibrate]").click()
    open_panel(page, "Learn")
    page.locator("[data-testid=stop-episode]").click(force=True)


def begin_anew(page, draw):
    open_panel(page, "Machine")
    before, machine = changes_of(page), page.get_by_role("combobox", name="machine")
    other = [title for title in map(state.plants().get, MACHINES) if title != machine.input_value()]
    machine.click()
    page.get_by_role("option", name=draw.choice(other)).click()
    # Its sliders, not its curves.
    until(page, lambda: changes_of(page) > before)


MACHINES = ("TwoMass", "Crane", "DoublePendulumCrane", "TowerCrane", "FlexibleLink", "TwoLinkArm")
"""Those between which the random actions change; nonsense that was typed ends there, too."""


ACTIONS = {
    begin_anew: 1, move_a_slider: 10, click_on_the_shaper: 3, drag_anything: 4, type_nonsense: 2, unpin: 1,
    take_something_away: 1, turn_the_page: 1,
}  # fmt: skip


def test_random_actions(studio):
    """At the end the page still answers, nothing was reported, and the server's memory is bounded."""
    draw = random.Random(0)
    with opened(studio) as page:
        page.set_default_timeout(60_000)
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        most = 0.0
        for number in range(ACTIONS_MADE):
            draw.choices(list(ACTIONS), ACTIONS.values())[0](page, draw)
            most = max(most, memory(studio[1]))
            if number % 100 == 99:
                print(f"{number + 1} actions: {memory(studio[1]):.0f} MB, at most {most:.0f}", flush=True)
        # What a single state needs above that at which programs go.
        assert most < HELD + 300
        open_panel(page, "Machine")
        choose(page, "Crane")
        choose(page, "TwoMass")
        until(page, lambda: "residual energy" in page.locator("[data-testid=summary]").inner_text())


def processes(studio):
    """Those in which the server computes, by their ids."""
    children = Path(f"/proc/{studio[1].pid}/task/{studio[1].pid}/children").read_text().split()
    return [int(pid) for pid in children if b"jshape.studio.work" in Path(f"/proc/{pid}/cmdline").read_bytes()]


def test_a_killed_process_and_a_lost_connection(studio):
    """A process that is killed from outside is said to have ended; a connection that comes back shows the state."""
    with opened(studio) as page:
        press(page, "slider-plant.m2", times=8)
        open_panel(page, "Shaper")
        page.locator("[data-testid=tune]").click()
        said = "document.querySelector('[data-testid=said-tune]').innerText"
        page.wait_for_function(f"{said}.includes('process starts')")
        until(page, lambda: processes(studio))
        (tuning,) = processes(studio)
        os.kill(tuning, signal.SIGKILL)
        page.wait_for_function(f"{said}.includes('ended without an answer')")
        assert page.locator("[data-testid=tune]").is_enabled()
        page.context.set_offline(True)
        page.wait_for_timeout(500)
        page.context.set_offline(False)
        page.reload()
        computed(page)
        open_panel(page, "Machine")
        assert page.get_by_label("m2", exact=True).first.input_value() == "1.11"


def title(page, chart):
    element = page.locator(f"[data-testid=chart-{chart}]").get_attribute("id")[1:]
    return page.evaluate(f"getElement({element}).chart.getOption().title[0].text")


def test_a_chart_shows_its_other_thing(studio):
    """Energy against position in the place of the sway, the spectrum in that of V; both stay after a reload."""
    with opened(studio) as page:
        sway = curve(page, "deflection", 1)
        page.locator("[data-testid=view-deflection]").get_by_role("button", name="Energy").click()
        page.locator("[data-testid=view-vibration]").get_by_role("button", name="Spectrum").click()
        until(page, lambda: "Spectrum" in title(page, "vibration"))
        for _ in range(2):
            assert title(page, "deflection") == "Energy against position"
            # Without a shaper all of the energy is there from the step on.
            unshaped, shaped = (curve(page, "deflection", i) for i in range(2))
            assert unshaped[-1] == pytest.approx(30, abs=1e-3)
            assert min(unshaped[1:]) == pytest.approx(30, abs=1e-3)
            assert shaped != sway
            page.reload()
            computed(page)
        press(page, "slider-plant.m2")
        assert title(page, "vibration") == "Spectrum of the response"


def test_both_ends_of_what_is_uncertain_are_drawn(studio):
    """Light and heavy beside nominal, which lies between them."""
    with opened(studio) as page:
        page.wait_for_function("jshapeScene.data.note")
        assert page.evaluate("Object.keys(jshapeScene.data.places)") == ["high", "unshaped", "shaped", "low"]
        assert re.search(r"small 0\.8.*, large 1\.2", page.locator("#scene-note").inner_text())


def test_a_chart_as_svg(studio, tmp_path):
    with opened(studio) as page:
        open_panel(page, "Take away")
        with page.expect_download() as waiting:
            page.locator("[data-testid=svg]").click()
        assert waiting.value.suggested_filename == "position.svg"
        waiting.value.save_as(tmp_path / "position.svg")
        made = ElementTree.parse(tmp_path / "position.svg").getroot()
        assert made.tag.endswith("svg")
        words = ["".join(each.itertext()).strip() for each in made.iter() if each.tag.endswith("text")]
        assert {"Response", "shaped", "unshaped", "time (s)"} <= set(words)
        curves = [each.get("d") for each in made.iter() if each.get("stroke") == charts.LOOK["shaped"]["color"]]
        assert max(len(each.split()) for each in curves) > 200


def test_a_measured_record_becomes_a_machine(studio, tmp_path):
    """A ring-down at 2 Hz that is dropped is a machine of 2 Hz; one that is none is refused with its line."""
    times = np.arange(0, 10, 0.02)
    values = np.exp(-0.02 * 4 * np.pi * times) * np.cos(4 * np.pi * times)
    values += 1e-3 * np.random.default_rng(0).standard_normal(len(times))
    rows = [f"{t:.3f},{x:.6f}" for t, x in zip(times, values, strict=True)]
    (tmp_path / "ringing.csv").write_text("\n".join(["t,x", *rows]))
    (tmp_path / "broken.csv").write_text("\n".join(["t,x", *rows[:9], "0.2,many"]))
    said = "document.querySelector('[data-testid=said-identify]').innerText"
    with opened(studio) as page:
        upload(page, tmp_path / "broken.csv")
        page.get_by_role("button", name="Find its modes").click()
        page.wait_for_function(f"{said}.includes('broken.csv:11: x')", timeout=60_000)
        upload(page, tmp_path / "ringing.csv")
        page.get_by_text("ringing.csv: time").wait_for()
        changed_by(page, page.get_by_role("button", name="Find its modes").click)
        until(page, lambda: page.get_by_label("omega.0", exact=True).count())
        omega = float(page.get_by_label("omega.0", exact=True).first.input_value())
        assert omega == pytest.approx(4 * np.pi, rel=1e-3)
