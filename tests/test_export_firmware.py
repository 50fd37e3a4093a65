"""Lines for printers, read as their firmware reads them: the shaper comes back, or the format refuses."""

import configparser
import math
import re

import numpy as np
import pytest

import jshape as js
from jshape.export import export
from jshape.klipper import KINDS, klipper_shaper

# Klipper's own numbers at 50 Hz, zeta 0.1: amplitudes and times in ms, to the six digits that it prints.
GOLDEN = {
    "zv": ([0.578286, 0.421714], [0, 10.0504]),
    "mzv": ([0.365128, 0.407489, 0.227383], [0, 7.5378, 15.0756]),
    "zvd": ([0.334415, 0.487743, 0.177843], [0, 10.0504, 20.1008]),
    "ei": ([0.354881, 0.452998, 0.192121], [0, 10.1448, 20.1008]),
    "2hump_ei": ([0.258535, 0.359936, 0.272764, 0.108765], [0, 10.3181, 20.1641, 29.7785]),
    "3hump_ei": ([0.220854, 0.277211, 0.2597, 0.167055, 0.075179], [0, 10.81, 20.561, 30.118, 39.6585]),
}


def klipper_settings(text):
    parser = configparser.ConfigParser()
    parser.read_string(text)
    return dict(parser["input_shaper"])


@pytest.mark.parametrize("kind", GOLDEN)
def test_klipper_knows_its_own(kind):
    amplitudes, times = (np.array(each, float) for each in GOLDEN[kind])
    settings = klipper_settings(export(js.Shaper(amplitudes / amplitudes.sum(), times / 1000), "klipper", axis="y"))
    assert settings["shaper_type_y"] == kind
    assert float(settings["shaper_freq_y"]) == pytest.approx(50.0, rel=2e-5)
    assert float(settings["damping_ratio_y"]) == pytest.approx(0.1, abs=2e-5)


@pytest.mark.parametrize("firmware", ["current", "2024"])
@pytest.mark.parametrize("kind", KINDS)
def test_klipper_reads_the_shaper_back(kind, firmware):
    for frequency, zeta in ((23.7, 0.0), (71.2, 0.063), (138.0, 0.2)):
        shaper = klipper_shaper(kind, frequency, zeta, firmware)
        settings = klipper_settings(export(shaper, "klipper", firmware=firmware))
        assert settings["shaper_type_x"] == kind
        back = klipper_shaper(kind, float(settings["shaper_freq_x"]), float(settings["damping_ratio_x"]), firmware)
        np.testing.assert_allclose(back.amplitudes, shaper.amplitudes, rtol=0, atol=3e-7)
        np.testing.assert_allclose(back.times, shaper.times, rtol=0, atol=3e-7 * float(shaper.duration))


@pytest.mark.parametrize(
    ("shaper", "name", "values", "zeta"),
    [
        (klipper_shaper("mzv(n=5,t=0.998)", 71.72, 0.081), "mzv", (5, 0.998), 0.081),
        (klipper_shaper("mzv(n=3,tau=1.2)", 60.0, 0.3), "mzv", (3, 12 / 17), 0.3),
        (klipper_shaper("mzv(10, 1.2)", 43.0, 0.02), "mzv", (10, 1.2), 0.02),
        (klipper_shaper("ei(0.1)", 60.0, 0.1), "ei", (0.1,), 0.1),
        (js.design.linear.zvdd(300.0, 0.1), "mzv", (4, 1.5), 0.1),
    ],
    ids=["mzv", "tau", "ten", "ei", "zvdd"],
)
def test_klipper_reads_the_families_back(shaper, name, values, zeta):
    """The name as the firmware reads it: (key=)number, of digits and points alone; a whole n."""
    text = export(shaper, "klipper")
    settings = klipper_settings(text)
    found = re.fullmatch(r"(\w+)\((.*)\)", settings["shaper_type_x"])
    assert found is not None
    assert found[1] == name
    pairs = re.findall(r"(\w+)=([\d.]+)", found[2])
    assert found[2] == ",".join(f"{key}={value}" for key, value in pairs)
    assert [float(value) for _, value in pairs] == pytest.approx(values, abs=1e-3)
    assert all("." not in value for key, value in pairs if key == "n")
    assert float(settings["damping_ratio_x"]) == pytest.approx(zeta, abs=2e-4)
    frequency = float(settings["shaper_freq_x"])
    back = klipper_shaper(settings["shaper_type_x"], frequency, float(settings["damping_ratio_x"]))
    np.testing.assert_allclose(back.amplitudes, shaper.amplitudes, rtol=0, atol=3e-5)
    np.testing.assert_allclose(back.times, shaper.times, rtol=0, atol=3e-5 * float(shaper.duration))
    assert "Needs Klipper of 22 March 2026" in text
    with pytest.raises(ValueError, match="none of them"):
        export(shaper, "klipper", firmware="2024")


