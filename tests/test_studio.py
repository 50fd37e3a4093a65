"""The studio without a browser: a page's state, its curves, what it gives away, and who may talk to it."""

import asyncio
import base64
import dataclasses
import gc
import itertools
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import numpy as np
import pytest
from typer.testing import CliRunner

import jshape as js
from jshape.cli import app
from jshape.design.closed_forms import closed_forms
from jshape.export import FORMATS
from jshape.problems import catalogue, limits
from jshape.problems.problem import load
from jshape.problems.reading import read, shipped
from jshape.studio import (
    changes,
    charts,
    curves,
    drawings,
    episodes,
    link,
    own_code,
    panel_charts,
    results,
    state,
    takeaway,
    words,
    work,
)
from jshape.studio.guard import MOST, MOST_UPLOADED, Guard
from jshape.studio.live import Live
from jshape.studio.panels import learn
from jshape.studio.panels.printer import file_name
from jshape.studio.panels.shaper import ENERGY, SHAPERS
from jshape.studio.tab import FARTHEST
from jshape.studio.work import Work


def every(shown):
    """The results of a page's state, one after the other."""
    stages = (stage for stage in curves.stages(shown) if isinstance(stage, tuple))
    return itertools.chain.from_iterable(stages)


def drafted(folder, text):
    path = folder / "problem.toml"
    path.write_text(text, encoding="utf-8")
    return read(path)


@pytest.mark.parametrize("name", ["paper_000", "paper_000_damped", "paper_001", "paper_002", "paper_003"])
def test_a_problem_file_comes_back_with_the_same_numbers(name, tmp_path):
    """The file that the page writes has the plant, the move, the uncertain set and the design of the first."""
    first = load(shipped()[name])
    shown = state.from_text(shipped()[name].read_text(encoding="utf-8"))
    again = load(drafted(tmp_path, shown.text))
    assert type(again.plant) is type(first.plant)
    for a, b in zip(leaves(first), leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
    tuning, other = first.tuning, again.tuning
    assert {k: v for k, v in tuning.items() if k != "over"} == {k: v for k, v in other.items() if k != "over"}


def leaves(problem):
    return [*jax.tree.leaves((problem.plant, problem.distance)), *problem.over.values()]


@pytest.mark.parametrize("plant", state.plants())
def test_every_slider_reaches_the_problem_file(plant, tmp_path):
    """A value that a slider gives is the one that ``jshape tune`` reads; the others stay."""
    shown = state.begin(plant)
    before = {parameter.path: parameter.value for parameter in state.parameters(shown)}
    assert before
    for path, value in before.items():
        wanted = 1.01 * value + 0.003
        changed = changes.with_value(shown, path, wanted)
        drafted(tmp_path, changed.text)
        after = {parameter.path: parameter.value for parameter in state.parameters(state.from_text(changed.text))}
        assert after == before | {path: wanted}


def test_what_a_page_can_show():
    shown = state.plants()
    assert {"TwoMass", "DoublePendulumCrane", "ModalPlant", "FlexibleLink"} <= set(shown)
    assert "TowerCrane" in shown
    assert not {"MJCF", "URDF"} & set(shown)
    assert all(name in catalogue.plants() for name in shown)
    with pytest.raises(ValueError, match="plant must be one of Crane"):
        state.begin("Nothing")
    with pytest.raises(ValueError, match=r"path must be one of plant\.m1"):
        changes.with_value(state.begin("TwoMass"), "plant.m3", 1.0)


MOVE = 'distance = 1.0\n[plant]\ntype = "TwoMass"\nspring = { type = "LinearSpring", k = 10.0 }\n'

REFUSED = {
    "runs no code": MOVE.replace("TwoMass", "os:system"),
    "is described in another file": 'distance = 1.0\n[plant]\ntype = "MJCF"\nfile = "double_pendulum_crane.xml"\n'
    'driven = { slide = "trolley" }\n',
    "URDF is described in another file": 'distance = 1.0\n[plant]\ntype = "URDF"\nfile = "../../../etc/passwd"\n',
    "which the studio does not open": MOVE.replace("TwoMass", "Linearised")
    + '[plant.plant]\ntype = "MJCF"\nfile = "/etc/passwd"\n',
    "at most 1048576 bytes": MOVE + "#" * (limits.SIZE + 1),
    "malformed TOML": MOVE + "[[[",
    "unknown plant": MOVE.replace("TwoMass", "TwoMas"),
    "and lists are inside": MOVE + "a = " + "[" * 40 + "]" * 40,
}


@pytest.mark.parametrize("words", REFUSED)
def test_uploads_are_data_and_bounded(words):
    with pytest.raises(ValueError, match=words) as raised:
        state.from_text(REFUSED[words])
    assert "root:" not in str(raised.value)
    assert "/tmp" not in str(raised.value)


SHIPPED = Path(js.__file__).parent / "problems"
MACHINE = (SHIPPED / "double_pendulum_crane.xml").read_bytes()


def test_a_machine_of_a_file_is_data():
    """An MJCF file begins a problem whose text and file come back, and whose numbers are those of the file."""
    shown = state.from_machine("crane.xml", MACHINE)
    assert shown.starter.values == {"file": "crane.xml", "driven": {"slide": "axis"}}
    found = {p.path: (p.value, p.unit, p.fixed) for p in state.parameters(shown)}
    assert found["plant.body.load.mass"] == (4000.0, "kg", True)
    assert found["command.distance"] == (1.0, "m", False)
    marked = changes.with_uncertainty(shown, "body.load.mass", 0.3)
    again = state.from_text(marked.text, marked.files)
    assert (again.text, again.files) == (marked.text, shown.files)
    with pytest.raises(ValueError, match=r"drop 'crane\.xml' first"):
        state.from_text(marked.text)
    with pytest.raises(ValueError, match="a link carries no file"):
        link.packed(shown)
    hinge = state.from_machine("gantry.urdf", (SHIPPED / "gantry.urdf").read_bytes(), "bend")
    assert {p.path: p.unit for p in state.parameters(hinge)}["command.distance"] == "rad"
    with pytest.raises(ValueError, match="driven must be one of rail, bend, not 'wheel'"):
        state.from_machine("gantry.urdf", (SHIPPED / "gantry.urdf").read_bytes(), "wheel")


def test_a_command_for_an_axis_of_a_plant_that_has_one_is_refused():
    text = state.begin("ModalPlant").text
    with pytest.raises(ValueError, match=r"command\.trolley: the studio shows one command of a ModalPlant"):
        state.from_text(text.replace("[command]", "[command.trolley]"))


def test_sliders_end_at_finite_numbers():
    shown = changes.with_value(state.begin("TwoMass"), "plant.m1", 1e308)
    for parameter in state.parameters(shown):
        assert np.isfinite([parameter.low, parameter.high]).all()
        assert parameter.low <= parameter.value <= parameter.high


def within(part):
    return f"<mujoco><worldbody>{part}</worldbody></mujoco>".encode()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"<" * (limits.SIZE + 1), "at most 1048576 bytes"),
        (b"\xff\xfe<", "cannot be read as text"),
        (b"hello", "neither MJCF nor URDF"),
        (b"<mujoco>", "MuJoCo cannot read it"),
        (b'<mujoco><include file="/etc/passwd"/></mujoco>', "names other files or code"),
        (b'<mujoco><asset><mesh file\n=\n"a.obj"/></asset></mujoco>', "names other files or code"),
        (b'<mujoco><asset><texture fileright="a.png"/></asset></mujoco>', "names other files or code"),
        (b'<robot name="a"><link name="b"><visual><mesh filename="a"/></visual></link></robot>', "names other files"),
        (b'<!DOCTYPE a [<!ENTITY b SYSTEM "/etc/passwd">]><mujoco/>', "names other files or code"),
        (b'<mujoco><extension><plugin plugin="a"/></extension></mujoco>', "names other files or code"),
        (within('<replicate count="100000"><geom size="1"/></replicate>'), "copies of a part"),
        (within('<geom size="1"/>'), "has no joint that could be driven"),
    ],
)
def test_files_of_machines_are_bounded_and_name_no_other(content, words):
    with pytest.raises(ValueError, match=words) as raised:
        state.from_machine("hostile.xml", content)
    assert "root:" not in str(raised.value)


