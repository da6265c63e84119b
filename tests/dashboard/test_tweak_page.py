"""The page on which values are moved: its words, and in a browser by keyboard, as a screen reader is told, until a start is written."""

import asyncio
import re
import subprocess
import sys

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.dashboard.pages.tweak import (
    TweakPage,
    answer_rows,
    below_words,
    improbable_words,
    movable_html,
    off_words,
)
from seatrial.dashboard.view_models import Movable, Tweaked
from tests.campaign.small import NO_X_U, write_small
from tests.dashboard.served import served

pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")

DRAG = Movable("X_u", "X_u", "kg/s", 1.0, -1.2, 0.1, -1.7, -0.7, -1.0)
THRUST = Movable("T_nabsn", "T_{n|n|}", "kg m/rad^2", 1.0, 6.64e-4, 2e-5, 5e-4, 7e-4, 6.64e-4)
MASS = Movable("mass", "m", "kg", 1.0, 30.0, 0.0, 21.0, 39.0, 33.0)


def answer(**changes):
    channels = (("u", "m/s", 0.9, 0.95), ("r", "deg/s", np.nan, np.nan))
    plain = Tweaked(("M",), ("1",), (DRAG, MASS), {}, (0.0, 9.0), channels, (3.2, -0.001), 2.0, 0.0455)
    return plain._replace(**changes)


def test_a_row_has_a_slider_and_a_field_of_one_name_with_labels():
    html = movable_html(THRUST)
    assert 'type="range" name="T_nabsn" aria-label="T_nabsn, slider"' in html
    assert 'type="number" name="T_nabsn" aria-label="T_nabsn [kg m/rad^2]"' in html
    assert "best 6.64 ± 0.20 10⁻⁴" in html
    assert "stated 30 kg, taken as exact" in movable_html(MASS)
    assert "<script" not in movable_html(DRAG._replace(name='"><script>'))


def test_a_slider_shows_the_digits_that_its_step_changes():
    narrow = DRAG._replace(best=-1234.56789, value=-1234.56789, lower=-1234.57289, upper=-1234.56289)
    html = movable_html(narrow)
    assert 'min="-1234.57289" max="-1234.56289" step="5e-05" value="-1234.56789"' in html
    assert THRUST.shown(33127786329.0123456789) == pytest.approx(33127786329.0123457)


def test_what_is_improbable_is_said_in_plain_words():
    assert improbable_words(answer(), {}) == "nothing is moved"
    words = improbable_words(answer(), {"X_u": -1.0})
    assert words == "improbable: 2.0 standard deviations from the best values; 4.5 % of the posterior is farther"
    assert improbable_words(answer(probability=0.3), {"X_u": -1.0}).startswith("plausible")
    assert "less than one millionth" in improbable_words(answer(probability=1e-9), {"X_u": -1.0})
    assert "more than 1000 standard deviations from" in improbable_words(answer(distance=3.3e10), {"X_u": 3e9})
    assert off_words(DRAG._replace(value=3e9)) == "more than 1000 standard deviations above"
    assert (off_words(DRAG), off_words(MASS)) == ("2.0 standard deviations above", "+10 %")
    assert "taken as exact" in improbable_words(answer(), {"mass": 33.0})
    stated = answer(numbers=(MASS._replace(sd=1.5),))
    assert improbable_words(stated, {"mass": 33.0}) == "2.0 standard deviations from the stated mass"
    found = {one: below_words(one) for one in (3.21, -3.21, 1e-4, np.inf)}
    assert [*found.values()] == [
        "3.21 nats below the best",
        "3.21 nats above the best",
        "the same as the best",
        "the motion diverges",
    ]
    rows = answer_rows(answer(), {})
    assert rows[0] == ["variance of u explained", "90.00 %, by the best values 95.00 %"]
    assert rows[1] == ["variance of r explained", "–, by the best values –"]


def test_nothing_is_asked_of_a_field_that_is_empty_or_of_a_mass_of_zero(tmp_path):
    page = TweakPage(None, "boat", tmp_path, ())
    for name, value in (("X_u", float("nan")), ("mass", 0.0), ("mass", -1.0)):
        with pytest.raises(InputError, match=rf"^{name}\n(.|\n)*type one"):
            asyncio.run(page.ask(None, {"T_nabsn": 1.0, name: value}))


@pytest.mark.proof
def test_sliders_move_by_keyboard_and_a_start_is_written_only_when_asked(tmp_path, page):
    folder = write_small(tmp_path / "served" / "boat", *NO_X_U, ("points = 4", "points = 3"))
    command = [sys.executable, "-m", "seatrial", "estimate", str(folder), "--by", "mode", "--quiet"]
    assert subprocess.run(command, capture_output=True).returncode in (0, 3)
    before = (folder / "campaign.toml").read_text()
    with served(tmp_path / "served") as (address, _):
        page.goto(f"{address}tweak?campaign=boat")
        slider, field = page.get_by_label("X_uabsu, slider"), page.get_by_label("X_uabsu [kg/m]")
        thrust = page.get_by_label("T_nabsn, slider")
        slider.focus()
        first, thrust_first = float(field.input_value()), thrust.input_value()
        for _ in range(8):
            page.keyboard.press("ArrowRight")
        page.wait_for_function("([one, first]) => Number(one.value) > first", arg=[field.element_handle(), first])
        page.get_by_text(re.compile(r"moved, 0\.[34] standard deviations above")).wait_for()
        assert slider.get_attribute("aria-valuetext") == f"{float(field.input_value()):.12g} kg/m"
        page.locator("[role=status]", has_text="of the posterior is farther").wait_for(state="attached")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        assert thrust.input_value() == thrust_first
        page.get_by_role("checkbox", name="The others follow").click()
        page.get_by_text("follows,").first.wait_for()
        assert float(thrust.input_value()) < float(thrust_first)  # less drag, less thrust
        page.get_by_label("X_uabsu back to the best value").click()
        page.get_by_text("nothing is moved").first.wait_for()
        assert float(field.input_value()) == pytest.approx(first, rel=1e-4)
        field.fill("")
        field.press("Enter")
        page.get_by_role("alert").filter(has_text="no number that it can have").wait_for()
        page.get_by_text("log likelihood of this record").first.wait_for(state="detached")
        field.fill("-3.5")
        field.press("Enter")
        page.get_by_text("moved,").first.wait_for()
        page.get_by_role("button", name="Show the lines").click()
        page.locator("pre", has_text="[estimation.start_values]").wait_for()
        assert (folder / "campaign.toml").read_text() == before
        page.get_by_role("button", name="Write them into campaign.toml").click()
        page.get_by_text("Saved in campaign.toml").wait_for()
        assert "X_uabsu = -3.5\n" in (folder / "campaign.toml").read_text()
    assert page.said == []
