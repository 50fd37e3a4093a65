"""Figures of a run: what is drawn, in which lines, on which axes; legends stay small."""

import dataclasses
import itertools
import subprocess
import sys
from types import SimpleNamespace

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest

import jshape as js
from jshape.problems.problem import load
from jshape.reports import limits_kept, plot, report, report_files, tables
from jshape.reports.responses import responses
from jshape.reports.style import columns, decades, looks
from jshape.sweeps.quantities import about_metric

NAMES = ("linear ZV", "linear ZVDD", "energy 3-impulse", "energy 4-impulse, first order", "tuned")


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


def run(size: float) -> SimpleNamespace:
    t = np.linspace(0, 4, 50)
    return SimpleNamespace(times=t, command=np.minimum(t, 1), payload=1 - size * np.cos(t), deflection=size * np.sin(t))


def line_of(axis, y):
    return next(line for line in axis.lines if np.array_equal(line.get_ydata(), y))


def legend_share(figure) -> float:
    figure.canvas.draw()
    (legend,) = figure.legends
    return legend.get_window_extent().height / figure.bbox.height


def test_a_shaper_has_one_line_in_all_figures():
    vibrations = {name: np.linspace(0.001, 0.5, 20) / (1 + i) for i, name in enumerate(NAMES)}
    sensitivity = plot.sensitivity("payload mass (kg)", np.linspace(1, 8, 20), vibrations, band=(2, 6)).figure
    runs = {name: run(1.0 + i) for i, name in enumerate(NAMES[:3])} | {"tuned": run(9.0)}
    names = "trolley", "payload"
    axes = plot.response(runs, {"tuned": [run(10.0)]}, names, unshaped=run(20.0), sway="sway (mm)", limit=4.5)
    moves = axes[0, 0].figure
    colours = {name: line_of(sensitivity.axes[0], 100 * values).get_color() for name, values in vibrations.items()}
    assert len(set(colours.values())) == len(NAMES)
    for row, (name, response) in enumerate(runs.items()):
        position, sway = moves.axes[2 * row : 2 * row + 2]
        assert position.get_title(loc="left") == name
        assert line_of(position, response.payload).get_color() == colours[name]
        assert line_of(sway, response.deflection).get_color() == colours[name]
        # Behind it, the bare command's.
        bare = line_of(sway, run(20.0).deflection)
        assert (bare.get_color(), bare.get_zorder()) == (looks(["unshaped"])["unshaped"]["color"], 1)
        assert (position.get_ylabel(), sway.get_ylabel()) == ("position (m)", "sway (mm)")
        # The limit on it, to both sides.
        levels = [list(line.get_ydata()) for line in sway.lines if line.get_linestyle() == ":"]
        assert levels == [[-4.5, -4.5], [4.5, 4.5]]
    assert line_of(moves.axes[-1], run(10.0).deflection).get_linewidth() < 1
    assert sensitivity.axes[0].get_xlabel() == "payload mass (kg)"
    for figure in (sensitivity, moves):
        assert legend_share(figure) < 1 / 6


def test_axes_are_logarithmic_where_values_span_decades():
    _, (first, second, third) = plt.subplots(1, 3)
    assert decades(first, [np.array([0.0, 3.0, 100.0]), np.array([0.5, 0.02, 0.0])], least=1e-6)
    low, high = first.get_ylim()
    # So far down that the lowest line is seen, at most a decade below its maximum.
    assert first.get_yscale() == "log"
    assert low == pytest.approx(0.05 / 1.3)
    assert high == 130
    assert first.yaxis.get_major_formatter()(0.1) == "0.1"
    assert not decades(second, [np.array([0.4, 0.9])], least=1e-6)
    assert not decades(third, [np.array([-1.0, 100.0])], least=1e-6)
    assert second.get_yscale() == third.get_yscale() == "linear"


