"""Quantities with units: factors from their definitions; what measures something else is refused."""

import math

import pytest

from jshape._described import printed
from jshape.problems.units import has_unit, quantity, question, reprinted


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("6.5 m", "m", 6.5),
        ("250mm", "m", 0.25),
        ("4 t", "kg", 4000),
        ("115 g", "kg", 0.115),
        ("40 deg", "rad", 40 * math.pi / 180),
        ("180°", "rad", math.pi),
        ("3 Hz", "rad/s", 6 * math.pi),
        ("30 rpm", "rad/s", math.pi),
        ("0.3 m/s^2", "m/s²", 0.3),
        ("5000 mm/s²", "m/s²", 5),
        ("60 ft/min", "m/s", 0.3048),
        ("1.2 kN/m", "N/m", 1200),
        ("2 kg m^2/s^2", "J", 2),
        ("5 N m/(rad s)", "N m/(rad s)", 5),
        ("1 J/m", "N", 1),
        ("10 ms", "s", 0.01),
        ("2 %", "", 0.02),
        ("-3 cm", "m", -0.03),
        ("7", "", 7),
        ("4 lb", None, 4 * 0.45359237),
        ("3 N (s/m)^p", "N (s/m)^p", None),
        (8, "m", 8),
    ],
)
def test_quantities(text, unit, value):
    if value is None:
        with pytest.raises(ValueError, match=r"must be a number"):
            quantity(text, unit)
    else:
        assert quantity(text, unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "unit", "words"),
    [
        ("heavy", "kg", "must be a number, or a quantity such as '6.5 kg', not 'heavy'"),
        ("1,5 m", "m", "not '1,5 m'"),
        ("", "m", "not ''"),
        ("1e999 m", "m", "not '1e999 m'"),
        ("1" * 100, "m", "must be a number"),
        ("3 parsec", "m", "unknown unit 'parsec'"),
        ("7", "m", "must be a number, or a text with a unit such as '6.5 m', not '7'"),
        ("3 kg", "m", "must be in m or a multiple of it, not '3 kg'"),
        ("3 Hz", "1/s", "must be in 1/s or a multiple of it, not '3 Hz'"),
        ("3 m", "", "must be a number without a unit, not '3 m'"),
        ("3 N/m", "N/m^p", "must be a number, in N/m^p"),
    ],
)
def test_what_is_refused(text, unit, words):
    with pytest.raises(ValueError) as caught:
        quantity(text, unit)
    assert words in str(caught.value)


def test_a_share_is_no_unit():
    assert has_unit("1 t")
    assert not any(map(has_unit, ("80 %", "0.8", 0.8)))


@pytest.mark.parametrize(
    ("words", "unit"),
    [
        ("from trolley to hook, m.", "m"),
        ("of the trolley, kg; it matters where a force drives", "kg"),
        ("integral gain, N m/(rad s).", "N m/(rad s)"),
        ("force at 1 m/s, N (s/m)^p.", "N (s/m)^p"),
        ("mass of the base, kg (it only matters for the force).", "kg"),
        ("damping ratios; a single number counts for every mode.", None),
        ("m1, kg.", "kg"),
    ],
)
def test_units_in_descriptions(words, unit):
    assert printed(words) == unit
    assert "furlong" not in reprinted(words, "furlong") if unit is None else printed(reprinted(words, "J")) == "J"


def test_sizes_are_questioned():
    assert "6500 m" in str(question(6500.0, "m"))
    assert "30 rad" in str(question(30.0, "rad"))
    assert question(6.5, "m") is question(0.0, "m") is question(1e9, "N/m") is None