@pytest.mark.slow
def test_a_machine_of_a_file_swings_as_the_problem_of_its_own_file():
    """What the page computes of a dropped file is what the library computes of the file."""
    shown = changes.with_impulses(state.from_machine("crane.xml", MACHINE), [0.5, 0.5], [0.0, 1.5])
    found = {type(result): result for result in every(shown)}
    plant = js.plants.from_mjcf(SHIPPED / "double_pendulum_crane.xml", {"slide": "axis"})
    left = js.residual_energy(plant, js.Shaper([0.5, 0.5], [0.0, 1.5]), js.Trapezoid(1.0, 0.5, 0.5))
    assert found[results.Numbers].shaped == pytest.approx(float(left), rel=1e-9)
    scene = found[results.Moves].scene
    assert scene["kind"] == "bodies"
    assert np.all(np.isfinite(scene["places"]["shaped"]))
    with pytest.raises(ValueError, match=r"^crane\.xml: |driven"):
        state.problem(shown.text.replace('slide = "axis"', 'nothing = "axis"'), shown.files)


@pytest.mark.slow
def test_an_episode_under_two_strategies():
    """Both make the same moves with the same payloads; what each leaves is what its moves one by one leave."""
    pytest.importorskip("gymnasium")
    from jshape_envs import move, parameters, reset
    from jshape_envs.strategies import strategy

    asked = {"environment": "CranePayload", "preset": "paper", "strategies": ["zv", "zvd"], "moves": 3, "seed": 5}
    found = episodes.episode(asked, lambda *_: None)
    assert found["kind"] == "crane"
    assert len(found["places"][0]) == len(found["places"][1]) == len(found["times"])
    assert len(found["begins"]) == len(found["moves"]) == 3
    params = parameters("CranePayload")
    for i, name in enumerate(asked["strategies"]):
        first, *keys = jax.random.split(jax.random.key(5), 4)
        now, observation = reset(first, params)
        policy = strategy(name, "CranePayload", params)
        memory = policy.init(params)
        for key, row in zip(keys, found["moves"], strict=True):
            assert (row["payload"], row["distance"]) == pytest.approx((float(now.payload), float(now.distance)))
            memory, shaper = policy.act(memory, observation, params, now)
            now, observation, _, _, _, info = move(key, now, shaper, params)
            assert row["residuals"][i] == pytest.approx(float(info.residual), rel=2e-3, abs=1e-6)
    drawn = drawings.episode(found, ["A", "B"])
    assert drawn["titles"] == ["A", "B"]
    assert len(panel_charts.residuals(found, ["A", "B"])["series"][1]["data"]) == 3


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"moves": 13}, "moves must be a whole number from 1 to 12, not 13"),
        ({"moves": None}, "moves must be a whole number"),
        ({"seed": -1}, "seed must be a whole number from 0"),
        ({"strategies": ["zv"]}, "strategies must be two"),
        pytest.param({"strategies": ["zv", "mine.npz"]}, "strategy must be one of", marks=pytest.mark.slow),
        pytest.param({"environment": "../x"}, "environment must be", marks=pytest.mark.slow),
    ],
)
def test_what_an_episode_is_asked_for_is_bounded(asked, words):
    pytest.importorskip("gymnasium")
    given = {"environment": "CranePayload", "preset": "easy", "strategies": ["zv", "ei"], "moves": 1, "seed": 0}
    with pytest.raises(ValueError, match=words):
        episodes.episode(given | asked, lambda *_: None)


@pytest.mark.slow
def test_a_leaderboard_has_the_scores_of_the_command(monkeypatch):
    """On the same episodes; an interrupt keeps those that were judged."""
    pytest.importorskip("gymnasium")
    from jshape_envs import parameters, strategies
    from jshape_envs.evaluate import evaluate
    from jshape_envs.families import Declared

    def until_the_third(stage, done, total, best):
        if done == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(strategies, "strategies", lambda *_: ["zv", "zvd", "ei"])
    asked = {"environment": "CranePayload", "preset": "paper", "episodes": 2, "seeds": 2}
    found = episodes.leaderboard(asked, until_the_third)
    assert [row["policy"] for row in found["rows"]] == ["zv", "zvd"]
    params = parameters("CranePayload")
    scores = evaluate(Declared(strategies.strategy("zv", "CranePayload", params), params), params, 2, 2)
    assert found["rows"][0]["regret"] == pytest.approx(1000 * np.mean(scores.regret))
    assert found["message"] == "2 of 3 strategies judged"


def test_the_strategies_that_the_page_names_are_those_that_there_are():
    pytest.importorskip("gymnasium")
    from jshape_envs import ENVIRONMENTS
    from jshape_envs.baselines import BASELINES

    assert set(learn.STRATEGIES) == {*BASELINES, "trained", "guarded"}
    assert set(words.ENVIRONMENTS) == set(ENVIRONMENTS)
    assert all(set(learn.PRESETS) == set(each.presets) for each in ENVIRONMENTS.values())


def contrast(one, other):
    """The contrast of two colours, ``#rrggbb``, as WCAG 2.2 defines it."""

    def luminance(colour):
        parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(("dark", "paper"), [(False, "#ffffff"), (True, "#121212")])
def test_contrast_is_that_of_wcag_aa(dark, paper):
    """Words 4.5, lines and handles 3, on a light page and on a dark one."""
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    words = charts.colours(dark)
    assert contrast(words["title"]["textStyle"]["color"], paper) >= 4.5
    assert contrast(words["tooltip"]["textStyle"]["color"], words["tooltip"]["backgroundColor"]) >= 4.5
    lines = {look["color"] for look in (*charts.LOOK.values(), *charts.PINS)} | set(charts.OTHERS)
    least = {colour: contrast(colour, paper) for colour in lines}
    assert min(least.values()) >= 3, least


