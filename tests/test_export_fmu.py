"""Functional mock-up units, validated and run by FMPy, beside convolution and SciPy; their C beside the equations."""

import ctypes
import math
import re
import shutil
import subprocess
import zipfile
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jshape as js
from jshape.export import compiler, equations
from jshape.export.equations import written_out
from jshape.problems import starters
from jshape.problems.problem import load

if not any(map(shutil.which, ("cc", "gcc", "clang"))):
    pytest.skip("no C compiler", allow_module_level=True)

SHAPER, SAMPLE_TIME = js.design.linear.zvd(9.0, 0.05), 0.01
KINDS = ("CoSimulation", "ModelExchange")


@pytest.fixture(scope="module")
def units(tmp_path_factory):
    """The shaper's unit in both versions, unpacked."""
    folder = tmp_path_factory.mktemp("units")
    found = {}
    for fmi in ("2.0", "3.0"):
        path = folder / f"crane{fmi[0]}.fmu"
        js.export(SHAPER, "fmu", path, sample_time=SAMPLE_TIME, name="crane", fmi=fmi)
        found[fmi] = unpacked(path)
    return found


def unpacked(path):
    inside = path.with_suffix("")
    with zipfile.ZipFile(path) as archive:
        archive.extractall(inside)
    (library,) = inside.glob("binaries/*/*")
    return SimpleNamespace(path=path, folder=inside, library=library)


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_what_a_unit_holds(units, fmi, tmp_path):
    with zipfile.ZipFile(units[fmi].path) as archive:
        names = set(archive.namelist())
        description = archive.read("modelDescription.xml")
    main = f"sources/fmi{fmi[0]}.c"
    assert {"modelDescription.xml", main, "sources/core.h", "sources/crane.h", "sources/model.h"} < names
    assert description.startswith(b"<?xml version='1.0' encoding='UTF-8'?>\n")
    # The same bytes again, apart from what the compiler put into the library.
    again = tmp_path / "again.fmu"
    js.export(SHAPER, "fmu", again, sample_time=SAMPLE_TIME, name="crane", fmi=fmi)
    assert again.read_bytes() == units[fmi].path.read_bytes()
    # The sources compile by themselves, without a warning that matters.
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter", "-Wno-unused-function"]
    command = [*compiler.compiler(), *strict, "-fsyntax-only", Path(main).name]
    built = subprocess.run(command, cwd=units[fmi].folder / "sources", capture_output=True, text=True)
    assert built.returncode == 0, built.stderr


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_units_by_another_reader(units, fmi):
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(units[fmi].path)) == []
    description = fmpy.read_model_description(str(units[fmi].path))
    assert description.fmiVersion == fmi
    assert description.coSimulation is not None
    assert description.modelExchange is not None
    inputs = [v for v in description.modelVariables if v.causality == "input"]
    assert [(v.name, v.start) for v in inputs] == [("command", "0.0"), ("bypass", "false")]
    # Every function of the standard's own headers is there.
    headers = Path(fmpy.__file__).parent / "c-code"
    text = (headers / f"fmi{fmi[0]}FunctionTypes.h").read_text(encoding="utf-8")
    names = set(re.findall(rf"\b(fmi{fmi[0]}[A-Z]\w+)TYPE\b", text))
    assert len(names) > 40
    library = ctypes.CDLL(str(units[fmi].library))
    assert [name for name in names if not hasattr(library, name)] == []


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_samples_beside_a_convolution(units, fmi):
    """A hundred thousand samples in co-simulation, a change to bypass and back among them; a copied state goes on
    alike."""
    fmpy = pytest.importorskip("fmpy")
    description = fmpy.read_model_description(str(units[fmi].path))
    module = fmpy.fmi2 if fmi == "2.0" else pytest.importorskip("fmpy.fmi3")
    kind = module.FMU2Slave if fmi == "2.0" else module.FMU3Slave
    unit = kind(
        guid=description.guid, unzipDirectory=str(units[fmi].folder), modelIdentifier="crane", instanceName="one"
    )
    command, shaped, bypass = (v.valueReference for v in description.modelVariables if v.name != "time")
    get, put = (unit.getReal, unit.setReal) if fmi == "2.0" else (unit.getFloat64, unit.setFloat64)
    unit.instantiate()
    count, taps = 100_000, SHAPER.digitise(SAMPLE_TIME)
    commands = np.cumsum(np.random.default_rng(0).normal(size=count))
    if fmi == "2.0":
        unit.setupExperiment(startTime=0.0)
    unit.enterInitializationMode()
    put([command], [commands[0]])
    assert get([shaped]) == [commands[0]]
    unit.exitInitializationMode()
    found = np.empty(count)
    for k, value in enumerate(commands.tolist()):
        put([command], [value])
        if k in (60_000, 70_000):
            unit.setBoolean([bypass], [k == 60_000])
        unit.doStep(k * SAMPLE_TIME, SAMPLE_TIME)
        (found[k],) = get([shaped])
    whole = np.convolve(np.concatenate([np.full(len(taps), commands[0]), commands]), taps)[len(taps) :][:count]
    # Every change of the command goes through the taps in force when it comes.
    through = np.diff(commands, prepend=commands[0]) * ((np.arange(count) >= 60_000) & (np.arange(count) < 70_000))
    expected = whole - np.convolve(through, np.cumsum(taps)[:-1] - 1)[:count]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
    state = unit.getFMUState()
    unit.doStep(count * SAMPLE_TIME, 5 * SAMPLE_TIME)
    later = get([shaped])
    unit.setFMUState(state)
    unit.doStep(count * SAMPLE_TIME, 5 * SAMPLE_TIME)
    assert get([shaped]) == later
    unit.freeFMUState(state)
    # What the unit computes cannot be set, and what it does not have cannot be asked for.
    for call in (lambda: put([shaped], [1.0]), lambda: unit.getBoolean([bypass + 1])):
        with pytest.raises(fmpy.fmi1.FMICallException):
            call()
    unit.terminate()
    unit.freeInstance()


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("kind", KINDS)
def test_simulated_by_fmpy(units, fmi, kind):
    """Its own loop over time; a step of co-simulation shows the sample of its beginning at its end."""
    fmpy = pytest.importorskip("fmpy")
    commands = np.concatenate([[0.0], np.random.default_rng(1).normal(size=299)])
    pairs = [*zip(SAMPLE_TIME * np.arange(300), commands, np.zeros(300, bool), strict=True)]
    signals = np.array(pairs, dtype=[("time", float), ("command", float), ("bypass", bool)])
    run = fmpy.simulate_fmu(
        str(units[fmi].path), fmi_type=kind, solver="Euler", stop_time=2.0, step_size=SAMPLE_TIME,
        output_interval=SAMPLE_TIME, input=signals,
    )  # fmt: skip
    expected = np.convolve(commands, SHAPER.digitise(SAMPLE_TIME))
    # Model exchange records before and after each event: the last of them at each time.
    last = {round(time / SAMPLE_TIME): value for time, value in zip(run["time"], run["shaped"], strict=True)}
    late = 1 if kind == "CoSimulation" else 0
    found = [last[k] for k in range(late, 199)]
    np.testing.assert_allclose(found, expected[: 199 - late], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["core", "Model", "equations"])
