from math import inf, nan

import pytest

from seatrial.report.numbers import (
    Digits,
    percent,
    plain,
    probability,
    rounded,
    short,
    unit_html,
    unit_text,
    with_percent_signs_kept,
    with_sd,
)


@pytest.mark.parametrize(
    ("value", "sd", "expected"),
    [
        (-3.01557, 0.08101, ("−3.016", "0.081", 0)),
        (6.36475e-4, 8.4025e-6, ("6.365", "0.084", -4)),
        (0.0009, 0.0251, ("0.001", "0.025", 0)),
        (2.4, 10.6, ("2", "11", 0)),
        (1.0, 0.0996, ("1.00", "0.10", 0)),
        (-0.0004, 0.02, ("0.000", "0.020", 0)),
        (123456.0, 789.0, ("1.2346", "0.0079", 5)),
        (0.5, 0.0, ("0.5000", "–", 0)),
        (0.0, nan, ("0.000", "–", 0)),
        (nan, 1.0, ("–", "–", 0)),
    ],
)
def test_a_value_is_rounded_to_its_standard_deviation(value, sd, expected):
    assert rounded(value, sd) == expected


def test_a_power_of_ten_multiplies_value_and_deviation():
    assert with_sd(6.36475e-4, 8.4025e-6) == "(6.365 ± 0.084) × 10⁻⁴"
    assert with_sd(-3.01557, 0.08101) == "−3.016 ± 0.081"


def test_an_interval_has_the_decimals_of_its_value():
    assert Digits.of(6.36475e-4, 8.4025e-6).pair(6.201e-4, 1.2e-5) == "6.201 ± 0.120"
    assert Digits.of(-3.01557, 0.08101).bare(-3.1743) == "−3.174"
    assert Digits.of(1.0, 0.1).bare(inf) == "–"


def test_numbers_are_short():
    assert [short(x) for x in (0.0, 1.0, -0.02128, 2.1e-5, 12345.6, nan, 9.999)] == [
        "0.00",
        "1.00",
        "−0.0213",
        "2.10 × 10⁻⁵",
        "12346",
        "–",
        "10.0",
    ]
    assert [plain(x) for x in (-8.8, 0.0, 2e-4, 20.0)] == ["−8.8", "0", "2 × 10⁻⁴", "20"]
    assert percent(-0.126) == "−13 %"
    assert with_percent_signs_kept("<p>the 90 % band, 5 %d</p>") == "<p>the 90\u202f% band, 5\u202f%d</p>"
    assert [percent(x) for x in (0.0031, 0.099, -1.26, 0.0, float("nan"))] == ["0.31 %", "9.9 %", "−126 %", "0 %", "–"]


def test_probabilities_never_claim_certainty_that_was_rounded():
    assert [probability(p) for p in (0.7, 1e-20, 0.9999, 1.0, nan)] == ["0.70", "< 0.01", "> 0.99", "1", "–"]
    assert probability(0.1234, 0.001) == "0.123"


def test_units_have_raised_powers_and_are_escaped():
    assert unit_html("kg m/rad^2") == "kg\u202fm/rad<sup>2</sup>"
    assert unit_html("1") == "–"
    assert "<" not in unit_html("<")[:1]
    assert unit_text("kg m/rad^2") == "kg m/rad²"


def test_a_true_value_has_digits_of_its_own():
    digits = Digits.of(5.0, 14.0)
    assert (digits.bare(0.1), digits.exact(0.1)) == ("0", "0.1")
    assert digits.exact(-0.60912) == "−0.6091"
    assert Digits.of(6.3e-4, 3.4e-5).exact(6.279e-4) == "6.279"