@pytest.mark.slow
def test_code_runs_where_it_is_allowed(monkeypatch):
    """A plant of the user's own has its sliders, comes back, and has the energy of its class."""
    text = shipped()["own_plant"].read_text(encoding="utf-8")
    with pytest.raises(ValueError, match="unless it is started with --allow-code"):
        state.from_text(text)
    monkeypatch.setattr(own_code, "CODE", own_code.Code())
    own_code.allow_code(shipped()["own_plant"].parent)
    shown = state.from_text(text)
    assert state.from_text(shown.text).text == shown.text
    shown = changes.with_value(shown, "plant.m", 2.5)
    assert {p.path: p.value for p in state.parameters(shown)}["plant.m"] == 2.5
    left = next(result for result in every(shown) if isinstance(result, results.Numbers))
    problem = state.problem(shown.text)
    assert float(problem.plant.m) == 2.5
    assert left.unshaped == pytest.approx(float(js.residual_energy(problem.plant, None, problem.distance)), rel=1e-9)


AXES = ["HoistingCrane", "BridgeCrane", "TowerCrane", "BoomCrane", "TwoLinkArm", "PlanarModes"]


@pytest.mark.parametrize("plant", AXES)
def test_machines_of_several_axes_come_back(plant):
    shown = state.begin(plant)
    again = state.from_text(shown.text)
    assert again == dataclasses.replace(shown, starter=again.starter)
    values = [{p.path: p.value for p in state.parameters(each)} for each in (shown, again)]
    assert values[0] == values[1]
    assert state.from_text(again.text).text == again.text
    assert shown.axis == state.axes(shown)[0]
    assert bool(shown.own) == (state.problem(shown.text).tuning["shapers"] == "per axis")


def test_moves_that_the_page_does_not_write_are_refused():
    text = state.begin("BridgeCrane").text
    assert "[command.bridge]" in text
    with pytest.raises(ValueError, match=r"command\.bridge\.delay: the studio does not show it"):
        state.from_text(text.replace("[command.bridge]", "[command.bridge]\ndelay = 1.0"))


def test_an_axis_keeps_its_own_shaper():
    shown = changes.with_impulses(changes.with_own(state.begin("BridgeCrane"), False), [0.25, 0.75], [0.0, 1.0])
    assert isinstance(curves.shapers_of(shown), js.Shaper)
    fresh = changes.with_one_for_all(state.begin("TowerCrane"), [0.25, 0.75], [0.0, 1.0])
    assert {(each.amplitudes, each.times) for each in fresh.own} == {((0.25, 0.75), (0.0, 1.0))}
    own = changes.with_impulses(changes.with_own(shown, True), [0.5, 0.5], [0.0, 2.0])
    assert state.problem(own.text).tuning["shapers"] == "per axis"
    other = changes.with_axis(own, "bridge")
    assert (other.amplitudes, other.times) == ((0.25, 0.75), (0.0, 1.0))
    assert curves.longest(curves.shapers_of(other)) == 2.0
    assert changes.with_axis(other, "trolley") == own
    pinned = changes.with_pin(other)
    shared = changes.with_own(pinned, False)
    assert shared.own == ()
    assert changes.with_design_of(shared, pinned.pins[0]) == pinned
    again = link.unpacked(link.packed(pinned))
    assert again == dataclasses.replace(pinned, starter=again.starter)
    assert state.from_text(again.text).text == again.text
    with pytest.raises(ValueError, match="axis must be one of trolley, bridge, not 'hoist'"):
        changes.with_axis(shown, "hoist")
    with pytest.raises(ValueError, match="axis must be one of none, not 'bridge'"):
        changes.with_axis(state.begin("Crane"), "bridge")
    assert "'bridge': js.Shaper(" in takeaway.script(pinned)
    assert takeaway.exported(other, "json", {})[0] == "shaper_bridge.json"


@pytest.mark.slow
def test_a_move_of_several_axes_ends_with_the_last_of_them():
    begun = state.begin("BridgeCrane")
    short = re.sub(r"(?s)(\[command\.bridge\].*?distance = )[^#\n]*", r'\1"0.2 m" ', begun.text)
    shown = dataclasses.replace(
        changes.with_own(state.from_text(short), True),
        amplitudes=(0.5, 0.5), times=(0.0, 0.1), own=(state.Pin("bridge", (0.5, 0.5), (0.0, 2.0)),),
    )  # fmt: skip
    problem = state.problem(shown.text)
    commands = dict(problem.distance.items())
    found = curves.numbers(problem, curves.pair(curves.shapers_of(shown)))
    assert found.duration == 2.0
    ends = float(commands["trolley"].duration) + 0.1, float(commands["bridge"].duration) + 2.0
    assert ends[0] > ends[1]
    assert found.move_time == pytest.approx(ends[0], rel=1e-12)


@pytest.mark.slow
def test_curves_of_several_axes():
    """What is left of a bridge crane with a shaper for each axis; where its payload is, seen from above."""
    shown = changes.with_impulses(changes.with_own(state.begin("BridgeCrane"), True), [0.5, 0.5], [0.0, 2.0])
    shown = changes.with_uncertainty(shown, "cable_length", None)
    shown = changes.with_axis(shown, "bridge")
    found = {type(result): result for result in every(shown)}
    problem = state.problem(shown.text)
    shapers = {"trolley": js.Shaper([0.5, 0.5], [0.0, 2.0]), "bridge": js.Shaper(shown.amplitudes, shown.times)}
    left = js.residual_energy(problem.plant, shapers, problem.distance)
    assert found[results.Numbers].shaped == pytest.approx(float(left), rel=1e-6)
    assert found[results.Numbers].duration == 2.0
    moves = found[results.Moves]
    # The bridge moves by 3 m, the trolley by 8 m.
    assert moves.position["command"][-1] == pytest.approx(3.0)
    assert moves.scene["kind"] == "above"
    trolley, payload = np.moveaxis(moves.scene["places"]["shaped"], 1, 0)
    np.testing.assert_allclose(trolley[-1], [8.0, 3.0], atol=1e-9)
    at = moves.scene["times"]
    np.testing.assert_allclose(payload[:, 1], np.interp(at, moves.times, moves.position["shaped"]), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["TowerCrane", "HoistingCrane", "TwoLinkArm"])
def test_drawings_of_several_axes(plant):
    """At rest before and after the move the parts are where the geometry says."""
    shown = changes.with_uncertainty(state.begin(plant), next(iter(state.begin(plant).starter.uncertain)), None)
    moves = next(every(shown))
    first = moves.scene["places"]["shaped"][0]
    expected = {
        "TowerCrane": [[0, 0], [15, 0], [15, 0]],
        "HoistingCrane": [[0, 0], [0, -6.5]],
        "TwoLinkArm": [[0, 0], [0.5, 0], [0.5 + 0.4 * np.cos(np.pi / 6), 0.4 * np.sin(np.pi / 6)]],
    }
    np.testing.assert_allclose(first, expected[plant], atol=1e-9)
    if plant == "TowerCrane":
        trolley = next(every(changes.with_axis(shown, "trolley"))).position
        assert trolley["command"][[0, -1]] == pytest.approx([15.0, 25.0])
        driven = moves.scene["places"]["shaped"][-1, 1]
        np.testing.assert_allclose(driven, 25 * np.array([np.cos(np.radians(40)), np.sin(np.radians(40))]), atol=1e-6)