def test_names_of_files_that_every_unit_has(name):
    with pytest.raises(ValueError, match=f"name must not be '{name}', which a file of every unit is called"):
        js.export(SHAPER, "fmu", sample_time=SAMPLE_TIME, name=name)


def test_no_compiler_is_one_line(monkeypatch):
    monkeypatch.setattr(compiler.shutil, "which", lambda name: None)
    monkeypatch.setattr(compiler.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match="no C compiler was found: install gcc or clang, or pip install ziglang"):
        js.export(SHAPER, "fmu", sample_time=SAMPLE_TIME)
    with pytest.raises(ValueError, match=r"fmi must be one of '2.0', '3.0'"):
        js.export(SHAPER, "fmu", sample_time=SAMPLE_TIME, fmi="1.0")


@pytest.mark.slow
def test_another_compiler(monkeypatch, tmp_path):
    """Zig's, from PyPI, where the machine has none."""
    pytest.importorskip("ziglang")
    monkeypatch.setattr(compiler.shutil, "which", lambda name: None)
    js.export(SHAPER, "fmu", tmp_path / "crane.fmu", sample_time=SAMPLE_TIME)
    ctypes.CDLL(str(unpacked(tmp_path / "crane.fmu").library))


def test_compilers_own_words(monkeypatch, tmp_path):
    (tmp_path / "wrong.c").write_text("int main(", encoding="utf-8")
    with pytest.raises(ValueError, match=r"failed: wrong.c"):
        compiler.library(tmp_path, "wrong.c", "wrong")


