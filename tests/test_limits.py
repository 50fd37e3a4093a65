"""Problem files, arguments and options that are damaged or hostile: one line, at once, that names the limit."""

import time

import jax.numpy as jnp
import numpy as np
import pytest
from calibration_data import printer
from problems import two_mass
from test_problem import BASE
from typer.testing import CliRunner

import jshape as js
from experiments.reliability import fuzz
from experiments.reliability.damage import damaged
from jshape import adaptive, calibration, kalico, klipper
from jshape.cli import app
from jshape.design import insensitive
from jshape.problems import problem
from jshape.sweeps.chunks import corners
from jshape.sweeps.leaves import grid
from jshape.sweeps.sampling import draw

run = CliRunner().invoke

M2, BAND = "m2 = 1.0", "m2 = { low = 0.8, high = 1.2 }"
LEAVES = "\n".join(
    f"{name} = {{ low = 0.8, high = 1.2, count = 1000 }}" for name in ("m1", "m2", "spring.k1", "spring.k3")
)

# (old, new, the line if there is one, what is said)
BEYOND = {
    "deep lists": (M2, "m2 = " + "[" * 5000 + "]" * 5000, None, "more than 16 tables and lists"),
    "less deep lists": (M2, "m2 = " + "[" * 90 + "]" * 90, 6, "more than 16 tables and lists"),
    "deep tables": (
        "[design]",
        f"[design]\n[design{'.a' * 5000}]",
        17,
        "more than 16 tables and lists are inside of each",
    ),
    "400 digits": (M2, f"m2 = 1{'0' * 400}", 6, "plant.m2: must be at most 1e+18 in size, not a number of 401 digits"),
    "5000 digits": (M2, f"m2 = 1{'0' * 5000}", None, "a whole number has more digits than 1e+18"),
    "a mass of 1e300": (M2, "m2 = 1e300", 6, "plant.m2: must be 0, or lie between 1e-30 and 1e+18 in size, not 1e+300"),
    "a quantity of 1e300": ("distance = 1.0", 'distance = "1e300 mm"', 2, "distance: must be 0, or lie between 1e-30"),
    "a duration of 1e-300": ("impulses = 3", "duration = 1e-300", 17, "design.duration: must be 0, or lie between"),
    "a seed of 400 digits": ("impulses = 3", f"seed = 1{'0' * 400}", 17, "design.seed: must be at most 1e+18"),
    "a key of 100000 names": (M2, f"{'a.' * 10**5}b = 1", 6, "more than 16 tables and lists are inside of each"),
    "names in quotes": (M2, "'=,'.\"].\"." * 10**4 + "b = 1", 6, "more than 16 tables and lists are inside of each"),
    "names of digits": (M2, f"{'1.' * 10**5}1 = 1", 6, "more than 16 tables and lists are inside of each"),
    "a bracket and many spaces": (M2, f"m2 = [\n[{' ' * 10**5}\n]]", 6, "plant.m2"),
    "a huge file": ("[design]", "# " + "x" * 2**20 + "\n[design]", None, "it has more than 1048576 bytes"),
    "a huge key": ("[design]", "[design]\n" + "k" * 10**5 + " = 1", 16, "a key has 100000 characters, more than 1000"),
    "a huge title": ('"test"', f'"{"x" * 10**5}"', 1, "title: must be at most 1000 printable characters"),
    "a title of control characters": ('"test"', '"\\u001b[2J"', 1, "title: must be at most 1000 printable characters"),
    "a key of control characters": (M2, '"\\u001b[2J" = 1', 4, "a key must be of printable characters, not '\\x1b[2J'"),
    "a key from right to left": (M2, '"\\u202em2" = 1', 4, "a key must be of printable characters, not '\\u202em2'"),
    "a list for a word": ('"Duffing"', '["Duffing"]', 9, "plant.spring.type: must be one of"),
    "many plants": (BAND, LEAVES, 13, "uncertainty: makes 1000000000000 plants, more than 10000000"),
    "many values": (BAND, f"m2 = {{ values = [{'1.0,' * 100_001}] }}", 14, "at most 100000 items"),
    "true for a distance": (
        "distance = 1.0",
        "distance = true",
        2,
        "distance: input should be a valid number",
    ),
    "a word for a distance": ("distance = 1.0", 'distance = "1"', 2, "distance: must be a number, or a text with"),
    "true for a factor": (
        "low = 0.8",
        "low = true",
        14,
        "m2.low: input should be a valid number, not True",
    ),
    "true for a duration": ("impulses = 3", "duration = true", 17, "design.duration: input should be a valid number"),
}