def test_tables_that_the_page_does_not_write_are_named(tmp_path):
    text = shipped()["paper_001"].read_text(encoding="utf-8")
    assert state.left_out(drafted(tmp_path, state.from_text(text).text)) == []
    assert state.left_out(drafted(tmp_path, MOVE + "[pareto]\nstarts = 3\n")) == ["[pareto]"]


def test_uncertainty_and_its_objective():
    shown = changes.with_uncertainty(state.begin("Crane"), "cable_length", None)
    assert shown.starter.uncertain == {}
    assert state.problem(shown.text).objective == "nominal"
    both = changes.with_uncertainty(changes.with_uncertainty(shown, "damping", 0.1), "payload_mass", 0.3)
    # What was marked last is drawn.
    assert list(both.starter.uncertain) == ["payload_mass", "damping"]
    marked = changes.with_uncertainty(shown, "payload_mass", 0.3)
    found = state.problem(marked.text)
    assert found.objective == "worst"
    np.testing.assert_allclose(found.over["payload_mass"][[0, -1]], [0.7, 1.3])
    assert {p.path: p.share for p in state.parameters(marked)}["plant.payload_mass"] == pytest.approx(0.3)
    asked = changes.with_design(changes.with_design(shown, objective="nominal"), duration=2.0)
    assert state.problem(changes.with_uncertainty(asked, "payload_mass", 0.3).text).objective == "worst"
    with pytest.raises(ValueError, match=r"share must lie between 0 and 1, not 1\.5"):
        changes.with_uncertainty(shown, "payload_mass", 1.5)
    # Ends in a unit of their own: half of 5 … 8 m of a cable of 6.5 m.
    (cable,) = [p for p in state.parameters(state.begin("Crane")) if p.leaf == "cable_length"]
    assert cable.share == pytest.approx(1.5 / 6.5)


def test_amplitudes_keep_their_sum_and_times_their_order():
    shown = changes.with_impulses(state.begin("TwoMass"), [0.2, 0.3, 0.5], [0.0, 1.0, 2.0])
    moved = changes.with_amplitude(shown, 0, -0.6)
    assert sum(moved.amplitudes) == pytest.approx(1.0, abs=1e-12)
    assert moved.amplitudes[1] / moved.amplitudes[2] == pytest.approx(0.3 / 0.5)
    alone = changes.with_amplitude(changes.with_impulses(shown, [1.0, 0.0], [0.0, 1.0]), 0, 0.4)
    assert alone.amplitudes == (0.4, 0.6)
    assert changes.with_time(shown, 1, 7.0).times == (0.0, 2.0, 2.0)
    assert changes.with_time(shown, 1, -7.0).times == (0.0, 0.0, 2.0)
    assert changes.with_time(shown, 2, 7.0).times == (0.0, 1.0, 7.0)
    assert changes.with_time(shown, 0, 7.0).times == shown.times
    more = changes.with_one_more(shown)
    assert (more.amplitudes[-1], more.times[-1]) == (0.0, 3.0)
    less = changes.with_one_less(shown)
    np.testing.assert_allclose(less.amplitudes, [0.4, 0.6])
    one = changes.with_one_less(changes.with_one_less(less))
    assert one.amplitudes == (1.0,)
    assert changes.with_amplitude(one, 0, 0.3) == one


def test_designs_to_compare():
    shown = state.begin("TwoMass")
    for number in range(5):
        shown = changes.with_pin(changes.with_impulses(shown, [0.5, 0.5], [0.0, 1.0 + number]))
    names = [pin.name for pin in shown.pins]
    assert names[0] == "A: 2 impulses, 1 s"
    assert [name[0] for name in names] == list("ABCDE")
    with pytest.raises(ValueError, match="at most 5 designs"):
        changes.with_pin(changes.with_impulses(shown, [0.5, 0.5], [0.0, 9.0]))
    less = changes.without_pin(shown, names[1])
    assert [pin.name[0] for pin in less.pins] == list("ACDE")
    with pytest.raises(ValueError, match="pinned already"):
        changes.with_pin(less)
    again = changes.with_pin(changes.with_impulses(less, [1.0], [0.0]))
    assert again.pins[-1].name == "B: 1 impulses, 0 s"
    # The problem file does not depend on them.
    assert again.text == state.begin("TwoMass").text


def test_a_link_carries_the_state():
    """All of it comes back, to the last digit, the title and what the file did not name, too; it opens the command."""
    spring = "{ type = 'LinearSpring', k = 10.0 }"
    shown = state.from_text(f"title = 'mine'\ndistance = 1.0\nplant = {{ type = 'TwoMass', spring = {spring} }}\n")
    shown = changes.with_pin(changes.with_impulses(shown, [0.1, 0.9], [0.0, 1 / 3]))
    shown = changes.with_impulses(changes.with_value(shown, "plant.m2", 1.2345678901234567), [1.1, -0.1], [0.0, 0.7])
    packed = link.packed(shown)
    assert len(packed) < 2000
    again = link.unpacked(packed)
    assert again == shown
    assert link.from_address(f"http://127.0.0.1:8080/?state={packed}") == again
    with pytest.raises(ValueError, match="carries no state"):
        link.from_address("http://127.0.0.1:8080/")


def linked(**changes):
    design = {"axis": "", "impulses": [[0.5, 0.5], [0.0, 1.0]], "own": {}}
    design |= {key: changes.pop(key) for key in list(changes) if key in design}
    data = {"problem": MOVE, "shown": design, "pins": []} | changes
    return base64.urlsafe_b64encode(zlib.compress(json.dumps(data).encode())).decode().rstrip("=")


HOSTILE = {
    "cannot be read": "%%%",
    "at most 16384 characters": "A" * 20_000,
    "at most 131072 bytes": base64.urlsafe_b64encode(zlib.compress(bytes(10_000_000), 9)).decode(),
    "runs no code": linked(problem=REFUSED["runs no code"]),
    "is described in another file": linked(problem=REFUSED["is described in another file"]),
    "must carry problem, shown and pins": linked(more=1),
    "must have axis, impulses and own": linked(shown=[1]),
    "must be those of the machine": linked(axis="bridge"),
    "must be those of the machine, none": linked(own={"bridge": [[1.0], [0.0]]}),
    "text of a problem file": linked(problem=[1]),
    "at most 5 designs": linked(pins=[["A", [1.0], [0.0]]] * 6),
    "two lists of the same length": linked(impulses=[[0.5], [0.0, 1.0]]),
    "must be finite numbers": linked(impulses=[[0.5, 0.5], [0.0, float("inf")]]),
    "must be finite numbers, not words": linked(impulses=[[0.5, 0.5], [0.0, True]]),
    "must be finite numbers of at most": linked(impulses=[[0.5, 0.5], [0.0, 10**400]]),
    "must sum to 1": linked(impulses=[[0.5, 0.6], [0.0, 1.0]]),
    "must increase from 0": linked(impulses=[[0.5, 0.5], [0.0, -1.0]]),
}