@pytest.mark.slow
def test_a_crane_sways(tmp_path):
    """The figure's numbers are those of the simulation, in mm, and the shaped move ends without sway."""
    path = tmp_path / "crane.toml"
    design = '[design]\npeak_deflection = "80 mm"\n'
    path.write_text(f'{MOVE}\n[plant]\ntype = "Crane"\ncable_length = "500 mm"\n{design}', encoding="utf-8")
    problem = load(path)
    shapers = {"unshaped": js.Shaper([1.0], [0.0]), "linear ZV": js.design.linear.zv(float(np.sqrt(9.81 / 0.5)))}
    made = report.build(problem, None, closed=(shapers, {}))
    (figure,) = [values for name, _, values in report_files.figures(made) if name == "response"]
    nominal, extremes, names, label, bare, sway, limit = figure
    assert (list(nominal), names, label, sway) == (["linear ZV"], ("trolley", "payload"), "position (m)", "sway (mm)")
    assert limit == pytest.approx(80)
    assert extremes == {"linear ZV": []}
    found = js.simulate(problem.plant, problem.distance, horizon=float(bare.times[-1]), samples=len(bare.times))
    np.testing.assert_allclose(bare.deflection, 1000 * np.asarray(found.deflection), atol=1e-4)
    assert np.abs(nominal["linear ZV"].deflection[-100:]).max() < 0.02 * np.abs(bare.deflection[-100:]).max()


@pytest.mark.slow
def test_the_ends_of_values_in_any_order():
    """The first and the last were drawn."""
    plant, move = js.plants.Crane(0.5), js.Trapezoid(1.0, 0.5, 1.0)
    problem = dataclasses.replace(
        load("paper_001"), plant=plant, distance=move, over={"cable_length": np.array([1.0, 1.2, 0.8])}
    )
    bare = js.Shaper([1.0], [0.0])
    ((_, (_, extremes, *_)),) = responses(problem, {"bare": bare}, bare, 2.5)
    for drawn, factor in zip(extremes["bare"], (0.8, 1.2), strict=True):
        found = js.simulate(js.plants.Crane(0.5 * factor), move, horizon=float(drawn.times[-1]), samples=600)
        np.testing.assert_allclose(drawn.deflection, 1000 * np.asarray(found.deflection), atol=1e-3)


@pytest.mark.slow
def test_a_tower_crane_sways_both_ways(tmp_path):
    """In degrees, sideways and outwards; the trolley is drawn where it is, from the axis of slewing."""
    path = tmp_path / "tower.toml"
    moves = "".join(MOVE.replace("[command]", f"[command.{axis}]") + "\n" for axis in ("slew", "trolley"))
    plant = '[plant]\ntype = "TowerCrane"\ntrolley_radius = "3 m"\ncable_length = "2 m"\npayload_mass = "5 kg"\n'
    path.write_text(moves.replace("1 m", "1 rad", 1).replace("m/s", "rad/s", 2) + plant, encoding="utf-8")
    problem = load(path)
    made = report.build(
        problem, None, closed=({"unshaped": js.Shaper([1.0], [0.0]), "ZV": js.Shaper([0.5, 0.5], [0.0, 1.4])}, {})
    )
    drawn = {name: values for name, _, values in report_files.figures(made) if name.startswith("response")}
    assert [values[-2:] for values in drawn.values()] == [("sway sideways (°)", None), ("sway outwards (°)", None)]
    for (*_, bare, _, _), state, start in zip(drawn.values(), (1, 0), (0.0, 3.0), strict=True):
        end = float(bare.times[-1])
        found = js.simulate(problem.plant, problem.distance, horizon=end, samples=len(bare.times))
        np.testing.assert_allclose(bare.deflection, np.degrees(found.states[:, state]), atol=1e-4)
        assert bare.command[0] == pytest.approx(start, abs=1e-9)
        assert bare.payload[0] == pytest.approx(start, abs=1e-9)


MOVE = '[command]\ntype = "Trapezoid"\ndistance = "1 m"\nspeed = "0.5 m/s"\nacceleration = "1 m/s²"'


