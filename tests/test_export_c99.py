"""The C header, compiled strictly and run under sanitizers, against the same filter in NumPy, sample by sample."""

import re
import shutil
import subprocess

import numpy as np
import pytest

import jshape as js
from jshape.export import export
from jshape.export.c99 import error_bound, quantise

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow"]
SANITIZED = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]

DRIVER = """
#include <stdio.h>
#include <stdlib.h>
#define AXIS_CAPACITY @capacity@
#include "axis.h"
static const unsigned delays[] = {@delays@};
static const @tap@ gains[] = {@gains@};
static const axis_taps other = {@count@, delays, gains};
static const unsigned late[] = {@capacity@};
static const axis_taps too_late = {1, late, axis_unity};
int main(void) {
    axis_state *s = malloc(sizeof *s); /* so that a write beyond it is seen */
    char what;
    double value;
    axis_init(s, (@sample@)@start@);
    while (scanf(" %c %lf", &what, &value) == 2) {
        if (what == 'c') printf("%.17g\\n", (double)axis_step(s, (@sample@)value));
        if (what == 'b') printf("%d\\n", axis_bypass(s, value != 0));
        if (what == 's') printf("%d\\n", axis_set(s, value > 1 ? &too_late : value > 0 ? &other : &axis_default));
        if (what == 'r') axis_reset(s, (@sample@)value);
    }
    free(s);
    return 0;
}
"""


class Machine:
    """The same from its definition: every change of the command goes through the taps in force when it comes."""

    def __init__(self, default, other, capacity, start):
        self.taps = {"default": default, "other": other, "through": np.ones(1)}
        self.capacity, self.shaper, self.bypassed = capacity, "default", False
        self.force = self.former = "default"
        self.parts = []
        self.reset(start)

    def reset(self, value):
        self.last, self.rest, self.moves, self.age = value, value, [], self.capacity

    def change(self, force):
        if self.age < self.capacity:
            return 0
        if force != self.force:
            self.force, self.former, self.age = force, self.force, 0
        return 1

    def bypass(self, on):
        accepted = self.change("through" if on else self.shaper)
        self.bypassed = bool(on) if accepted else self.bypassed
        return accepted

    def set(self, which):
        name = {0: "default", 1: "other"}.get(which)
        if name is None or not (self.bypassed or self.change(name)):
            return 0
        self.shaper = name
        return 1

    def step(self, value):
        self.moves.append((value - self.last, np.cumsum(self.taps[self.force])))
        self.last, self.age = value, min(self.age + 1, self.capacity)
        self.parts.append([self.force] if self.age == self.capacity else [self.force, self.former])
        past = reversed(self.moves)
        return self.rest + sum(move * response[min(k, len(response) - 1)] for k, (move, response) in enumerate(past))


def c_array(values):
    return ", ".join(map(str, values))


def compiled(folder, shaper, arithmetic, start, **options):
    """A program around the header; it reads orders and prints answers. With it, its two sets of exact taps."""
    header = export(shaper, "c99", folder / "axis.h", name="axis", arithmetic=arithmetic, **options)
    taps = shaper.digitise(options["sample_time"], options.get("method", "nearest"), options.get("modes", ()))
    other = np.zeros(len(taps) + 7)
    other[[0, 5, -1]] = [0.3, 0.55, 0.15]
    kept = np.flatnonzero(other)
    sample, bits = {"q15": ("int16_t", 14), "q31": ("int32_t", 30)}.get(arithmetic, (arithmetic, None))
    gains = other[kept] if bits is None else quantise(other[kept], bits)
    # The driver's own numbers are plain double literals; a float gets them rounded.
    words = [f"{gain!r}f" if arithmetic == "float" else repr(gain) for gain in gains.tolist()]
    capacity = len(other) + 2
    values = {"capacity": capacity, "count": 3, "tap": sample, "sample": sample, "start": start}
    values |= {"delays": c_array(kept), "gains": c_array(words)}
    code = re.sub(r"@(\w+)@", lambda m: str(values[m[1]]), DRIVER)
    (folder / "main.c").write_text(code, encoding="utf-8")
    command = ["gcc", *STRICT, *SANITIZED, "main.c", "-o", "main"]
    built = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    return header, taps, other, capacity