@pytest.mark.parametrize("words", HOSTILE)
def test_links_are_data_and_bounded(words):
    with pytest.raises(ValueError, match=words.removesuffix(", not words")):
        link.unpacked(HOSTILE[words])


@pytest.mark.slow
def test_a_design_to_compare_has_the_numbers_that_it_had():
    """What is drawn of a pinned design is what was drawn of it before another took its place."""
    shown = changes.with_impulses(state.begin("TwoMass"), [0.3, 0.7], [0.0, 0.6])
    before = {type(result): result for result in every(shown)}
    later = changes.with_impulses(changes.with_pin(shown), [0.5, 0.5], [0.0, 0.9])
    (pinned,) = [result for result in every(later) if isinstance(result, results.Pinned)]
    assert pinned.numbers == before[results.Numbers]
    np.testing.assert_array_equal(pinned.moves.position["shaped"], before[results.Moves].position["shaped"])
    ends = [found.values["shaped"][[0, -1]] for found in (pinned.sensitivity, before[results.Sensitivity])]
    np.testing.assert_allclose(*ends, rtol=1e-9)
    drawn = charts.position(before[results.Moves], [pinned])["series"]
    assert [line["name"] for line in drawn] == ["unshaped", "shaped", "command", "A"]
    assert drawn[1]["data"] == drawn[3]["data"]


@pytest.mark.slow
def test_curves_of_the_duffing_pair():
    """Without a shaper the undamped pair swings by the whole distance; with the energy shaper nothing is left."""
    shown = state.begin("TwoMass")
    shown = changes.with_impulses(shown, *takeaway.closed_form(shown, "energy 2-impulse"))
    found = {type(result): result for result in every(shown)}
    moves, numbers = found[results.Moves], found[results.Numbers]
    sensitivity, linear = found[results.Sensitivity], found[results.Linear]
    assert moves.warning == ""
    assert (moves.unit, moves.bent) == ("m", "mm")
    np.testing.assert_allclose(np.max(moves.position["unshaped"]), 2.0, rtol=2e-3)
    after = moves.times > shown.times[-1] + 1e-9
    np.testing.assert_allclose(moves.position["shaped"][after], 1.0, atol=1e-6)
    # Energy of the spring k1 x²/2 + k3 x⁴/4 at 1 m.
    assert numbers.unshaped == pytest.approx(10 / 2 + 100 / 4)
    assert numbers.shaped < 1e-12
    assert len(sensitivity.at) == curves.PLANTS == 1000
    # Along the move: without a shaper all of it from the step on, with one nothing after the last impulse.
    np.testing.assert_allclose(moves.energy["unshaped"][1:], 30.0, rtol=1e-9)
    assert np.max(moves.energy["shaped"][after]) < 1e-9
    ends = found[results.Ends]
    np.testing.assert_allclose(ends.at, [0.8, 1.2])
    for name, mass in (("low", 0.8), ("high", 1.2)):
        # By another integrator, of adaptive steps.
        plant = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0), m2=mass)
        run = js.simulate(plant, 1.0, curves.shaper_of(shown), horizon=moves.times[-1], samples=len(moves.times))
        payload = np.interp(moves.scene["times"], run.times, run.payload)
        np.testing.assert_allclose(ends.places[name][:, 1, 0], payload, atol=1e-6)
    assert not sensitivity.draft
    np.testing.assert_allclose(sensitivity.values["unshaped"], 1.0, atol=1e-9)
    nearest = np.argsort(np.abs(sensitivity.at - 1.0))[:2]
    assert np.all(sensitivity.values["shaped"][nearest] < 0.01)
    first = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0), m2=float(sensitivity.at[0]))
    direct = float(js.residual_vibration(first, curves.shaper_of(shown), 1.0))
    assert sensitivity.values["shaped"][0] == pytest.approx(direct, rel=1e-6)
    # Two halves: V is |cos(ω t2 / 2)| without damping.
    expected = np.abs(np.cos(np.pi * linear.frequencies * shown.times[-1]))
    np.testing.assert_allclose(linear.values[0.0], expected, atol=1e-9)
    np.testing.assert_allclose(linear.modes, [np.sqrt(10.0) / (2 * np.pi)])


def test_energy_is_drawn_against_what_moves():
    """Against position; of an axis that rests against time."""
    at = np.array([0.0, 1.0, 2.0])
    runs = {"shaped": at / 2, "unshaped": at}
    moves = results.Moves(at, runs, runs, {"shaped": at**2, "unshaped": at}, "m", "mm", {}, "")
    drawn = charts.energy(moves)
    assert drawn["series"][0]["data"] == [[0.0, 0.0], [0.5, 1.0], [1.0, 4.0]]
    assert drawn["title"]["text"] == words.ENERGY_AGAINST_POSITION
    rests = dataclasses.replace(moves, position=dict.fromkeys(runs, 0 * at))
    assert charts.energy(rests)["series"][0]["data"] == [[0.0, 0.0], [1.0, 1.0], [2.0, 4.0]]
    assert charts.energy(rests)["title"]["text"] == words.ENERGY_AGAINST_TIME


def test_a_shaper_that_cannot_be_is_an_error():
    shown = changes.with_impulses(state.begin("TwoMass"), [0.5, 0.6], [0.0, 1.0])
    with pytest.raises(ValueError, match="amplitudes must sum to 1"):
        next(every(shown))
    broken = changes.with_value(state.begin("TwoMass"), "plant.m2", -1.0)
    with pytest.raises(ValueError, match=r"plant\.m2: must be greater than 0, not"):
        next(every(broken))


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("plant.m2", 1e-300, "m2 must be 0, or lie between 1e-30 and 1e\\+18 in size, not 1e-300"),
        ("distance", -1e300, "distance must be 0, or lie between"),
        # √((k1 + 3 k3 x²) / m2) at 1 m.
        (
            "plant.m2",
            1e-12,
            "mode, 2.802e\\+06 Hz, makes 1.401e.* periods in the 0.5 s that are drawn, of which",
        ),
        ("plant.spring.k3", 1e18, "at most 1000"),
    ],
)
def test_what_would_take_minutes_is_refused(path, value, words):
    """A payload of 1e-300 kg took a run of 26 million steps; the page's one worker computes for all tabs."""
    shown = changes.with_value(state.begin("TwoMass"), path, value)
    with pytest.raises(ValueError, match=words):
        next(curves.stages(shown))
    if "lie between" in words:
        with pytest.raises(ValueError, match=words):
            takeaway.closed_form(shown, takeaway.SIMPLEST)


def test_a_bar_that_is_dragged_far_away_is_refused():
    with pytest.raises(ValueError, match="at most 1000"):
        next(curves.stages(changes.with_time(state.begin("TwoMass"), 1, FARTHEST)))