def test_kalico_reads_the_list_back():
    shaper = js.Shaper([0.2, 0.5, 0.3], [0.0, 0.004, 0.0123])
    settings = klipper_settings(export(shaper, "kalico", axis="y"))
    assert settings["shaper_type_y"] == "custom"
    lists = [[float(value) for value in settings[f"shaper_{letter}_y"].split(",")] for letter in "at"]
    np.testing.assert_allclose(lists, [shaper.amplitudes, shaper.times], atol=1e-9)
    for wrong, words in [
        (js.design.linear.zvd_n(300.0, 0.0, order=4), "2 to 5 impulses, not 6"),
        (js.Shaper([0.9995, 0.0005], [0.0, 0.01]), "amplitudes of at least 0.001"),
        (js.Shaper([0.5, 0.5], [0.0, 0.3]), r"over 0.001 to 0.2 s"),
        (js.Shaper([0.5, 0.2, 0.3], [0.0, 0.01, 0.01]), "times that increase"),
    ]:
        with pytest.raises(ValueError, match=words):
            export(wrong, "kalico")


def test_klipper_takes_what_is_near_and_says_how_near():
    # The exact one, by Newton's method on its equations; Klipper has a fit of it.
    shaper = js.design.linear.ei(2 * np.pi * 50, 0.1)
    text = export(shaper, "klipper")
    settings = klipper_settings(text)
    theirs = klipper_shaper("ei", float(settings["shaper_freq_x"]), float(settings["damping_ratio_x"]))
    off = max(
        np.abs(np.asarray(theirs.amplitudes - shaper.amplitudes)).max(),
        np.abs(np.asarray(theirs.times - shaper.times)).max() / float(shaper.duration),
    )
    assert 1e-5 < off < 1e-3
    assert f"within {off:.1g}." in text
    with pytest.raises(ValueError, match=r"the nearest, ei\(v_tol=0.049"):
        export(shaper, "klipper", tolerance=1e-5)
    with pytest.raises(ValueError, match="tolerance must be a number, not 'y'"):
        export(shaper, "klipper", tolerance="y")


@pytest.mark.parametrize(
    "shaper",
    [
        js.Shaper([1.0, -1.0, 1.0], [0.0, 0.0035, 0.007]),
        js.Shaper([1.0], [0.0]),
        js.Shaper([0.5, 0.5], [0.0, 0.0]),
        js.Shaper([0.6, 0.3, 0.1], [0.0, 0.01, 0.03]),
        js.design.linear.multi_mode([(300.0, 0.1), (420.0, 0.1)], "zv"),
        js.Shaper([0.4, 0.6], [0.0, 0.01]),
    ],
    ids=["um_zv", "one impulse", "no duration", "uneven", "two modes", "growing"],
)
def test_klipper_and_marlin_refuse_what_they_have_no_name_for(shaper):
    with pytest.raises(ValueError, match="none of them"):
        export(shaper, "klipper")
    with pytest.raises(ValueError, match="takes the ZV alone"):
        export(shaper, "marlin")