PAIR = """distance = 1.0
[plant]
type = "TwoMass"
m1 = 1.0
m2 = 1.0
spring = { type = "Duffing", k1 = 10.0, k3 = 100.0 }
"""


def rows(**left: tuple[float, float]) -> list[report.Row]:
    """Shapers by name: duration (s) and worst vibration."""
    names = {name.replace("_", " "): values for name, values in left.items()}
    return [report.Row(name, js.Shaper([0.5, 0.5], [0.0, time]), 0.0, v, v) for name, (time, v) in names.items()]


def test_energies_between_coincident_impulses_do_not_widen_the_axis():
    plant = js.plants.TwoMass(1.0, 1.0, js.plants.Duffing(10.0, 100.0))
    shaper = js.Shaper([0.5, 0.5, 0.0], [0.0, 0.99, 0.99])
    (axis,) = plot.energy({"padded": js.energy_profile(plant, shaper, 1.0)})[:, 0]
    drawn = max(np.max(line.get_ydata()) for line in axis.lines if np.ptp(line.get_xdata()) > 0)
    assert axis.get_ylim()[1] < 1.2 * drawn


def test_what_tuning_gains_and_what_more_time_would_bring():
    problem = load("paper_001")
    made = rows(linear_ZV=(1, 0.5), linear_ZVD=(2, 0.01), tuned=(1.5, 0.05))
    for limit, bound in ((problem.design.duration, False), ([1.0, 1.5], True), ([1.0, 1.6], False)):
        design = problem.design.model_copy(update={"duration": limit})
        lines = report.Report(dataclasses.replace(problem, design=design), made, {}, {}, None).gains()
        assert "worst residual energy 0.05 J: 10 times less than the 0.5 J of linear ZV, the best" in lines[0]
        assert lines[-1] == "linear ZVD leaves 0.01 J, but takes 0.5 s longer"
        assert (lines[1] == "it takes all of the 1.5 s that [design] duration allows: more may leave less") == bound
        assert len(lines) == 2 + bound
    better = report.Report(problem, rows(linear_ZV=(1, 0.5), linear_ZVD=(2, 0.06), tuned=(1.5, 0.05)), {}, {}, None)
    assert len(better.gains()) == 1
    assert better.advised.stem == "tuned"
    # A closed form that is better is what to go on with; a bare command is none.
    worse = report.Report(problem, rows(linear_ZV=(1, 0.04), tuned=(1.5, 0.05)), {}, {}, None)
    assert worse.advised.stem == "linear_ZV"
    # A closed form that takes a little longer is one to compare with.
    nearly = report.Report(problem, rows(linear_ZV=(1, 0.5), linear_ZVD=(1.505, 0.1), tuned=(1.5, 0.05)), {}, {}, None)
    assert "2 times less than the 0.1 J of linear ZVD, the best closed form that takes at most 1 %" in nearly.gains()[0]
    alone = report.Report(problem, rows(unshaped=(0, 0.5), tuned=(1.5, 0.05)), {}, {}, None)
    assert alone.gains()[0].endswith("0.5 J of the bare command; no closed form takes no longer")
    harmful = report.Report(problem, rows(unshaped=(0, 0.5), linear_ZV=(1, 0.6), tuned=(1.5, 0.05)), {}, {}, None)
    assert harmful.gains()[0].endswith("the bare command; no closed form that takes no longer leaves less")


def test_times_of_moves_as_they_are_played():
    """Ends between samples are played later, impulses of nothing not at all."""
    exact = report.Row("linear ZVD", js.Shaper([0.5, 0.5], [0.0, 2.0]), 0.0, 0.01, 0.01)
    exact = dataclasses.replace(exact, played=js.Shaper([0.5, 0.4, 0.1], [0.0, 1.9, 2.1]))
    tuned = report.Row("tuned", js.Shaper([0.5, 0.5, 0.0], [0.0, 1.0, 1.5]), 0.0, 0.05, 0.05)
    made = report.Report(load("paper_001"), [exact, tuned], {}, {}, None)
    assert [made.move_time(row) for row in (exact, tuned)] == [2.1, 1.0]
    bare = report.Row("unshaped", js.Shaper([1.0], [0.0]), 0.0, 0.5, 0.5)
    assert dataclasses.replace(made, rows=[bare, exact, tuned]).gains()[-1].endswith("but takes 1.1 s longer")