def test_a_draft_says_so_and_is_not_given_away():
    at = np.array([1.0, 2.0])
    draft = results.Sensitivity("mass (kg)", at, {"shaped": at, "unshaped": at}, "residual energy", True)
    assert "draft" in charts.sensitivity(draft)["title"]["text"]
    with pytest.raises(ValueError, match="there is no sensitivity"):
        takeaway.sensitivity_csv(draft)
    with pytest.raises(ValueError, match="there is no sensitivity"):
        takeaway.sensitivity_csv(None)
    with pytest.raises(ValueError, match="are being computed"):
        takeaway.moves_csv(None)


def test_what_a_shaper_leaves_can_be_read_beside_what_none_leaves():
    """A curve a hundred times as low is not flat: the axis ends above it, and the summary says its greatest value."""
    at, low = np.array([0.8, 1.0, 1.2]), np.array([0.02, 0.0, 0.05])
    found = results.Sensitivity("mass (kg)", at, {"shaped": low, "unshaped": 1 + low}, "residual vibration", False)
    drawn = charts.sensitivity(found)
    assert drawn["yAxis"]["max"] == pytest.approx(5.5)
    assert [each["name"] for each in drawn["series"]] == ["shaped", "unshaped (above)"]
    assert "at worst 5 % vibration" in charts.summary(results.Numbers(0.1, 1.0, 1.0, 2.0), found)
    near = dataclasses.replace(found, values={"shaped": low, "unshaped": 5 * low}, quantity="residual energy")
    assert charts.sensitivity(near)["yAxis"]["max"] is None
    assert "at worst 0.05 J" in charts.summary(results.Numbers(0.1, 1.0, 1.0, 2.0), near)
    assert "worst" not in charts.summary(results.Numbers(0.1, 1.0, 1.0, 2.0), dataclasses.replace(near, draft=True))


def test_what_diverged_is_said():
    numbers = results.Numbers(np.inf, 1.0, 1.0, 2.0)
    assert "diverged" in charts.summary(numbers)
    assert charts.points(np.array([0.0, 1.0]), np.array([np.nan, np.inf])) == [[0.0, None], [1.0, None]]


SHAPER = ([0.25, 0.5, 0.25], [0.0, 0.05, 0.1])


CANNOT = {"on_off": "needs modes", "marlin": "takes the ZV alone"}


@pytest.mark.parametrize("format", FORMATS)
def test_every_format_can_be_taken_away(format, tmp_path):
    """With what the fields hold at first, or with a reason in words."""
    shown = changes.with_impulses(state.begin("TwoMass"), *SHAPER)
    fields = takeaway.needed(format)
    if format in CANNOT:
        with pytest.raises(ValueError, match=CANNOT[format]):
            takeaway.exported(shown, format, fields)
        return
    name, content = takeaway.exported(shown, format, fields)
    assert name.endswith(FORMATS[format].ending)
    assert content
    if format in ("json", "csv"):
        (tmp_path / name).write_bytes(content)
        np.testing.assert_array_equal(js.read_shaper(tmp_path / name).times, SHAPER[1])


def test_fields_of_a_format():
    shown = changes.with_impulses(state.begin("TwoMass"), *SHAPER)
    _, text = takeaway.exported(shown, "scipy", {"sample_time": "0.01", "method": "zeros", "modes": "62.8,0; 80,0.01"})
    assert text
    with pytest.raises(ValueError, match="modes must be pairs omega,zeta"):
        takeaway.exported(shown, "scipy", {"sample_time": "0.01", "modes": "62.8;"})
    with pytest.raises(ValueError, match="sample_time"):
        takeaway.exported(shown, "scipy", {"sample_time": "nan"})
    with pytest.raises(ValueError, match="needs sample_time"):
        takeaway.exported(shown, "scipy", {"sample_time": ""})


def test_closed_forms_by_name():
    shown = state.begin("TwoMass")
    problem = state.problem(shown.text)
    found, _ = closed_forms(problem.plant, problem.distance)
    assert {*SHAPERS, *ENERGY} <= set(found)
    amplitudes, times = takeaway.closed_form(shown, "linear ZVD")
    np.testing.assert_array_equal(amplitudes, found["linear ZVD"].amplitudes)
    np.testing.assert_array_equal(times, found["linear ZVD"].times)
    with pytest.raises(ValueError, match="energy 2-impulse: they are for a TwoMass"):
        takeaway.closed_form(state.begin("Crane"), "energy 2-impulse")


def test_csv_of_the_curves():
    at = np.array([0.0, 1.0])
    moves = results.Moves(at, {"shaped": at}, {"shaped": 2 * at}, {"shaped": 3 * at}, "m", "mm", {}, "")
    assert takeaway.moves_csv(moves).splitlines() == [
        "time (s),\"position, shaped (m)\",\"deflection, shaped (mm)\",\"energy, shaped (J)\"",
        "0.0,0.0,0.0,0.0", "1.0,1.0,2.0,3.0",
    ]  # fmt: skip


def test_the_newest_state_wins():
    """While one state is computed, those between it and the newest are never begun; its later stages are skipped."""
    begun, shown, rested, gate = [], [], [], threading.Event()

    def stages(wanted):
        begun.append(wanted)
        for stage in range(2):
            if wanted == 0:
                gate.wait(5)
            yield (wanted, stage)

    async def drag():
        with ThreadPoolExecutor(1) as worker:
            live = Live(
                stages, worker, shown.append, lambda error: shown.append(error), lambda: rested.append(len(shown))
            )
            live.want(0)
            await asyncio.sleep(0.05)
            for wanted in range(1, 50):
                live.want(wanted)
            gate.set()
            while not live.done:
                await asyncio.sleep(0.005)

    asyncio.run(asyncio.wait_for(drag(), 10))
    assert begun == [0, 49]
    assert shown == [(49, 0), (49, 1)]
    assert rested == [2]


def test_a_pause_ends_with_what_is_newer():
    shown = []

    def stages(wanted):
        yield (wanted, "first")
        yield 30.0 if wanted == "old" else 0.01
        yield (wanted, "second")

    async def drag():
        with ThreadPoolExecutor(1) as worker:
            live = Live(stages, worker, shown.append, shown.append, lambda: None)
            live.want("old")
            while not shown:
                await asyncio.sleep(0.005)
            live.want("new")
            while not live.done:
                await asyncio.sleep(0.005)

    asyncio.run(asyncio.wait_for(drag(), 10))
    assert shown == [("old", "first"), ("new", "first"), ("new", "second")]


def test_an_error_does_not_end_a_page():
    def stages(wanted):
        if wanted:
            raise RuntimeError("broken")
        yield wanted

    async def two():
        shown, failed = [], []
        with ThreadPoolExecutor(1) as worker:
            live = Live(stages, worker, shown.append, failed.append, lambda: None)
            live.want(1)
            while not failed:
                await asyncio.sleep(0.005)
            live.want(0)
            while not live.done:
                await asyncio.sleep(0.005)
        return shown, failed

    shown, failed = asyncio.run(asyncio.wait_for(two(), 10))
    assert shown == [0]
    assert str(failed[0]) == "broken"


TOKEN = "a-token"
COOKIE = f"jshape_studio_8080={TOKEN}"


