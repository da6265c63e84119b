"""The picker of terms: what is offered to a vehicle, its equation and its drawing, and the prior that it gets."""

import re
import tomllib
import xml.etree.ElementTree as xml

import pytest

from seatrial.core.coefficients import AXES, CoefficientName
from seatrial.dashboard.model_queries import edited, offered_terms
from seatrial.dashboard.terms import kinds_of, term_html, usual_terms, words_of
from tests.campaign.small import SMALL, write_small

ALL = [name for axis in AXES for name in kinds_of(axis)]


@pytest.mark.parametrize("name", ALL)
def test_a_term_is_drawn_with_its_unit_and_every_signal_in_words(name):
    html, term = str(term_html(name)), CoefficientName.parse(name)
    svg = xml.fromstring(html[html.index("<svg") : html.index("</svg>") + 6])
    assert svg.attrib["role"] == "img"
    assert next(one.text for one in svg.iter("text")) == term.axis  # the force is always seen
    assert words_of(name)
    assert f"Unit of {name}" in html
    assert all(f"{signal} is the " in html for signal in term.signals)
    ends = [float(number) for one in svg.iter("path") for number in re.findall(r"-?\d+\.\d", one.attrib["d"])]
    assert max(map(abs, ends)) <= 110


@pytest.mark.parametrize(
    ("name", "view", "turn"), [("N_r", "above", 1), ("M_q", "starboard", -1), ("K_p", "astern", 1)]
)
def test_a_positive_turn_is_drawn_in_its_sense(name, view, turn):
    """Bow to starboard, bow up, starboard side down: with the clock from above and from astern, against it from starboard."""
    html = str(term_html(name))
    assert f"Seen from {view}" in html
    points = re.search(r'class="force" d="M([^"]+)"', html)[1].split("L")
    assert turn * (float(points[-1].split(",")[1]) - float(points[0].split(",")[1])) > 0


def test_a_vehicle_is_offered_the_terms_of_what_it_has(tmp_path):
    assert {"X_u", "X_uabsu", "T_nabsn"} <= {*usual_terms("u", ("n",))}
    assert not {"Y_uv", "N_uudelta_r", "X_tau_X", "T_f"} & {*usual_terms("u", ("n",))}
    assert {"Y_uudelta_r", "N_ur", "T_f", "X_vr"} <= {*usual_terms("uvr", ("f_1", "delta_r"))}
    offered = {one.name: one.prior for one in offered_terms(str(write_small(tmp_path)))}
    assert "Published value -2.93" in offered["X_uabsu"]
    assert "a range" in offered["X_u3"]
    (tmp_path / "campaign.toml").write_text("[campaign]")
    assert offered_terms(str(tmp_path)) == ()


@pytest.mark.parametrize("share", ["", 'published_prior_sd = "30 %"\n'])
def test_a_published_term_gets_its_prior_about_the_published_value(tmp_path, share):
    text = SMALL.replace("[structure]", f"{share}[structure]").replace('"X_uabsu", "T_nabsn"', '"T_nabsn"')
    text = re.sub(r"\[(prior\.X_uabsu|truth)\][^[]*", "", text)
    text, _ = edited(str(tmp_path), text, (("structure.always", "T_nabsn, X_uabsu, X_u3"),))
    priors = tomllib.loads(text)["prior"]
    about = {"distribution": "normal", "mean": -2.93, "sd": 1.76, "dissipative": True}
    assert priors.get("X_uabsu") == (None if share else about)
    assert priors["X_u3"] == {"distribution": "uniform", "lower": -1.0, "upper": 0.0}