def answers(folder, orders):
    text = "".join(f"{what} {value!r}\n" for what, value in orders)
    done = subprocess.run(["./main"], cwd=folder, input=text, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [float(line) for line in done.stdout.split()]


def orders_for(rng, commands, capacity):
    """Commands with changes of every kind between them, some too early to be accepted, and one reset."""
    orders = []
    for k, command in enumerate(commands):
        if k % (capacity // 3 + 1) == 0:
            orders.append([("b", 1), ("b", 0), ("s", 1), ("s", 0), ("s", 2)][rng.integers(5)])
        if k == len(commands) // 2:
            orders.append(("r", float(command)))
        orders.append(("c", float(command)))
    return orders


def expected(machine, orders):
    """The machine's answers, and which of them are acknowledgements."""
    found, flags = [], []
    for what, value in orders:
        if what == "r":
            machine.reset(value)
            continue
        found.append({"c": machine.step, "b": machine.bypass, "s": machine.set}[what](value))
        flags.append(what != "c")
    return np.array(found, float), np.array(flags)


CASES = {
    "float": (js.design.linear.zvd(9.0, 0.017), dict(sample_time=0.02)),
    "double": (
        js.design.linear.multi_mode([(9.0, 0.017), (31.0, 0.02)], "zv"),
        dict(sample_time=0.01, method="zeros", modes=[(9.0, 0.017), (31.0, 0.02)]),
    ),
    "q15": (js.Shaper([1.0, -1.0, 1.0], [0.0, 0.0524, 0.1047]), dict(sample_time=0.003, method="split")),
    "q31": (
        js.Shaper([0.30, 0.46, 0.24], [0.0, 0.2634, 0.5241]),
        dict(sample_time=0.01, method="split", modes=[(12.0, 0.05)]),
    ),
}


@needs_gcc
@pytest.mark.parametrize("arithmetic", CASES)
def test_sample_by_sample(arithmetic, tmp_path):
    shaper, options = CASES[arithmetic]
    rng = np.random.default_rng(7)
    fixed = {"q15": (16, 14), "q31": (32, 30)}.get(arithmetic)
    # A third of full scale: a UM shaper triples it at worst, and nothing saturates; a change may add as much again.
    scale = 1.0 if fixed is None else 2.0 ** (fixed[0] - 1) / 6
    start = 0.25 if fixed is None else 5
    header, taps, other, capacity = compiled(tmp_path, shaper, arithmetic, start, **options)
    walk = np.concatenate([np.repeat(rng.uniform(-1, 1, 8), 3 * capacity // 2), rng.uniform(-1, 1, 6 * capacity)])
    commands = scale * walk if fixed is None else np.rint(scale * walk)
    commands = commands.astype(np.float32).astype(float) if arithmetic == "float" else commands
    orders = orders_for(rng, commands, capacity)
    machine = Machine(taps, other, capacity, start)
    wanted, flags = expected(machine, orders)
    found = np.array(answers(tmp_path, orders))
    np.testing.assert_array_equal(found[flags], wanted[flags])
    assert {0.0, 1.0} == set(wanted[flags])
    if fixed is None:
        assert np.abs(found - wanted)[~flags].max() < {"float": 2e-6, "double": 1e-14}[arithmetic]
        return
    samples, bits = fixed
    bound = {
        name: error_bound(each, quantise(each, bits), bits, samples)
        for name, each in {"default": taps, "other": other, "through": np.ones(1)}.items()
    }
    assert f"at most {bound['default']:.4g} steps of 2^-{samples - 1}" in header
    # Of the bound, the half step of the last rounding stays; the rest is for commands of full scale.
    tight = {name: (each - 0.5) * np.abs(commands).max() / 2.0 ** (samples - 1) + 0.5 for name, each in bound.items()}
    allowed = np.array([sum(tight[name] for name in names) for names in machine.parts])
    errors = np.abs(found - wanted)[~flags]
    assert np.all(errors <= allowed)
    # Where only one set of taps is at work, too, it is seen that the output is a whole number.
    assert errors[[len(names) == 1 for names in machine.parts]].max() > 0.4


@needs_gcc
@pytest.mark.parametrize("arithmetic", ["float", "q15"])
def test_rest_is_exact_and_changes_make_no_jump(arithmetic, tmp_path):
    shaper = js.design.linear.zvd(9.0, 0.1)
    start = 0.1 if arithmetic == "float" else 11
    _, taps, _, capacity = compiled(tmp_path, shaper, arithmetic, start, sample_time=0.02)
    level = float(np.float32(0.7)) if arithmetic == "float" else 20011.0
    rest = [("c", level)] * (capacity + 1)
    changes = [("b", 1), *rest, ("b", 0), *rest, ("s", 1), *rest]
    found = answers(tmp_path, [("c", level)] * len(taps) + changes)
    # Once the shaper's length has passed, the command itself comes out, through every change.
    held = [value for value in found[len(taps) :] if value != 1.0]
    assert len(held) == 3 * len(rest)
    assert set(held) == {level}
    # Bypassed in mid-move, what was on its way is still shaped: the next samples are as if nothing had happened.
    moving = [("c", level)] * 5
    plain = answers(tmp_path, moving * 2)
    bypassed = answers(tmp_path, [*moving, ("b", 1), *moving])
    assert bypassed[:5] + bypassed[6:] == pytest.approx(plain, rel=1e-6)


@needs_gcc
def test_saturation_at_full_scale(tmp_path):
    shaper = js.Shaper([1.0, -1.0, 1.0], [0.0, 0.01, 0.02])
    _, taps, _, capacity = compiled(tmp_path, shaper, "q15", 0, sample_time=0.01)
    commands = np.repeat([32767.0, -32768.0, 32767.0, -32768.0], [1, 1, 1, capacity])
    found = answers(tmp_path, [("c", value) for value in commands.tolist()])
    exact = np.convolve(commands, taps)[: len(commands)]
    np.testing.assert_array_equal(found, np.clip(exact, -32768, 32767))
    assert np.abs(exact).max() > 65535


@pytest.mark.parametrize("bits", [14, 30])
def test_quantised_taps_sum_to_one_and_the_bound_is_tight(bits):
    rng = np.random.default_rng(bits)
    samples = bits + 2
    for count in (1, 2, 3, 7, 40):
        taps = rng.normal(size=count) / np.sqrt(count) / 2
        taps[0] += 1 - taps.sum()
        whole = quantise(taps, bits)
        assert whole.sum() == 2**bits
        assert np.abs(whole / 2.0**bits - taps).max() < 2.0**-bits
        # No other choice of roundings that sums to 1 is nearer in total: exhaustively for the small ones.
        if count == 3:
            floor = np.floor(taps * 2**bits)
            others = [floor + np.array([i, j, k]) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
            best = min(np.abs(o / 2.0**bits - taps).sum() for o in others if o.sum() == 2**bits)
            assert np.abs(whole / 2.0**bits - taps).sum() <= best * (1 + 1e-9) + 1e-15
        # Full-scale commands of the worst signs come to the bound but for the output's own rounding.
        error = whole / 2.0**bits - taps
        reached = abs(error @ (np.sign(error) * 2.0 ** (samples - 1)))
        assert reached == pytest.approx(error_bound(taps, whole, bits, samples) - 0.5, abs=1e-9)


def test_what_digitising_costs_stands_in_the_comment():
    shaper, options = CASES["double"]
    text = export(shaper, "c99", arithmetic="double", **options)
    lines = re.findall(r"omega = (\S+) rad/s, zeta = (\S+): (\S+) % exact, (\S+) % digitised", text)
    assert [(float(w), float(z)) for w, z, *_ in lines] == options["modes"]
    for *_, exact, digitised in lines:
        assert float(exact) < 1e-10
        assert float(digitised) < 1e-10
    coarse = export(shaper, "c99", sample_time=0.01, modes=[(9.0, 0.017)], method="nearest")
    (shown,) = re.findall(r"(\S+) % digitised", coarse)
    nearest = shaper.digitise(0.01)
    whole = js.Shaper(nearest, 0.01 * np.arange(len(nearest)))
    assert float(shown) == pytest.approx(100 * float(js.percentage_vibration(whole, 9.0, 0.017)), rel=1e-3)


def test_what_c_cannot_carry():
    shaper = js.design.linear.zv(9.0)
    for name in ("2fast", "double", "a-b", "", "two__lines", "class", "trailing_"):
        with pytest.raises(ValueError, match="name must"):
            export(shaper, "c99", sample_time=0.01, name=name)
    with pytest.raises(ValueError, match="arithmetic must be one of"):
        export(shaper, "c99", sample_time=0.01, arithmetic="q7")
    wild = js.Shaper([2.5, -2.0, 0.5], [0.0, 0.1, 0.2])
    with pytest.raises(ValueError, match="in fixed point the sum must be below 4 and each below 2"):
        export(wild, "c99", sample_time=0.01, arithmetic="q15")
    assert "2.5f" in export(wild, "c99", sample_time=0.01)


ONLY = """
#include "axis.h"
axis_state state;
void start(@sample@ position) { axis_init(&state, position); }
@sample@ step(@sample@ command) { return axis_step(&state, command); }
int bypass(int on) { return axis_bypass(&state, on); }
int set(const axis_taps *taps) { return axis_set(&state, taps); }
"""
SAMPLES = {"float": "float", "double": "double", "q15": "int16_t", "q31": "int32_t"}


def only(folder, arithmetic):
    """A file that has the header's functions alone, each once."""
    shaper, options = CASES[arithmetic]
    export(shaper, "c99", folder / "axis.h", name="axis", arithmetic=arithmetic, **options)
    (folder / "only.c").write_text(ONLY.replace("@sample@", SAMPLES[arithmetic]), encoding="utf-8")


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
@pytest.mark.parametrize("arithmetic", CASES)
def test_the_same_header_is_c_plus_plus(arithmetic, tmp_path):
    only(tmp_path, arithmetic)
    command = ["g++", "-std=c++17", "-x", "c++", *STRICT[1:], "-c", "only.c"]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr


ARM = ["arm-none-eabi-gcc", *STRICT, "-mfloat-abi=soft"]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="no compiler for microcontrollers")
@pytest.mark.parametrize("arithmetic", ["q15", "q31"])
def test_a_microcontroller_without_floating_point(arithmetic, tmp_path):
    """No routine for floating point is needed, nor for division; the size of what is left."""
    only(tmp_path, arithmetic)
    for core, most in (("cortex-m0", 900), ("cortex-m4", 800)):
        command = [*ARM, f"-mcpu={core}", "-mthumb", "-Os", "-ffreestanding", "-c", "only.c"]
        built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert built.returncode == 0, built.stderr
        read = lambda *words: subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
        # A core without long products calls for one; nothing else is called.
        missing = re.findall(r"U (\w+)", read("arm-none-eabi-nm", "-u", "only.o"))
        assert set(missing) <= ({"__aeabi_lmul"} if (arithmetic, core) == ("q31", "cortex-m0") else set())
        text = int(read("arm-none-eabi-size", "only.o").splitlines()[1].split()[0])
        assert 300 < text < most


@pytest.mark.slow
@pytest.mark.skipif(
    shutil.which("arm-none-eabi-gcc") is None or shutil.which("qemu-arm") is None, reason="no emulated processor"
)
@pytest.mark.parametrize("arithmetic", ["q15", "q31"])
def test_an_emulated_processor_without_floating_point(arithmetic, tmp_path):
    """An ARM926 gives the same samples bit for bit, changes between them."""
    shaper, options = CASES[arithmetic]
    _, _, _, capacity = compiled(tmp_path, shaper, arithmetic, 5, **options)
    rng = np.random.default_rng(11)
    full = 2.0 ** ({"q15": 16, "q31": 32}[arithmetic] - 1) / 6
    orders = orders_for(rng, np.rint(full * rng.uniform(-1, 1, 12 * capacity)), capacity)
    here = answers(tmp_path, orders)
    command = ["arm-none-eabi-gcc", "-std=c99", "-O2", "-mcpu=arm926ej-s", "-marm", "-mfloat-abi=soft"]
    built = subprocess.run(
        [*command, "--specs=rdimon.specs", "main.c", "-o", "main.elf"], cwd=tmp_path, capture_output=True, text=True
    )
    assert built.returncode == 0, built.stderr
    text = "".join(f"{what} {value!r}\n" for what, value in orders)
    run = ["qemu-arm", "-cpu", "arm926", "./main.elf"]
    done = subprocess.run(run, cwd=tmp_path, input=text, capture_output=True, text=True, timeout=300)
    assert [float(line) for line in done.stdout.split()] == here