def asked(path="/", query="", cookie=COOKIE, kind="http", body=(b"",), **headers):
    """The status of a request through the guard; 200 where it passed."""
    given = {"host": "127.0.0.1:8080", **({"cookie": cookie} if cookie else {}), **headers}
    pairs = [(name.replace("_", "-").encode(), value.encode()) for name, value in given.items() if value is not None]
    scope = {"type": kind, "path": path, "query_string": query.encode(), "headers": pairs}
    sent, parts = [], list(body)

    async def receive():
        return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

    async def send(message):
        sent.append(message)

    async def answer(scope, receive, send):
        if kind == "websocket":
            await send({"type": "websocket.accept"})
            return
        while (await receive())["more_body"]:
            pass
        await send({"type": "http.response.start", "status": 200, "headers": []})

    asyncio.run(Guard(answer, TOKEN, 8080)(scope, receive, send))
    if kind == "websocket":
        return sent[0]["type"] == "websocket.accept"
    return sent[0]["status"], dict(sent[0]["headers"])


def test_the_token_opens_the_page_once():
    status, headers = asked(query=f"token={TOKEN}", cookie=None)
    assert status == 303
    assert headers[b"location"] == b"/"
    cookie = headers[b"set-cookie"].decode()
    assert cookie.startswith(COOKIE)
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    location = asked(query=f"token={TOKEN}&state=a-b%0d%0aset-cookie:x", cookie=None)[1][b"location"]
    assert location == b"/?state=a-b%0D%0Aset-cookie%3Ax"
    assert asked()[0] == 200
    assert b"default-src 'self'" in asked()[1][b"content-security-policy"]


@pytest.mark.parametrize(
    "request_",
    [
        {"cookie": None},
        {"cookie": "jshape_studio_8080=wrong"},
        {"cookie": "jshape_studio_8080=\u00e9"},
        {"cookie": f"jshape_studio_8081={TOKEN}"},
        {"cookie": None, "query": "token=wrong"},
        {"cookie": None, "query": f"token={TOKEN}", "path": "/_nicegui/anything"},
        {"host": "evil.example:8080"},
        {"host": None},
        {"host": "127.0.0.1:80"},
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:8081"},
        {"origin": "https://127.0.0.1:8080"},
        {"sec_fetch_site": "cross-site"},
    ],
)
def test_other_requests_are_refused(request_):
    assert asked(**request_)[0] == 403
    assert asked(kind="websocket", **request_) is False


def test_the_pages_own_requests_pass():
    assert asked(origin="http://127.0.0.1:8080", sec_fetch_site="same-origin")[0] == 200
    assert asked(host="localhost:8080", origin="http://localhost:8080")[0] == 200
    assert asked(kind="websocket", origin="http://127.0.0.1:8080") is True