@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.4])
def test_marlin_reads_the_shaper_back(zeta):
    shaper = js.design.linear.zv(2 * np.pi * 43.0, zeta)
    text = export(shaper, "marlin", axis="y")
    ((axis, frequency, damping),) = re.findall(r"^M593 (\w) F(\S+) D(\S+)$", text, re.M)
    assert axis == "Y"
    # What the firmware makes of it: half a period of F apart, K = exp(-zeta pi / sqrt(1 - zeta^2)).
    k = math.exp(-math.pi * float(damping) / math.sqrt(1 - float(damping) ** 2))
    np.testing.assert_allclose([1 / (1 + k), k / (1 + k)], shaper.amplitudes, rtol=0, atol=2e-6)
    np.testing.assert_allclose(0.5 / float(frequency), shaper.duration, rtol=1e-7)


@pytest.mark.parametrize("firmware", ["3.6", "3.4"])
def test_reprapfirmware_reads_the_shaper_back(firmware):
    for shaper in (
        klipper_shaper("3hump_ei", 50.0),
        js.Shaper([0.2, 0.5, 0.3], [0.0, 0.004, 0.0123]),
        js.design.linear.zv(120.0, 0.3),
    ):
        text = export(shaper, "reprapfirmware", firmware=firmware)
        (found,) = re.findall(r'^M593 P"custom" H(\S+) T(\S+)$', text, re.M)
        heights, delays = (np.array(words.split(":"), float) for words in found)
        if firmware == "3.6":
            assert heights.sum() < 1
            amplitudes, times = np.append(heights, 1 - heights.sum()), np.append(0, delays)
        else:
            amplitudes, times = np.diff(np.concatenate([[0], heights, [1]])), np.append(0, np.cumsum(delays))
        np.testing.assert_allclose(amplitudes, shaper.amplitudes, rtol=0, atol=3e-7)
        np.testing.assert_allclose(times, shaper.times, rtol=0, atol=3e-7)


def test_reprapfirmware_refuses_what_it_has_no_room_for():
    for shaper, words in [
        (js.design.linear.zvd_n(300.0, 0.0, order=4), "2 to 5 impulses, not 6"),
        (js.Shaper([1.0], [0.0]), "2 to 5 impulses, not 1"),
        (js.Shaper([1.0, -1.0, 1.0], [0.0, 0.0035, 0.007]), "positive amplitudes alone"),
        (js.Shaper([0.5, 0.2, 0.3], [0.0, 0.01, 0.01]), "times that increase"),
    ]:
        with pytest.raises(ValueError, match=words):
            export(shaper, "reprapfirmware")
    with pytest.raises(ValueError, match="firmware must be one of"):
        export(js.design.linear.zv(300.0), "reprapfirmware", firmware="2.0")
    with pytest.raises(ValueError, match="axis must be one of"):
        export(js.design.linear.zv(300.0), "klipper", axis="e")


@pytest.mark.parametrize("format", ["klipper", "marlin", "reprapfirmware"])
def test_comments_hold_the_exact_numbers(format):
    shaper = js.design.linear.zv(313.7, 0.07)
    mark = "#" if format == "klipper" else ";"
    rows = re.findall(rf"^{mark}\s+([\d.e-]+)\s+([\d.e-]+)$", export(shaper, format), re.M)
    assert [[float(word) for word in row] for row in rows] == np.column_stack(
        [shaper.times, shaper.amplitudes]
    ).tolist()


@pytest.mark.parametrize(("kind", "version"), [("zv", "current"), ("mzv", "2024"), ("zvd", "current"), ("ei", "2024")])
def test_klippers_own_shapers_at_strong_damping(kind, version):
    """They were said to be none of Klipper's from a damping ratio of 0.6 on."""
    text = js.export(klipper_shaper(kind, 37.3, 0.8, version), "klipper", firmware=version)
    settings = dict(re.findall(r"^(\w+): (.*)$", text, re.M))
    assert settings["shaper_type_x"] == kind
    assert float(settings["shaper_freq_x"]) == pytest.approx(37.3, rel=1e-7)
    assert float(settings["damping_ratio_x"]) == pytest.approx(0.8, abs=1e-7)