# Plants


def evaluated(function, *values):
    """A function as it is written out, its lines run by Python instead of a C compiler."""
    names = [np.array([f"a{i}_{j}" for j in range(np.size(v))], object) for i, v in enumerate(values)]
    names = [array.reshape(np.shape(value)) for array, value in zip(names, values, strict=True)]
    lines, found = written_out(function, names, list(map(jnp.asarray, values)))
    space = {name: getattr(math, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "pow", "tanh", "fabs")}
    space |= {"fmax": max, "fmin": min}
    for array, value in zip(names, values, strict=True):
        space |= dict(zip(array.ravel(), np.ravel(value).tolist(), strict=True))
    for line in lines:
        code = re.sub(r"(\S+) \? (\S+) : (\S+)$", r"\2 if \1 else \3", line.removeprefix("const double ").rstrip(";"))
        exec(code.replace("&&", "and").replace("||", "or"), space)
    return np.vectorize(lambda each: float(eval(each, space)))(found)


@jax.custom_vjp
def softened(x):
    return x / (1 + jnp.abs(x))


softened.defvjp(lambda x: (softened(x), x), lambda x, slope: (slope / (1 + jnp.abs(x)) ** 2,))


@pytest.mark.parametrize(
    "function",
    [
        lambda x, u: jnp.stack([jnp.sin(x[0]) * u, jnp.where(x[1] > 0, x[1] ** 3, -u), jnp.abs(x[2]) ** 0.3]),
        lambda x, u: jnp.array([[1.0, 2.0, 3.0], [0.0, -1.0, 0.5]]) @ x * jnp.exp(-u),
        lambda x, u: jnp.concatenate([x[::-1], jnp.reshape(jnp.max(x) - jnp.min(x) + jnp.sum(x), (1,))]) / (1 + u**2),
        lambda x, u: jnp.outer(x, x)[1] + jnp.pad(x[:2], (1, 0)) + jnp.clip(u, -0.1, 0.1),
        lambda x, u: jax.jit(lambda y: jnp.tanh(y) + jnp.sign(u))(x) + jnp.ones(3) * jnp.sqrt(4.0),
        # Operations that contain others, each in its own way.
        lambda x, u: jax.nn.relu(x) + jax.jit(jnp.sin)(x * u) + softened(x) + jax.checkpoint(jnp.cos)(x),
        # Elements placed anew, by constant indices.
        lambda x, u: x[jnp.array([2, 0, 2])] * u + jax.lax.dynamic_slice(jnp.append(x, u), (1,), (3,)),
        lambda x, u: jax.lax.pad(jnp.outer(x, x[:2]), u, [(1, 1, 1), (0, -1, 0)]),
        # Products and sums over any of the axes, and over none.
        lambda x, u: jnp.outer(x[:2], jnp.sin(x)) @ (jnp.outer(x, x + u) + jnp.arange(9.0).reshape(3, 3)),
        lambda x, u: jnp.tensordot(jnp.outer(x, x[:2] + u), jnp.arange(24.0).reshape(4, 3, 2), ((0, 1), (1, 2))),
        lambda x, u: jnp.tensordot(x * u, x[:2], 0),
        lambda x, u: jnp.sum(jnp.outer(x, x[:2] + u), axis=0) + jnp.max(jnp.outer(x, x[1:]), axis=0),
        lambda x, u: jnp.sum(jnp.reshape(x[:0] * u, (2, 0)), axis=1),
        lambda x, u: x**2 + x**4 + x**5 + x**-2 + (x > -u) * 0.5 + jnp.logical_and(x > 0, u < 1),
        lambda x, u: jnp.asarray([1.5, -2.0]),
    ],
)
def test_equations_as_they_are_written(function):
    x, u = np.array([0.3, 1.7, -0.9]), 0.4
    found = evaluated(function, x, u)
    np.testing.assert_allclose(found, function(jnp.asarray(x), jnp.asarray(u)), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        *((0.0, "0.0"), (0.25, "0.25"), (2, "2.0"), (-0.5, "(-0.5)"), (1e300, "1e+300"), (True, "1.0")),
        *((math.nan, "NAN"), (math.inf, "INFINITY"), (-math.inf, "-INFINITY")),
    ],
)
def test_constants_as_c_reads_them(value, text):
    assert equations.number(value) == text


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda x: jax.lax.while_loop(lambda y: y[0] < 9, lambda y: 2 * y, x), "while"),
        (lambda x: jnp.linalg.solve(jnp.diag(x), x), "."),
        (lambda x: jnp.real(jnp.exp(1j * x)), "^complex numbers$"),
        (lambda x: jnp.abs(jax.lax.complex(x, x)), "^complex of complex numbers$"),
        (lambda x: jnp.einsum("ij,ij->i", jnp.outer(x, x), jnp.outer(x, x)), "^dot_general with batches$"),
        (lambda x: jax.lax.select_n(x.astype(int), x, x + 1, 2 * x), "^select_n of more than two cases$"),
        (lambda x: jax.lax.dynamic_slice(x, (x[0].astype(int),), (1,)), "^dynamic_slice$"),
    ],
)
def test_operations_that_are_refused(function, words):
    with pytest.raises(ValueError, match=words):
        evaluated(function, np.array([0.5, 2.0]))


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def duffing(request, tmp_path_factory, plant):
    path = tmp_path_factory.mktemp("plant") / "duffing.fmu"
    js.export_plant(plant, "fmu", path, name="duffing", fmi=request.param)
    return unpacked(path)