def test_bodies_are_bounded():
    """Also where a request does not say how long it is, or says it wrongly."""
    assert asked(content_length=str(MOST))[0] == 200
    assert asked(content_length=str(MOST + 1))[0] == 413
    assert asked(content_length="-1")[0] == 413
    assert asked(body=[bytes(MOST // 2)] * 2)[0] == 200
    assert asked(body=[bytes(MOST // 2)] * 3, content_length="10")[0] == 413


def test_files_may_be_larger_where_they_are_uploaded():
    upload = "/_nicegui/client/0a1b-2c/upload/17"
    assert asked(path=upload, content_length=str(MOST_UPLOADED))[0] == 200
    assert asked(path=upload, content_length=str(2 * MOST_UPLOADED))[0] == 413
    assert asked(path=upload, body=[bytes(MOST_UPLOADED // 2)] * 3)[0] == 413
    for path in (f"{upload}/../x", f"/{upload}", "/_nicegui/client/a/b/upload/17"):
        assert asked(path=path, content_length=str(2 * MOST))[0] == 413


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("resonances_x.csv", "resonances_x.csv"),
        ("../../etc/passwd", "passwd"),
        ("C:\\data\\raw y.csv", "raw_y.csv"),
        ("..", "file.csv"),
        (".bashrc", "bashrc"),
        ("a\x00b\n.csv", "a_b_.csv"),
        ("-" * 300 + ".csv", "-" * 76 + ".csv"),
    ],
)
def test_names_of_uploaded_files_are_plain(given, kept, tmp_path):
    assert file_name(given) == kept
    assert (tmp_path / kept).resolve().parent == tmp_path.resolve()


@pytest.mark.slow
def test_a_printer_is_calibrated_as_by_the_command(tmp_path):
    """The process of the page gives the lines of ``jshape calibrate``, and the modes with which the record was made."""
    source = Path(__file__).parents[1] / "experiments" / "calibration" / "raw_data_x_simulated.csv"
    for axis in "xy":
        (tmp_path / f"raw_data_{axis}.csv").write_bytes(source.read_bytes())
    files = {axis: [f"raw_data_{axis}.csv"] for axis in "xy"}
    seen = []
    asked = {"files": files, "options": {"version": "current"}}
    found = asyncio.run(Work().run("calibrate", asked, seen.append, tmp_path))
    result = CliRunner().invoke(app, ["calibrate", str(tmp_path / "raw_data_x.csv"), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert found["axes"]["x"]["paste"] == (tmp_path / "out" / "paste.txt").read_text()
    assert "shaper_type_y" in found["paste"]
    assert {line["stage"][:2] for line in seen} == {"x:", "y:"}
    chosen = [row["name"] for row in found["axes"]["x"]["rows"] if row["chosen"]]
    record = json.loads((tmp_path / "out" / "results.json").read_text())
    assert chosen == [record["recommended"]]
    # Frequencies with which the record was made.
    np.testing.assert_allclose(found["axes"]["x"]["modes"][:2], [61, 93], rtol=0.03)
    drawn = panel_charts.spectrum(found["axes"]["x"])["series"]
    assert [line["name"] for line in drawn if line.get("yAxisIndex")] == [one[0] for one in found["axes"]["x"]["left"]]
    with pytest.raises(ValueError, match=r"^nothing\.csv: cannot be read"):
        asyncio.run(Work().run("calibrate", asked | {"files": {"x": ["nothing.csv"]}}, seen.append, tmp_path))


def test_a_killed_tuning_process_is_said_to_have_ended():
    async def killed():
        work = Work()
        running = asyncio.create_task(work.run("tune", {"text": state.begin("TwoMass").text}, lambda _: None))
        while not work.running:
            await asyncio.sleep(0.01)
        with pytest.raises(ValueError, match="already"):
            await work.run("tune", "", lambda _: None)
        work.kill()
        with pytest.raises(ValueError, match="ended without an answer"):
            await running
        await work.stop()
        return work.running

    assert asyncio.run(asyncio.wait_for(killed(), 30)) is False


def test_the_extra_is_named_where_it_is_missing(monkeypatch):
    import importlib.util

    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "nicegui" else found(name))
    result = CliRunner().invoke(app, ["studio"])
    assert result.exit_code == 2
    assert "pip install 'jshape[studio]'" in result.output


def test_mistakes_at_the_prompt():
    pytest.importorskip("nicegui")
    for arguments, said in [
        (["--port", "70000"], "--port must lie between 0 and 65535, not 70000"),
        (["nowhere.toml"], "nowhere.toml: no such file"),
        (["own_plant"], "the studio runs no code of a problem file's own"),
    ]:
        result = CliRunner().invoke(app, ["studio", *arguments])
        assert result.exit_code == 2
        assert said in " ".join(result.output.split())


def test_a_port_that_is_taken_is_named():
    # The address of another program's page, with this one's token, was said to be the studio's.
    pytest.importorskip("nicegui")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        result = CliRunner().invoke(app, ["studio", "--no-show", "--port", port])
    assert result.exit_code == 2
    assert f"--port {port}: " in " ".join(result.output.split())


def test_a_stop_at_once_is_quiet(capfd):
    """Before the process has begun there is nothing to interrupt in it; Python would complain."""

    async def stopped():
        work = Work()
        running = asyncio.create_task(work.run("tune", {"text": state.begin("TwoMass").text}, lambda _: None))
        while not work.running:
            await asyncio.sleep(0.001)
        await work.stop()
        with pytest.raises(ValueError, match="stopped before there was a result"):
            await running

    asyncio.run(asyncio.wait_for(stopped(), 30))
    assert capfd.readouterr().err == ""


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="Windows has no alarms")
def test_an_interrupt_where_python_cannot_raise_it_comes_again(monkeypatch, capfd):
    """While garbage is collected, where JAX has Python call it, an exception is printed and forgotten."""
    sent = []

    def collecting(phase, info):
        if not sent:
            sent.append(phase)
            signal.raise_signal(signal.SIGINT)

    def collect():
        gc.collect()
        for _ in range(200):
            time.sleep(0.01)

    monkeypatch.setattr(sys, "unraisablehook", work._again)
    usual = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGALRM)}
    work._on_interrupt(signal.default_int_handler)
    gc.callbacks.append(collecting)
    try:
        with pytest.raises(KeyboardInterrupt):
            collect()
    finally:
        gc.callbacks.remove(collecting)
        for each, handler in usual.items():
            signal.signal(each, handler)
    assert sent
    assert capfd.readouterr().err == ""


@pytest.mark.slow
def test_tuning_gives_the_numbers_of_the_problem_file(tmp_path):
    """The page and ``jshape tune`` on its problem file, to the last digit; a script, whose programs XLA may compile by
    other flags, to rounding."""
    shown = changes.with_design(state.begin("TwoMass"), starts=4, impulses=2)
    seen = []
    found = asyncio.run(Work().run("tune", {"text": shown.text}, seen.append))
    assert found["status"] == "CONVERGED"
    assert seen
    path = tmp_path / state.FILE
    path.write_text(shown.text, encoding="utf-8")
    command = [sys.executable, "-m", "jshape", "tune", str(path), "--out", str(tmp_path / "results")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / "results" / "shapers" / "tuned.json").read_text())
    assert [record["amplitudes"], record["times"]] == found["shapers"][""]
    problem = load(path)
    tuned = js.tune(problem.plant, problem.distance, **problem.tuning)
    np.testing.assert_allclose(tuned.shaper.amplitudes, found["shapers"][""][0], rtol=1e-12)
    np.testing.assert_allclose(tuned.shaper.times, found["shapers"][""][1], rtol=1e-12)


@pytest.mark.slow
def test_a_front_holds_what_simulation_says():
    """Every point of the front is the worst case of its shaper, computed again; more duration never costs."""
    shown = changes.with_uncertainty(state.begin("TwoMass"), "m2", 0.1)
    asked = {"text": shown.text, "impulses": [2, 3], "durations": 3}
    found = asyncio.run(Work().run("pareto", asked, lambda _: None))
    assert set(found["designs"]) == {"2 positive", "3 positive"}
    problem = state.problem(shown.text)
    for points in found["designs"].values():
        assert np.all(np.diff([point["duration"] for point in points]) > 0)
        assert np.all(np.diff([point["objective"] for point in points]) <= 0)
        for point in points:
            shaper = js.Shaper(point["amplitudes"], point["times"])
            values = problem.over["m2"]
            left = [js.residual_energy(replaced(problem.plant, m2=m2), shaper, 1.0) for m2 in values]
            assert max(map(float, left)) == pytest.approx(point["objective"], rel=1e-6)
    drawn = panel_charts.front(found)["series"]
    assert [line["name"] for line in drawn] == ["2 positive", "3 positive", "closed forms"]
    assert all(value > 0 for line in drawn[:2] for _, value in line["data"])


def replaced(plant, **values):
    """A plant with other values of its leaves."""
    return dataclasses.replace(plant, **values)


@pytest.mark.skipif(os.name != "posix", reason="a script stands in for Python")
@pytest.mark.parametrize("asked", [{}, {"long": "x" * 1_000_000}])
def test_progress_after_the_answer_does_not_replace_it(asked, tmp_path, monkeypatch):
    """Whether the process had read what was asked before it ended, or not: a pipe holds less than the second."""
    late = {"progress": {"stage": "local search", "done": 2, "total": 32, "best": None}}
    lines = [{"begun": True}, {"answer": {"status": "INTERRUPTED"}}, late]
    script = tmp_path / "python"
    script.write_text("#!/bin/sh\n" + "".join(f"echo '{json.dumps(line)}'\n" for line in lines))
    script.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(script))
    seen = []
    found = asyncio.run(Work().run("tune", asked, seen.append))
    assert found == {"status": "INTERRUPTED"}
    assert seen == [late["progress"]]


@pytest.mark.slow
def test_a_stop_keeps_the_best_shaper_so_far():
    async def stopped():
        work, seen = Work(), []
        shown = changes.with_design(state.begin("TwoMass"), starts=2000, impulses=5)
        # So many plants that the search is far from its end when the first of its lines is read.
        text = shown.text.replace("count = 41", "count = 401")
        assert text != shown.text
        running = asyncio.create_task(work.run("tune", {"text": text}, seen.append))
        while not any(0 < line["done"] < line["total"] for line in seen):
            await asyncio.sleep(0.1)
            assert not running.done()
        begin = time.monotonic()
        await work.stop()
        return await running, time.monotonic() - begin

    # As where a shell started the studio in the background.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        found, seconds = asyncio.run(asyncio.wait_for(stopped(), 300))
    finally:
        signal.signal(signal.SIGINT, before)
    assert found["status"] == "INTERRUPTED", found["message"]
    assert sum(found["shapers"][""][0]) == pytest.approx(1.0)
    assert seconds < 60


@pytest.mark.slow
def test_the_python_script_runs(tmp_path):
    shown = changes.with_design(state.begin("TwoMass"), starts=4, impulses=2)
    shown = changes.with_impulses(shown, *takeaway.closed_form(shown, "energy 2-impulse"))
    (tmp_path / state.FILE).write_text(shown.text, encoding="utf-8")
    (tmp_path / "studio.py").write_text(takeaway.script(shown), encoding="utf-8")
    done = subprocess.run([sys.executable, "studio.py"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("on the page: ")
    assert "converged" in done.stdout
    assert len(takeaway.script(shown).splitlines()) <= 10
    assert abs(float(done.stdout.split()[3])) < 1e-12