@pytest.fixture
def load(tmp_path):
    def load(text):
        path = tmp_path / "problem.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return problem.load(path)

    return load


@pytest.mark.parametrize("case", BEYOND)
def test_a_problem_file_beyond_a_limit_is_refused_in_a_line(load, case):
    old, new, line, words = BEYOND[case]
    assert old in BASE
    begin = time.process_time()
    with pytest.raises(problem.ProblemError) as caught:
        load(BASE.replace(old, new, 1))
    assert time.process_time() - begin < 5
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 3000
    assert (f"problem.toml:{line}: " if line else "problem.toml: ") in str(caught.value)


def test_a_byte_order_mark_whole_numbers_and_other_ends_of_lines_are_accepted(load):
    text = BASE.replace("1.0", "1").replace("high = 1.2", "high = 2").replace('"test"', '"50\u00a0% \U0001f600"')
    read = load(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    assert read.distance == 1
    assert read.title == "50\u00a0% \U0001f600"
    assert read.over["m2"].tolist() == np.linspace(0.8, 2, 41).tolist()


def test_damaged_problem_files_are_refused_in_a_line(load):
    random, content, messages = np.random.default_rng(3), BASE.encode(), []
    for _ in range(150):
        spoilt = damaged(content, random)
        # The damage may name a module; no other code is run here.
        if spoilt.count(b":"):
            continue
        try:
            assert isinstance(load(spoilt), problem.Problem)
        except problem.ProblemError as error:
            messages.append(str(error))
    assert len(messages) > 80
    assert not [words for words in messages if "\n" in words or "problem.toml" not in words]


def test_an_experiment_of_too_many_samples_is_refused(load):
    text = BASE + "[adapt]\nchanges = [[0.0, 1.0]]\nomega = [1.0, 2.0]\nzeta = [0.1, 0.1]\nbands = [[1, 2], [3, 4]]\n"
    load(text)
    for given, words in (
        ("sample_time = 1e-12", "duration must be at most 1000000 times sample_time, not 4e"),
        ("period = 1e-3", "duration must be at most 100000 times period, not 4e"),
    ):
        with pytest.raises(problem.ProblemError, match=words):
            load(f"{text}{given}\n")


# --- memory -----------------------------------------------------------------------------------------------------------


PLANT = js.plants.ModalPlant([4.0, 9.0], [0.05, 0.05])


def test_sets_that_no_memory_holds_are_refused():
    over = {f"omega.{i}": np.linspace(0.8, 1.2, 1000) for i in range(2)} | {
        f"zeta.{i}": np.linspace(0.8, 1.2, 1000) for i in range(2)
    }
    with pytest.raises(ValueError, match=r"over asks for 4e\+12 numbers, which take 2.98e\+04 GiB, more than 16"):
        js.sweep(PLANT, js.Shaper([1.0], [0.0]), 1.0, over)
    with pytest.raises(ValueError, match=r"over asks for 4e\+12 numbers"):
        js.tune(PLANT, 1.0, 3, 1.0, over=over, objective="worst")
    with pytest.raises(ValueError, match=r"samples asks for 8e\+09 numbers"):
        draw({str(i): (0.8, 1.2) for i in range(4)}, 2 * 10**9)
    with pytest.raises(ValueError, match="samples must be at most 2147483647"):
        draw({"omega.0": (0.8, 1.2)}, 2**31)
    with pytest.raises(ValueError, match="over asks for"):
        grid({str(i): jnp.zeros(2) for i in range(31)})


def test_many_uncertain_leaves_have_no_more_corners_than_are_looked_at():
    few = {"a": np.array([1.0, 3.0, 2.0]), "b": np.array([5.0, 4.0, 4.5]), "c": np.array([7.0, 8.0, 9.0])}
    expected = grid({name: jnp.array([values.min(), values.max()]) for name, values in few.items()})
    for name, values in corners(few).items():
        np.testing.assert_array_equal(values, expected[name])
    # All 2^70 corners would take some zettabytes.
    found = corners({str(i): np.array([0.0, 1.0]) for i in range(70)})
    assert {len(values) for values in found.values()} == {64}
    assert float(found["0"].max()) == 0.0
    np.testing.assert_array_equal(found["69"], np.arange(64) % 2)


SHAPER = js.Shaper([1.0, -1.0, 1.0], [0.0, 0.5, 1.0])


@pytest.mark.parametrize("sample_time", [1e-12, 1e-300, 5e-324])
def test_a_filter_of_too_many_taps_is_refused(sample_time):
    for options in ({"format": "scipy"}, {"format": "c99"}, {"format": "on_off", "modes": [(9.0, 0.0)]}):
        with pytest.raises(ValueError, match="sample_time must be at least 1e-07 s for 1 s, not"):
            js.export(SHAPER, options.pop("format"), sample_time=sample_time, **options)
    with pytest.raises(ValueError, match="sample_time must be at least"):
        js.tune(PLANT, 1.0, 3, 1.0, sample_time=sample_time)


@pytest.mark.parametrize("value", [10**400, [10**400], "1", True, None])
def test_numbers_that_are_none_are_refused(value):
    with pytest.raises(ValueError, match="times must"):
        js.Shaper([1.0], value)


# --- options and arguments --------------------------------------------------------------------------------------------


def test_options_of_a_reset_that_mean_nothing_are_refused():
    envs = pytest.importorskip("jshape_envs")
    single, several = envs.MoveEnv("DuffingPayload"), envs.MoveVectorEnv(2, "DuffingPayload")
    for options in ({"payload": 3.0}, ["reset_mask"], "all"):
        with pytest.raises(ValueError, match="options must be empty"):
            single.reset(seed=0, options=options)
        with pytest.raises(ValueError, match="options must hold reset_mask alone, or nothing, not"):
            several.reset(seed=0, options=options)
    for mask in (["no", "yes"], [1, 0], [True], [[True, True]], None):
        with pytest.raises(ValueError, match="reset_mask must have 2 entries"):
            several.reset(seed=0, options={"reset_mask": mask})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["sweep", "paper_001", "--samples", "1000000000000"], "samples must be at most 2147483647"),
        (["sweep", "paper_001", "--samples", "8", "--seed", "-1"], "seed must be"),
        (["sweep", "paper_001", "--samples", "0"], "samples must be"),
        (["shape", "x" * 5000], "jshape: xxx"),
    ],
)
def test_arguments_beyond_a_limit_are_refused_in_a_line(arguments, words, tmp_path):
    result = run(app, [*arguments, "--out", str(tmp_path / "out")])
    assert result.exit_code == 2, result.output
    assert words in result.output
    assert "Traceback" not in result.output