def test_modes_without_a_mass_have_energies_per_kilogram():
    plant = js.plants.ModalPlant([5.0, 9.0])
    problem = dataclasses.replace(load("paper_001"), plant=plant, over={"omega": np.array([0.9, 1.1])})
    made = report.Report(problem, rows(unshaped=(0, 0.5), linear_ZV=(1, 0.2), tuned=(1.5, 0.05)), {}, {}, None)
    assert "0.05 J/kg: 4 times less than the 0.2 J/kg of linear ZV" in made.gains()[0]
    assert [heading.split("\n")[-1] for heading in tables._cells(made)[0]] == ["(s)", "(J/kg)", "(J/kg)", "(% of move)"]
    assert about_metric("residual_energy", plant)[1] == "J/kg"
    assert about_metric("residual_energy", js.plants.Crane(1.0))[1] == "J"
    link = js.plants.FlexibleLink(5.0, js.plants.Beam(1.0, 2.0, 0.5))
    assert about_metric("residual_energy", link)[1] == "J/(kg m²)"


def test_a_closed_form_that_exceeds_a_limit_is_not_advised():
    problem, made = (
        load("paper_001"),
        rows(unshaped=(0, 0.5), linear_ZV=(1, 0.04), linear_ZVD=(2, 0.01), tuned=(1.5, 0.05)),
    )
    bare, short, long, tuned = made
    kept = report.Report(problem, [bare, short, long, tuned], {}, {}, None)
    assert (kept.advised.stem, len(kept.gains())) == ("linear_ZV", 2)
    short = dataclasses.replace(short, exceeded="peak_deflection 0.9 m")
    some = report.Report(problem, [bare, short, long, tuned], {}, {}, None)
    assert some.advised is tuned
    assert some.gains() == [
        "worst residual energy 0.05 J: 10 times less than the 0.5 J of the bare command;"
        " no closed form that takes no longer and keeps the limits leaves less",
        "linear ZVD leaves 0.01 J, but takes 0.5 s longer",
    ]
    assert (kept.exceeding, some.exceeding) == ("", "limits are exceeded by linear ZV (peak_deflection 0.9 m)")
    bare, long = (dataclasses.replace(row, exceeded="speed_limit by 5 %") for row in (bare, long))
    none = report.Report(problem, [bare, short, long, tuned], {}, {}, None)
    assert none.advised is tuned
    assert none.gains() == ["worst residual energy 0.05 J: no closed form that takes no longer keeps the limits"]
    words = "unshaped (speed_limit by 5 %), linear ZV (peak_deflection 0.9 m), linear ZVD (speed_limit by 5 %)"
    assert none.exceeding == f"limits are exceeded by {words}"


@pytest.mark.parametrize("over", [{"m2": np.array([0.8, 1.25])}, pytest.param({}, marks=pytest.mark.slow)])
def test_which_limits_a_shaper_exceeds(over):
    problem = load("paper_001")
    problem = dataclasses.replace(problem, over=over, distance=js.Trapezoid(1.0, speed=1.0, acceleration=4.0))
    shapers = {"bare": js.Shaper([1.0], [0.0]), "shaped": js.Shaper([0.5, 0.5], [0.0, 0.8])}
    plants = [dataclasses.replace(problem.plant, m2=ratio * problem.plant.m2) for ratio in over.get("m2", [1.0])]
    swung = {
        name: max(float(js.peak_deflection(plant, shaper, problem.distance)) for plant in plants)
        for name, shaper in shapers.items()
    }
    assert swung["shaped"] < 0.99 * swung["bare"]

    def exceeded(**limits):
        design = problem.design.model_copy(update=limits)
        return limits_kept.exceeded(dataclasses.replace(problem, design=design), shapers)

    # Half of the first impulse's speed is there while the second one's grows: 0.9 m/s.
    found = exceeded(peak_deflection=0.995 * swung["bare"], speed_limit=0.95)
    assert found == [f"peak_deflection {swung['bare']:.4g} m, speed_limit by 5.26 %", ""]
    assert exceeded(peak_deflection=swung["bare"] * (1 + 1e-4), speed_limit=1.0) == ["", ""]
    assert exceeded() == ["", ""]