def test_plant_beside_scipy(duffing, plant):
    """Ten swings after a step, in both kinds; the energy is kept."""
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    unit = duffing
    assert validate_fmu(str(unit.path)) == []
    at = np.linspace(0, 4.0, 401)
    field = lambda t, y: [y[1], -10 * (y[0] - 0.5) - 100 * (y[0] - 0.5) ** 3]
    exact = solve_ivp(field, (0, 4), [0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-14, t_eval=at).y
    start = {"displacement": 0.5}
    for kind, allowed in (("CoSimulation", 2e-8), ("ModelExchange", 2e-3)):
        run = fmpy.simulate_fmu(
            str(unit.path), fmi_type=kind, stop_time=4.0, step_size=0.01, output_interval=0.01, start_values=start,
            solver="CVode", relative_tolerance=1e-8,
        )  # fmt: skip
        np.testing.assert_allclose(run["time"], at, atol=1e-9)
        assert np.abs(run["state[1]"] - exact[0]).max() < allowed, kind
        whole = 10 * 0.5**2 / 2 + 100 * 0.5**4 / 4
        np.testing.assert_allclose(run["energy"], whole, rtol=3e-8 if kind == "CoSimulation" else 3e-3)


REFUSED = {
    "forced-mass": "the operation while",
    "flexible-link": "complex numbers",
    "mjcf": "the operation while",
    "urdf": "the operation while",
}


@pytest.mark.slow
@pytest.mark.parametrize("starter", starters.STARTERS, ids=[starter.name for starter in starters.STARTERS])
def test_every_plant_is_written_out_or_refused(starter, tmp_path):
    """Derivatives and energy at random states, by the library itself, beside the plant's own."""
    problem = tmp_path / "plant.toml"
    problem.write_text(starters.text(starter), encoding="utf-8")
    plant = load(problem).plant
    if starter.name in REFUSED:
        with pytest.raises(ValueError, match=f"{type(plant).__name__}.*{REFUSED[starter.name]}"):
            js.export_plant(plant, "fmu")
        return
    fmpy = pytest.importorskip("fmpy")
    js.export_plant(plant, "fmu", tmp_path / "plant.fmu")
    inside = unpacked(tmp_path / "plant.fmu")
    read = fmpy.read_model_description(str(inside.path))
    assert read.modelVariables[-1].description == f"energy above that of rest, {plant.energy_unit}"
    unit = fmpy.fmi2.FMU2Model(
        guid=read.guid, unzipDirectory=str(inside.folder), modelIdentifier="plant", instanceName="one"
    )
    unit.instantiate()
    unit.setupExperiment()
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    zeros, structure = jax.tree.flatten(plant.zero_inputs())
    rng, rest, inputs = np.random.default_rng(0), plant.rest_state(plant.zero_inputs()), len(zeros)
    states = len(rest)
    assert unit.getReal(list(range(inputs, inputs + states))) == pytest.approx(np.asarray(rest).tolist())
    for _ in range(10):
        x, u = rest + 0.1 * rng.normal(size=states), 0.1 * rng.normal(size=inputs)
        unit.setReal(list(range(inputs + states)), [*u.tolist(), *x.tolist()])
        found = unit.getReal(list(range(inputs + states, inputs + 2 * states + 1)))
        given = jax.tree.unflatten(structure, list(map(jnp.asarray, u)))
        exact = [*plant.vector_field(jnp.zeros(()), x, given).tolist(), float(plant.residual_energy(x, given))]
        np.testing.assert_allclose(found, exact, rtol=1e-13, atol=1e-13)
    unit.freeInstance()


def test_what_cannot_be_exported(plant):
    for arguments, words in [
        ((plant, "c"), "format must be one of 'fmu'"),
        (("plant",), "plant must be one of jshape's plants, not 'plant'"),
    ]:
        with pytest.raises(ValueError, match=words):
            js.export_plant(*arguments)
    with pytest.raises(ValueError, match="name must"):
        js.export_plant(plant, name="2fast")


@pytest.mark.parametrize(("start", "summed"), [(0.0, True), (1e5, False)])
def test_no_sample_slips_where_time_is_rounded(units, start, summed):
    """A time that is summed up, or begins far from 0, is off by its rounding."""
    fmpy = pytest.importorskip("fmpy")
    description = fmpy.read_model_description(str(units["2.0"].path))
    unit = fmpy.fmi2.FMU2Slave(
        guid=description.guid, unzipDirectory=str(units["2.0"].folder), modelIdentifier="crane", instanceName="one"
    )
    command, shaped, _ = (v.valueReference for v in description.modelVariables if v.name != "time")
    unit.instantiate()
    unit.setupExperiment(startTime=start)
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    taps, commands, found, time = SHAPER.digitise(SAMPLE_TIME), np.sin(0.01 * np.arange(30_000)), [], start
    for k, value in enumerate(commands.tolist()):
        unit.setReal([command], [value])
        unit.doStep(time if summed else start + k * SAMPLE_TIME, SAMPLE_TIME)
        time += SAMPLE_TIME
        found += unit.getReal([shaped])
    np.testing.assert_allclose(found, np.convolve(commands, taps)[: len(commands)], atol=1e-12)
    unit.terminate()


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        (lambda x: (x / 0.1).astype(int) * 0.1, [-0.1, 0.1]),
        (lambda x: x.astype(bool) * 1.0, [1.0, 1.0]),
        (lambda x: x.astype(jnp.float32).astype(float), np.float32([-0.17, 0.17])),
    ],
)
def test_casts_change_numbers(function, expected):
    lines, _ = equations.written_out(function, [np.array(["a", "b"], object)], [jnp.array([-0.17, 0.17])])
    text = "\n".join(lines)
    assert any(word in text for word in ("trunc(", "!= 0", "(double)(float)")), text
    np.testing.assert_allclose(function(jnp.array([-0.17, 0.17])), expected, rtol=1e-15)