# --- arbitrary input --------------------------------------------------------------------------------------------------


@pytest.mark.unchecked
def test_a_few_hundred_arbitrary_inputs():
    """``python -m experiments.reliability.fuzz`` tries a hundred thousand."""
    found = fuzz.run(400, seed=11, names=tuple(name for name in fuzz.TARGETS if name != "arguments, fifty at a time"))
    assert sum(each.inputs for each in found.values()) > 380
    assert {name: each.faults for name, each in found.items() if each.faults} == {}
    read = {name for name, each in found.items() if each.read}
    assert {"problem files, damaged", "problem files, altered", "measured records", "chunks of a store"} <= read


@pytest.mark.slow
def test_arbitrary_arguments():
    found = fuzz.run(4000, seed=12, names=("arguments, fifty at a time",))
    assert found["arguments, fifty at a time"].faults == {}


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: js.plants.ModalPlant([]), "omega, zeta and gains must be lists of the same length, at least 1"),
        (lambda: js.plants.PowerLawSpring(1.0, "3"), "power must be a number, not '3'"),
        (lambda: js.plants.PowerLawSpring(1.0, True), "power must be a number, not True"),
        (lambda: js.plants.PowerDamper(1.0, [3]), r"power must be a number, not \[3\]"),
        (lambda: js.plants.PowerDamper(1.0, 10**400), "power must be numeric"),
        (lambda: js.plants.ModalPlant(np.zeros((2, 2, 2))), r"omega must be greater than 0, not \[\[\[0., 0.\], \[0"),
    ],
)
def test_wrong_arguments_that_were_found_so(build, words):
    with pytest.raises(ValueError, match=words) as caught:
        build()
    assert "\n" not in str(caught.value)


def test_the_fuzzer_finds_faults(tmp_path):
    """A reader that lets an error through, gives other numbers, or says too much is reported."""

    def faulty(random, folder):
        kind = random.integers(4)
        if kind == 0:
            raise KeyError("let through")
        if kind == 1:
            raise ValueError("two\nlines")
        if kind == 2:
            raise fuzz.FaultError("another result")
        raise ValueError("refused")

    found = fuzz.tried(faulty, 40, np.random.default_rng(0), tmp_path)
    assert {words.split(":")[0] for words in found.faults} == {"KeyError", "a message of 9 characters", "FaultError"}
    assert any(line.startswith("| faulty | 40 | 0 |") for line in fuzz.report({"faulty": found}))