def test_limits_are_in_the_unit_of_their_axis(monkeypatch):
    found = {"slew": np.array([0.0723]), "trolley": np.array([0.5])}
    monkeypatch.setattr(limits_kept, "_deflections", lambda *_: found)
    moves = js.Axes(slew=js.Trapezoid(1.0, 0.5, 1.0), trolley=js.Trapezoid(1.0, 0.5, 1.0))
    problem = load("paper_001")
    design = problem.design.model_copy(update={"peak_deflection": {"slew": 0.01, "trolley": 0.2}})
    tower = js.plants.TowerCrane(3.0, 2.0)
    problem = dataclasses.replace(problem, plant=tower, distance=moves, design=design)
    words = "peak_deflection of slew 0.0723 rad, peak_deflection of trolley 0.5 m"
    assert limits_kept.exceeded(problem, {"bare": js.Shaper([1.0], [0.0])}) == [words]


def test_five_shapers_at_most_are_drawn():
    made = rows(linear_ZV=(1, 0.5), linear_ZVD=(2, 0.1), linear_EI=(2, 0.2), energy_2=(0.6, 0.3), energy_4=(3, 0.01))
    bare = report.Row("unshaped", js.Shaper([1.0], [0.0]), 1.0, 1.0, 1.0)
    tuned = rows(tuned=(1.5, 0.05))
    problem = load("paper_000")
    chosen = report_files._chosen(report.Report(problem, [bare, *made, *tuned], {}, {}, None))
    # Of each family the best that takes no longer than the tuned one, and the best at all.
    assert [row.name for row in chosen] == ["linear ZV", "linear ZVD", "energy 2", "energy 4", "tuned"]
    chosen = report_files._chosen(report.Report(problem, [bare, *made], {}, {}, None))
    # Without it those that no shorter one beats.
    assert [row.name for row in chosen] == ["linear ZVD", "energy 2", "energy 4"]


def test_pareto_names_the_closed_forms_that_count():
    xr = pytest.importorskip("xarray")
    ds = xr.Dataset(
        {
            "objective": (("design", "duration"), [[1.0, 0.1]], dict(long_name="residual energy")),
            "closed_objective": ("closed_form", [5.0, 0.5, 0.7, 1e-20]),
            "closed_duration": ("closed_form", [0.0, 0.5, 0.9, 0.8]),
        },
        {"design": ["2 positive"], "duration": [0.4, 1.0], "closed_form": ["unshaped", "good", "beaten", "zero"]},
    )
    axis = plot.pareto(ds)
    assert [text.get_text() for text in axis.texts] == ["good"]
    assert len(axis.lines) == 3
    # No name's patch hides a point.
    assert all(point.get_zorder() > axis.texts[0].get_zorder() for point in axis.lines[1:])


def test_drawing_loads_neither_jax_nor_xarray():
    code = "import sys\nfrom jshape.reports import plot\nassert not {'jax', 'xarray'} & set(sys.modules)\n"
    # Tuning and reporting load JAX, but not xarray: half a second of every command, which only sweeps and fronts need.
    code += "from jshape.reports import report_files\nfrom jshape.design.tuning.tune import tune\n"
    subprocess.run([sys.executable, "-c", code + "assert 'xarray' not in sys.modules"], check=True)


