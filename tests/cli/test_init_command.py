"""Beginning a campaign by a template, a vehicle or answers: the file loads and has the answers; an answer that cannot be is asked again."""

import difflib

import pytest
from typer.testing import CliRunner

from seatrial.campaign.config.load import check_text, load_campaign
from seatrial.campaign.config.shape_campaign import shape_of_text
from seatrial.campaign.config.templates import template_text
from seatrial.campaign.data.no_record import truth_example
from seatrial.cli.commands import init as asked
from seatrial.cli.main import app
from seatrial.cli.questions import answered, questions
from seatrial.cli.running import Exit
from seatrial.core.errors import InputError
from tests.cli.test_cli import run


def typed(folder, changes):
    """Answer all questions of the template `design`, of which some have several answers, one after the other."""
    lines, text = ["own"], template_text("design")
    for key in [one.key for one in questions(text)]:
        lines += changes.get(key, [""])
    return CliRunner().invoke(app, ["init", str(folder)], input="\n".join(lines) + "\n")


def test_answers_are_in_the_file_and_comments_stay(tmp_path):
    text = template_text("design")
    new = answered(text, {"vehicle.mass": "45 kg", "vehicle.trim.u": "2 kn", "goal.trials": "3", "sensors.u.rate": ""})
    changed = [line for line in difflib.ndiff(text.splitlines(), new.splitlines()) if line[0] in "+-"]
    assert changed == [
        '- mass = "30 kg"',
        '+ mass = "45 kg"',
        '- trim = { u = "1.5 m/s", n = "1200 rpm" }',
        '+ trim = { u = "2 kn", n = "1200 rpm" }',
        '- rate = "5 Hz"',
        "- trials = 4",
        "+ trials = 3",
    ]
    assert check_text(tmp_path, new).hull.mass == 45.0
    assert answered(text, {one.key: one.value for one in questions(text)}) == text


@pytest.mark.parametrize(
    ("key", "answer", "words"),
    [
        ("vehicle.mass", "45 pounds", "unknown unit"),
        ("vehicle.mass", "45", "without a unit"),
        ("vehicle.mass", "heavy", "a quantity such as"),
        ("vehicle.thrust_deduction", "much", "a valid number"),
    ],
)
def test_an_answer_of_another_kind_is_refused(key, answer, words):
    with pytest.raises(InputError, match=words):
        answered(template_text("design"), {key: answer})


def test_each_term_has_a_prior_to_ask_for():
    text = answered(template_text("design"), {"structure.optional": "X_uu, X_udu"})
    keys = {one.key for one in questions(text)}
    assert {"prior.X_uu.lower", "prior.X_udu.upper"} <= keys
    assert not any(key.startswith("prior.X_u.") for key in keys)


def test_in_a_terminal_it_asks_and_asks_again(monkeypatch, tmp_path):
    monkeypatch.setattr(asked, "_is_terminal", lambda: True)
    said = typed(
        tmp_path / "boat",
        {"campaign.name": ["otter"], "vehicle.mass": ["45 pounds", "45 kg"], "goal.sd.X_uabsu": ["5 %"]},
    )
    assert said.exit_code == 0, said.output
    assert 'unknown unit "pounds"' in said.output
    made = load_campaign(tmp_path / "boat")
    assert (made.name, made.hull.mass, made.goal.shares) == ("otter", 45.0, {"X_uabsu": 0.05})


def test_what_the_whole_file_refuses_is_asked_again(monkeypatch, tmp_path):
    monkeypatch.setattr(asked, "_is_terminal", lambda: True)
    said = typed(tmp_path / "boat", {"limits.n.lower": ["1700 rpm"], "estimation.force_error": ["", "700 rpm"]})
    assert said.exit_code == 0, said.output
    assert "lower below upper" in said.output
    assert load_campaign(tmp_path / "boat").limits.upper > load_campaign(tmp_path / "boat").limits.lower


@pytest.mark.parametrize("first", ["steering", "remus100_hall_anstee\n"])
def test_in_a_terminal_a_template_or_a_vehicle_is_one_answer(monkeypatch, tmp_path, first):
    monkeypatch.setattr(asked, "_is_terminal", lambda: True)
    said = CliRunner().invoke(app, ["init", str(tmp_path / "boat")], input=f"{first}\n")
    assert said.exit_code == 0, said.output
    assert load_campaign(tmp_path / "boat").full.terms


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--template", "design", "--vehicle", "remus100_prestero"], "--vehicle or --log too"),
        (["--log", "dive.csv", "--template", "log"], "--vehicle or --log too"),
        (["--vehicle", "remus100_fossen"], "no sum of named coefficients"),
    ],
)
def test_options_that_cannot_be_together_are_refused(monkeypatch, capsys, tmp_path, options, words):
    code, _, err = run(monkeypatch, capsys, "init", tmp_path / "boat", *options)
    assert code == Exit.BAD_INPUT
    assert words in err
    assert not (tmp_path / "boat").exists()


@pytest.mark.parametrize(
    ("words", "terms"),
    [
        ("box, length 457 mm, beam 338 mm, height 254 mm, mass 11.5 kg", {"X_udot", "Y_vabsv", "N_r"}),
        ("torpedo, length 1.6 m, diameter 0.19 m, nose 0.2 m, tail 0.4 m, mass 31 kg", {"X_uabsu", "N_rdot"}),
    ],
)
def test_a_campaign_of_a_shape_is_valid(tmp_path, monkeypatch, capsys, words, terms):
    folder = tmp_path / "new"
    code, out, _ = run(monkeypatch, capsys, "init", folder, "--shape", words)
    assert code == Exit.OK
    assert "I_zz" in out
    assert run(monkeypatch, capsys, "check", folder)[0] == Exit.OK
    campaign = load_campaign(folder)
    assert terms <= {*campaign.priors}
    found = shape_of_text(words)
    assert campaign.priors["X_uabsu"].median == pytest.approx(found.priors["X_uabsu"].median, rel=5e-3)
    assert campaign.hull.inertia == pytest.approx(found.shape.inertia, rel=5e-3)
    assert f"X_u = {campaign.priors['X_u'].median:.4g}\n" in truth_example(campaign)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("torpedo, length 1.6 m, diameter 0.19 m, mass 3.1 kg", "80.43 kg/m^3"),
        ("torpedo, length 1.6, diameter 0.19 m, mass 31 kg", "without a unit"),
        ("torpedo, length 1.6 m, diameter 0.19 m", "no mass"),
        ("torpedo, width 1.6 m", "beam"),
        ("torpedo, mass 3 kg, mass 4 kg", "two values"),
        ("sphere, mass 3 kg", "ellipsoid"),
    ],
)
def test_a_shape_that_cannot_be_is_refused(tmp_path, monkeypatch, capsys, words, told):
    code, _, err = run(monkeypatch, capsys, "init", tmp_path / "new", "--shape", words)
    assert code == Exit.BAD_INPUT
    assert told in err
    assert not (tmp_path / "new").exists()


def test_a_shape_stands_alone(tmp_path, monkeypatch, capsys):
    code, _, err = run(monkeypatch, capsys, "init", tmp_path / "new", "--shape", "box", "--template", "log")
    assert code == Exit.BAD_INPUT
    assert "a shape alone" in err