def test_a_name_that_no_file_may_have_is_refused():
    with pytest.raises(ValueError, match="name must have at most 100 characters, not 999"):
        js.export(SHAPER, "c99", sample_time=0.01, name="x" * 999)


MASSES, PAIR = two_mass(), js.Shaper([0.5, 0.5], [0.0, 0.6])
MOVE, OF = dict(plant=MASSES, distance=1.0), dict(plant=MASSES, shaper=PAIR, distance=1.0)
OVER = dict(plant=MASSES, shapers=PAIR, distance=1.0, over={"m2": (0.9, 1.1)})
VIBRATION = dict(times=np.arange(100) / 10, values=np.sin(np.arange(100)))
SPECTRA, IMPULSES = dict(spectra=[printer(50.0)]), dict(amplitudes=[0.5, 0.5], times=[0.0, 0.01])
WAVE = dict(amplitude=1.0, period=2.0, duration=4.0, changes=[(1.0, 2.0)], sample_time=0.01)

# (function, arguments of which all is well, names of those that are none)
WRONG = [
    (js.sweep, OVER, "plant shapers distance over metric store progress"),
    (js.sensitivity_indices, OVER | dict(samples=4), "plant over confidence progress"),
    (js.tune, MOVE, "plant limit seed shapers start progress sample_time"),
    (js.pareto, MOVE | dict(over={"m2": [0.9, 1.1]}), "plant impulses amplitudes limit seed shapers store progress"),
    (js.simulate, dict(plant=MASSES, command=1.0), "plant command shaper horizon"),
    (js.percentage_vibration, dict(shaper=PAIR, omega=3.0), "shaper omega zeta"),
    (js.insensitivity, dict(shaper=PAIR, omega=3.0), "shaper omega zeta vibration"),
    (js.settling_time, OF, "plant shaper band periods"),
    (js.rise_time, OF, "low high"),
    (js.residual_energy, OF, "plant tolerance"),
    (PAIR.pad, {}, "impulses"),
    (js.export, dict(shaper=PAIR, format="json"), "shaper path"),
    (js.read_shaper, {}, "path"),
    (js.keep_programs, {}, "folder"),
    (js.identify, VIBRATION, "times values names progress"),
    (js.identify_csv, dict(path="pair.csv"), "path columns sample_rate"),
    (js.identify_payloads, dict(records=[], masses=[]), "records"),
    (js.identify_planar, dict(along_x=None, along_y=None), "along_x"),
    (insensitive.rounded, dict(shaper=PAIR, sample_time=0.01, band=(9.0, 10.0)), "shaper sample_time"),
    (klipper.klipper_shaper, dict(kind="ei", frequency=50.0), "kind frequency zeta"),
    (kalico.kernel, dict(kind="smooth_zv"), "frequency"),
    (calibration.read, {}, "paths"),
    (
        calibration.power_spectrum,
        dict(times=np.arange(9), acceleration=np.ones((9, 1))),
        "times acceleration",
    ),
    (calibration.max_accel, IMPULSES, "amplitudes times corner_speed target"),
    (calibration.fit, SPECTRA | dict(kind="zv"), "kind spectra zeta zetas corner_speed highest"),
    (calibration.calibrate, SPECTRA, "spectra zeta highest progress"),
    (calibration.tune, SPECTRA | dict(duration=0.015), "spectra vibration shift zetas least seed progress"),
    (calibration.recommend, {}, "fits"),
    (adaptive.case, dict(name="I-D", sample_time=0.005), "name sample_time"),
    (adaptive.square_wave, WAVE, "amplitude period duration changes sample_time"),
]


@pytest.mark.parametrize(("function", "given", "names"), WRONG, ids=[function.__name__ for function, *_ in WRONG])
def test_arguments_of_the_wrong_kind_are_named_in_a_line(function, given, names):
    for name in names.split():
        texts = name in ("path", "paths", "folder", "store", "columns", "names")
        for wrong in (object(),) if texts else (object(), "a"):
            with pytest.raises(ValueError) as caught:
                function(**given | {name: wrong})
            message = str(caught.value)
            assert name in message
            assert "\n" not in message