CURVE = np.array([0.5, 0.1, 0.3])
ONE_PANEL = {
    "sensitivity": ("m2", CURVE, {"a": CURVE, "b": CURVE / 2}),
    "convergence": (CURVE, "worst"),
    "learning": (CURVE, CURVE, CURVE),
    "regret": ({"a": (0.1, 0.0, 0.2)},),
    "calibration": ([("record", CURVE, CURVE)], ("a", CURVE, CURVE), [("a", CURVE, CURVE)], [0.2]),
    "curves": ([("a", CURVE, CURVE), ("b", CURVE, 2 * CURVE)], ("x", "y")),
}


@pytest.mark.parametrize("kind", ONE_PANEL)
def test_figures_are_drawn_in_the_axes_of_the_user(kind):
    _, (mine, other) = plt.subplots(1, 2)
    assert getattr(plot, kind)(*ONE_PANEL[kind], ax=mine) is mine
    assert mine.lines
    assert not other.lines
    assert plt.get_fignums() == [mine.figure.number]
    # Nothing is put outside these axes, where something of the user's may stand.
    assert mine.figure.legends == []


def test_as_many_axes_as_panels(tmp_path):
    figure, mine = plt.subplots(2, 2)
    drawn = plot.response({"a": run(1.0), "b": run(2.0)}, sway="sway (mm)", ax=mine)
    assert drawn.tolist() == mine.tolist()
    assert [axis.get_title(loc="left") for axis in mine[:, 0]] == ["a", "b"]
    assert plot.prediction(CURVE, CURVE[:, None], CURVE[:, None], ["x"], ax=mine[0]).tolist() == mine[0].tolist()
    for wrong in (mine[0], [1, 2, 3, 4]):
        with pytest.raises(ValueError, match="ax must be 4 of matplotlib's Axes"):
            plot.response({"a": run(1.0), "b": run(2.0)}, sway="sway (mm)", ax=wrong)
    plot.save(mine, tmp_path / "mine.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.pdf", "mine.png"]
    assert not plt.fignum_exists(figure.number)


@pytest.fixture
def defaults():
    """matplotlib as it is installed: the papers' scripts set a look of their own when they are imported."""
    with mpl.rc_context():
        mpl.rcdefaults()
        yield


@pytest.mark.usefixtures("defaults")
def test_the_look_is_the_users_where_there_is_one():
    def looks_like(axis):
        return axis.xaxis.label.get_size(), axis.spines["top"].get_visible()

    def curves(**options):
        return plot.curves(*ONE_PANEL["curves"], **options)

    assert looks_like(curves()) == (8, False)
    with mpl.rc_context({"axes.labelsize": 13}):
        assert looks_like(curves()) == (13, False)
    assert looks_like(curves(style={"axes.labelsize": 11})) == (11, True)
    assert looks_like(curves(style="default"))[1]
    _, mine = plt.subplots()
    assert looks_like(curves(ax=mine)) == (10, True)


def test_shapers_differ_in_grey():
    """Of the lines of five shapers and the bare command, any two differ in their dashes or, clearly, in lightness."""
    found = looks(["unshaped", *NAMES])
    for first, second in itertools.combinations(found.values(), 2):
        light = [float(np.dot(mpl.colors.to_rgb(line["color"]), (0.299, 0.587, 0.114))) for line in (first, second)]
        assert first["linestyle"] != second["linestyle"] or abs(light[0] - light[1]) > 0.25


def test_the_best_shaper_is_seen_inside_the_uncertainty():
    values = np.linspace(0.6, 1.4, 81)
    best = np.where(np.abs(values - 1) < 0.19, 0.002, 0.3)
    axis = plot.sensitivity("m (kg)", values, {"a": np.full(81, 0.3), "b": best}, band=(0.82, 1.18))
    assert axis.get_ylim()[0] < 0.2


@pytest.mark.parametrize(("names", "count"), [("abcd", 2), ("abcde", 3), (["linear ZVD", "energy 4-impulse"] * 3, 2)])
def test_a_legend_has_as_few_rows_as_fit(names, count):
    assert columns(list(names)) == count


@pytest.mark.parametrize(
    ("stated", "ends"),
    [
        ([0.9, 1.1], (0.8, 1.2)),
        ([0.5, 1.5], (0.2, 2.0)),
        ([0.02, 0.03], (0.015, 0.035)),
        ([0.1, 0.5], (0.05, 0.7)),
        ([0.0, 1.0], (0.0, 1.0)),
        ([2.0, 4.0], (1.0, 5.0)),
    ],
)
def test_a_sensitivity_curve_holds_what_is_stated_and_no_impossible_plant(stated, ends):
    curve = report._wide(stated)
    np.testing.assert_allclose([curve[0], curve[-1]], ends, atol=1e-15)
    assert curve[0] <= min(stated) <= max(stated) <= curve[-1]
    assert min(stated) == 0 or curve[0] > 0


def test_shapers_of_a_move_that_ends_where_it_began_are_judged_by_their_energies():
    named = [("unshaped", [0.0], 3.0), ("linear ZV", [0.0, 0.5], 0.2), ("linear ZVD", [0.0, 0.5, 1.0], 0.1)]
    made = [
        report.Row(name, js.Shaper(np.full(len(t), 1 / len(t)), t), energy, energy, np.nan) for name, t, energy in named
    ]
    found = report.Report(load("paper_000"), made, {}, {}, None)
    assert report.best(found).name == "linear ZVD"
    cells = tables._cells(found)[1]
    assert [row[-1] for _, row in cells] == ["–"] * 3
    lost = dataclasses.replace(made[1], worst_energy=np.nan)
    assert tables._cells(dataclasses.replace(found, rows=[lost]))[1][0][1][-1] == "not met"
    # What is not known is not the best, however little the nominal machine leaves.
    lost = dataclasses.replace(lost, nominal_energy=0.0)
    assert report.best(dataclasses.replace(found, rows=[made[0], lost, made[2]])).name == "linear ZVD"


@pytest.mark.slow
def test_a_machine_that_was_designed_with_its_shaper_is_the_reports(tmp_path):
    path = tmp_path / "designed.toml"
    text = PAIR + "[uncertainty]\nm2 = { low = 0.9, high = 1.1, count = 3 }\n[design]\nimpulses = 2\nduration = 0.6\n"
    path.write_text(text + 'also = { "spring.k1" = ["5 N/m", "20 N/m"] }\n', encoding="utf-8")
    problem = load(path)
    solution = js.tune(problem.plant, problem.distance, **problem.tuning | {"starts": 4})
    made = report.build(problem, solution)
    assert solution.leaves["spring.k1"] != pytest.approx(10, rel=1e-3)
    tuned = made.rows[-1]
    stiffness = solution.leaves["spring.k1"]
    left = [
        float(js.residual_energy(js.plants.TwoMass(1.0, m, js.plants.Duffing(stiffness, 100.0)), tuned.shaper, 1.0))
        for m in (0.9, 1.0, 1.1)
    ]
    assert tuned.nominal_energy == pytest.approx(left[1], rel=1e-6)
    assert tuned.worst_energy == pytest.approx(max(left), rel=1e-3)
    assert made.rows[1].shaper.times[1] == pytest.approx(np.pi / np.sqrt(stiffness), rel=1e-9)
    assert made.problem.understood[-1] == f"the machine as designed, for all shapers: spring.k1 {stiffness:.6g}"


def test_the_motor_of_a_joint_follows_its_reference():
    """The dashed curve is the reference: under a controller the motor takes its time."""
    joint = js.plants.FlexibleJoint(
        0.1, 0.5, js.plants.LinearSpring(50.0), js.plants.PDController(60.0, 3.0), motor_damping=2.0
    )
    problem = dataclasses.replace(load("paper_000"), plant=joint, distance=js.Trapezoid(1.0, 2.0, 10.0), over={})
    shaper = js.Shaper([1.0], [0.0])
    ((_, (nominal, _, names, *_)),) = responses(problem, {"unshaped": shaper}, shaper, 2.0)
    assert names == ("reference", "payload")
    drawn = nominal["unshaped"]
    found = js.simulate(joint, problem.distance, horizon=float(drawn.times[-1]), samples=len(drawn.times))
    np.testing.assert_allclose(drawn.command, np.degrees(found.command), atol=1e-4)
    assert np.abs(drawn.command - np.degrees(found.states[:, 0])).max() > 1.0


def test_zeros_over_two_leaves_are_drawn():
    """The overshoot of a hoist, say, which is 0 for all plants: nothing of it is logarithmic."""
    pair = js.plants.TwoMass(1.0, 1.0, js.plants.LinearSpring(10.0))
    over = {"m1": np.array([0.9, 1.1]), "m2": np.array([0.9, 1.1])}
    found = js.sweep(pair, {"ZV": js.Shaper([0.5, 0.5], [0.0, 0.5])}, 1.0, over, "residual_energy")
    panels = plot.sweep(0.0 * found, "residual_energy")
    panels[0].figure.canvas.draw()


@pytest.mark.slow
def test_worst_cases_of_a_report_are_looked_for_between_its_plants():
    """A leaf over which the energy oscillates: a hundred plants missed 0.3 % of ZVD's worst case; the judge is 4001."""
    problem = load("paper_000")
    over = {"m2": np.array([0.3, 1.0, 3.0])}
    plant = js.plants.TwoMass(1.0, 1.0, js.plants.LinearSpring(4000.0))
    problem = dataclasses.replace(problem, plant=plant, distance=js.Trapezoid(1.0, 0.5, 1.0), over=over)
    zvd = js.design.linear.zvd(float(np.sqrt(4000.0)), 0.0)
    made = report.build(problem, None, closed=({"unshaped": js.Shaper([1.0], [0.0]), "linear ZVD": zvd}, {}))
    dense = {"m2": np.linspace(0.3, 3.0, 4001)}
    for row in made.rows:
        exact = float(js.sweep(plant, row.shaper, problem.distance, dense, "residual_energy")["residual_energy"].max())
        assert row.worst_energy == pytest.approx(exact, rel=1e-4)


@pytest.mark.slow
def test_closed_forms_shape_the_axes_that_the_tuned_one_shapes():
    """As in `jshape pareto`; and a split shaper's move takes as long as what is played."""
    plant, move = js.plants.BridgeCrane(2.0, 5.0), js.Axes(
        trolley=js.Trapezoid(1.0, 0.5, 1.0), bridge=js.Trapezoid(0.5, 0.5, 1.0)
    )  # fmt: skip
    problem = load("paper_000")
    design = problem.design.model_copy(update={"shapers": ["trolley"], "sample_time": 0.3})
    problem = dataclasses.replace(problem, plant=plant, distance=move, over={}, design=design)
    shaper = js.design.linear.zv(2.2, 0.0)
    made = report.build(problem, None, closed=({"linear ZV": shaper}, {}))
    played = made.rows[0].played
    left = js.residual_energy(plant, {"trolley": played, "bridge": None}, move)
    assert made.rows[0].nominal_energy == pytest.approx(float(left), rel=1e-9)
    assert made.move_time(made.rows[0]) == pytest.approx(2.5 + float(played.times[-1]), rel=1e-12)
    assert float(played.times[-1]) > float(shaper.times[-1]) + 0.01


def test_the_stated_band_of_a_curve_that_begins_at_zero():
    made = rows(unshaped=(0.0, 0.5), linear_ZV=(0.5, 0.1))
    values = np.array([0.0, 1.0, 2.0])
    curves = {"m2": report.Curves(values, 3 * values, {row.name: values for row in made})}
    name, _, (*_, band) = next(report_files.figures(report.Report(load("paper_000"), made, {}, curves, None)))
    assert name == "sensitivity_m2"
    assert band == pytest.approx((2.4, 3.6))
