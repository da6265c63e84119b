"""Remedies followed to the letter: the edit that a message names is made, and the command or reader that gave it is asked again."""

import re
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.check import check_records
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference import modes
from seatrial.campaign.inference.model_error import left_out, remedies_of
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.core.errors import InputError
from seatrial.core.findings import Finding
from seatrial.estimation.diagnostics.error_budget import EXACT
from seatrial.estimation.diagnostics.error_sources import Effect, lay_out
from seatrial.estimation.diagnostics.prior_checks import _remedy
from seatrial.estimation.posterior.posterior import Parameter
from seatrial.estimation.priors import LogUniform
from seatrial.messages.render import remedy
from tests.campaign.small import SMALL
from tests.campaign.test_check import CAMPAIGN, MUTE, feedback, speed, write
from tests.campaign.yaw_campaign import write_yaw

ROOT = Path(__file__).parents[2]
NOISE_PRIORS = '\n[prior.sigma_u]\ndistribution = "log-uniform"\nlower = 0.001\nupper = 0.2\n'
TAU_PRIOR = '\n[prior.tau_u]\ndistribution = "log-uniform"\nlower = 0.05\nupper = 10.0\n'


def sections(remedy):
    """Return the tables that a remedy names, with the keys that it gives for example."""
    named = re.findall(r"\[([a-z]+\.\w[\w.]*)\](?:, in s,[^[]*?)?,? (?:for example )?with ([^;\[]*)", remedy)
    keys = [(name, re.findall(r'(\w+) = ("[^"]*"|[-\d.e]+\b)', given)) for name, given in named]
    return "".join(f"\n[{name}]\n" + "".join(f"{key} = {value}\n" for key, value in of) for name, of in keys if of)


def without(text, names):
    """Return a campaign file without some of its tables of priors, or lines of the table of all of them."""
    for name in names:
        text, count = re.subn(rf"\n\[prior\.{name}\]\n(?:[^\[\n].*\n?)*|\n{name} = \{{.*(?=\n)", "\n", text)
        assert count == 1, name
    return text


def load(folder, text):
    """Return the error of a campaign file, None if it can be used."""
    folder.mkdir(exist_ok=True)
    (folder / "campaign.toml").write_text(text)
    try:
        load_campaign(folder)
    except InputError as error:
        return error
    return None


BY_HAND = SMALL.replace('catalogue = "remus100_surge"', 'mass = "30.5 kg"\ntrim = { u = "1.5 m/s", n = "1200 rpm" }')
LAG = '\n[vehicle.actuators.n]\nlag = "0.3 s"\n'
UNKNOWN = BY_HAND.replace('"30.5 kg"', '"unknown"')
WRONG = {
    "drifting for coloured": (
        (ROOT / "examples" / "ship_yaw" / "campaign.toml").read_text().replace('"coloured"', '"drifting"'),
        [
            (
                r"remove \[prior.tau_v\] and \[prior.tau_r\], of coloured residuals: those of v are drifting",
                lambda text, said: without(text, re.findall(r"\[prior\.(\w+)\]", said)),
            ),
        ],
    ),
    "white for heavy": (
        SMALL + NOISE_PRIORS + '\n[prior.dof_u]\ndistribution = "uniform"\nlower = 2.0\nupper = 30.0\n',
        [
            (
                r"remove \[prior.dof_u\], of heavy residuals: those of u are white",
                lambda text, _: without(text, ["dof_u"]),
            )
        ],
    ),
    "a lag of surge by hand": (
        BY_HAND + LAG,
        [
            (
                r'add moves = \["u"\], or remove actuators',
                lambda text, _: text.replace("[vehicle]\n", '[vehicle]\nmoves = ["u"]\n'),
            )
        ],
    ),
    "a lag of surge of the catalogue": (SMALL + LAG, [("^remove actuators$", lambda text, _: text.replace(LAG, ""))]),
    "a lag of an unknown mass": (UNKNOWN + LAG, [("^remove actuators$", lambda text, _: text.replace(LAG, ""))]),
    "a bias without a prior": (
        SMALL.replace("[sensors.u]\n", '[sensors.u]\nbias = "own"\n'),
        [(r"add a section \[prior.bias_u\]", lambda text, said: text + sections(said))],
    ),
    "no mass beside moves": (
        BY_HAND.replace('mass = "30.5 kg"', 'moves = ["u"]'),
        [('write mass = "unknown"', lambda text, _: text.replace("[vehicle]\n", '[vehicle]\nmass = "unknown"\n'))],
    ),
    "axes that an unknown mass does not have": (
        UNKNOWN.replace("[vehicle]\n", '[vehicle]\nmoves = ["u", "r"]\n'),
        [(r'write moves = \["u"\]', lambda text, _: text.replace('["u", "r"]', '["u"]'))],
    ),
    "an added mass beside an unknown mass, which would scale every coefficient": (
        UNKNOWN.replace("[vehicle]\n", "[vehicle]\nfixed = { X_udot = -1.0 }\n"),
        [("remove X_udot from `fixed`", lambda text, _: text.replace("fixed = { X_udot = -1.0 }\n", ""))],
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_followed_remedy_makes_a_refused_file_usable(tmp_path, name):
    text, steps = WRONG[name]
    for told, edit in steps:
        error = load(tmp_path, text)
        assert error is not None
        assert re.search(told, error.remedy), error
        text = edit(text, error.remedy)
    assert load(tmp_path, text) is None


def test_the_remedy_of_correlated_residuals(tmp_path):
    said = remedy(Finding("residuals-correlated", "caution", ("u",), {}, ("drifting-noise",)))
    text = SMALL.replace("[estimation]\n", '[estimation]\nresiduals = "drifting"\n') + NOISE_PRIORS + TAU_PRIOR
    assert "remove [prior.tau_u]" in said
    text = without(text, ["tau_u"])
    assert 'estimation.residuals = "drifting"' in said
    assert load(tmp_path, text) is None


@pytest.mark.parametrize(("at", "is_fault"), [(0, False), (1, True)])
def test_no_fault_of_a_record_is_blamed_for_a_noise_that_is_small(tmp_path, monkeypatch, at, is_fault):
    """Followed, the remedy leaves room below the value that the data ask for."""
    prior = LogUniform(1e-5, 0.2)
    code = _remedy(Parameter("sigma_r", "rad/s", "s", prior), prior.bounds[at], 29.0)
    values = {"value": prior.bounds[at], "unit": "rad/s", "beyond": 0.3, "gain": 29.0, "channel": "r"}
    finding = Finding("prior-excludes-data", "alarm", ("sigma_r",), values, (code,))
    monkeypatch.setattr(modes, "prior_excluding_data", lambda posterior, mode: finding)
    monkeypatch.setattr(modes, "likely_causes", lambda campaign, records: ["a step that blurs"])
    with pytest.raises(InputError) as caught:
        modes.check_prior_of(SimpleNamespace(campaign=SimpleNamespace(where_of_prior=str), records=()), None, None)
    assert ("a step that blurs" in caught.value.remedy) == is_fault
    assert is_fault or remedy(finding).startswith("lower the lower bound of [prior.sigma_r] to 1e-06 rad/s")


def test_axes_of_an_unknown_mass_are_those_that_move(tmp_path):
    """`moves` states what the terms say anyway."""
    folder = write_yaw(tmp_path / "yaw")
    without_moves = load_campaign(folder)
    text = (folder / "campaign.toml").read_text()
    assert load(folder, text.replace("[vehicle]\n", '[vehicle]\nmoves = ["r", "v"]\n')) is None
    stated = load_campaign(folder)
    assert stated.model(stated.full) == without_moves.model(without_moves.full)


def edited(text, kind, of, said):
    """Return a campaign file in which a remedy of a missing effect is followed."""
    prior = '\n[prior.{}]\ndistribution = "normal"\nmean = 0.0\nsd = 1.0\n'
    if kind in ("force", "thrust loss"):
        name = of if kind == "force" else re.findall(r"(\w+) for a force", said)[0]
        assert "structure.optional, with a prior" in said
        optional = tomllib.loads(text)["structure"].get("optional", [])
        text = re.sub(r"\noptional = .*", "", text)
        return text.replace("[structure]\n", f"[structure]\noptional = {[*optional, name]}\n") + prior.format(name)
    if kind == "clock":
        assert 'set between = "line" for their channels' in said
        return re.sub(r'(quantity = "control"[^}}]*) }}', r'\1, between = "line" }', text)
    if kind == "smooth force":
        assert "to structure.optional" in said
        return text
    if kind == "backlash":
        assert said.startswith("use the measured speed or angle")
        return text
    if kind == "command offset":
        assert "`offset` of its channel" in said
        return re.sub(rf"({of} = {{[^}}]*) }}", r"\1, offset = 0.5 }", text)
    if kind == "sensor offset":
        assert f'set sensors.{of}.bias = "own"' in said
        return text.replace(f"[sensors.{of}]\n", f'[sensors.{of}]\nbias = "own"\n') + prior.format(f"bias_{of}")
    if kind == "start":
        assert said == 'set estimation.initial = "estimated"'
        return text.replace('initial = "measured"', 'initial = "estimated"')
    lag = f"if [vehicle] has `moves`, add [vehicle.actuators.{of}]"
    assert said.startswith((lag, "give `delay` a prior, [prior.delay]") if kind == "command lag" else "give `delay`")
    return text + sections(said.replace("its lag, for example ", ""))


def looked_for(posterior):
    at = lay_out(posterior, np.zeros(posterior.dim), EXACT)
    assert at is not None
    return [one.effect for one in at.sources]


def with_moves(folder):
    write(folder, "1.0", CAMPAIGN.replace('mass = "30 kg"', 'mass = "30 kg"\nmoves = ["u"]'))


@pytest.mark.parametrize("make", [lambda folder: write(folder), with_moves, write_yaw], ids=["surge", "moves", "yaw"])
def test_every_effect_that_a_model_may_lack(tmp_path, make):
    """Each remedy gives a campaign that can be used, in which the effect is no longer looked for or its log is read otherwise."""
    make(tmp_path / "a")
    text = (tmp_path / "a" / "campaign.toml").read_text()
    campaign = load_campaign(tmp_path / "a")
    records = get_trials(campaign).fit
    posterior = build_posterior(campaign, campaign.full, records)
    named = {one.text for one in posterior.likelihood.model.coefficients}
    found = [one for one in looked_for(posterior) if one.of not in named]
    assert {one.kind for one in found} > {"force", "command offset", "command lag", "sensor offset", "start"}
    for one in found:
        names = remedies_of(posterior, [one])
        ways = [
            remedy(Finding("effect-missing", "caution", (), {"effects": ((one.kind, one.of),)}, (name,)))
            for name in names
        ]
        for said in ways if "moves" in text else ways[-1:]:
            assert load(tmp_path / "a", edited(text, one.kind, one.of, said)) is None, said
            again = load_campaign(tmp_path / "a")
            wider = build_posterior(again, again.full, records)
            has = {term.text for term in wider.likelihood.model.coefficients}
            if one.kind == "force":
                assert one.of in has
            elif one.kind in ("command lag", "delay", "sensor offset", "start", "thrust loss"):
                assert one not in looked_for(wider) or again.has_delay, said


def rows(reverse=1.0, early=0.0, late=0, spikes=False):
    """Times, commands and speeds of the vehicle of `CAMPAIGN`."""
    force = np.where(np.arange(400) < 150, 10.0, np.where(np.arange(400) < 300, -10.0, 0.0))
    shown = np.concatenate([np.zeros(late), speed()])[:400] + 0.02 * np.random.default_rng(3).normal(size=400)
    shown[10::60] += 0.8 * spikes
    return [(0.1 * k, force[k], reverse * shown[k]) for k in range(400)]


R = 'r = { column = "speed", unit = "rad/s" }\n'
TURNS = CAMPAIGN.replace(
    'mass = "30 kg"', 'mass = "30 kg"\ninertia = ["1 kg m^2", "1 kg m^2", "1 kg m^2"]\nmoves = ["u", "r"]'
).replace("\n[estimation]", f"{R}\n[estimation]")
CONSTANT = CAMPAIGN.replace('"X_uabsu"]', '"X_uabsu", "X_0"]') + (
    '[prior.X_0]\ndistribution = "normal"\nmean = 0.0\nsd = 0.001\n'
)
CHECKED = {
    "a reversed sign": (
        CAMPAIGN,
        rows(reverse=-1.0),
        "direction-reversed",
        "set scale = -1 for u",
        lambda text: text.replace("scale = SCALE", "scale = -1.0"),
    ),
    "a unit": (
        CAMPAIGN.replace('"m/s", scale', '"cm/s", scale'),
        rows(),
        "size-unlike",
        "centimetres taken for metres",
        lambda text: text.replace('"cm/s", scale', '"m/s", scale'),
    ),
    "outliers": (
        CAMPAIGN,
        rows(spikes=True),
        "outliers",
        'residuals = "heavy" under [sensors.u]',
        lambda text: text.replace("[sensors.u]\n", '[sensors.u]\nresiduals = "heavy"\n'),
    ),
    "a channel without a sensor": (
        TURNS,
        rows(),
        "channel-unused",
        "add [sensors.r] with its noise, or take r out of the channel map",
        lambda text: text.replace(R, ""),
    ),
    "a late response": (
        CAMPAIGN,
        rows(late=12),
        "clock-shift",
        'give the delay a prior, [prior.delay] with distribution = "uniform", lower = 0.0 and upper = 2.',
        lambda text: text + '[prior.delay]\ndistribution = "uniform"\nlower = 0.0\nupper = 2.4\n',
    ),
    "long steps": (
        CAMPAIGN.replace("30 kg", "0.5 kg"),
        rows(),
        "steps-too-coarse",
        'step = "0.025 s" under [import]',
        lambda text: text.replace("[import]\n", '[import]\nstep = "0.025 s"\n'),
    ),
    "a term that nothing excites": (
        CONSTANT,
        rows(),
        "not-excited",
        "fix it",
        lambda text: without(text.replace(', "X_0"]', "]"), ["X_0"]).replace(
            'mass = "30 kg"', 'mass = "30 kg"\nfixed = { X_0 = 0.0 }'
        ),
    ),
    "priors of no sign": (
        MUTE,
        rows(),
        "direction-not-judged",
        "use priors of known sign, such as half-normal",
        lambda text: text.replace(
            'distribution = "normal"\nmean = 0.0\nsd = 3.0', 'distribution = "half-normal"\nlower = 0.0\nscale = 2.0'
        ).replace(
            'distribution = "normal"\nmean = 0.0\nsd = 20.0', 'distribution = "half-normal"\nupper = 0.0\nscale = 9.0'
        ),
    ),
    "a limit": (
        CAMPAIGN + '\n[limits.tau_X]\nlower = "-9 N"\nupper = "12 N"\n',
        rows(),
        "limits-exceeded",
        "correct the limit if the vehicle may go so far",
        lambda text: text.replace('"-9 N"', '"-10 N"'),
    ),
}


def doubts(folder, text, log):
    (folder / "campaign.toml").write_text(text.replace("SCALE", "1.0"))
    (folder / "one.csv").write_text("\n".join(["t,force,speed", *(",".join(map(str, row)) for row in log)]) + "\n")
    campaign = load_campaign(folder)
    (judged,) = check_records(campaign, get_trials(campaign))
    found = [one for one in judged.findings if one.level != "pass" and one.remedies]
    return [
        *((one.code, one.level, remedy(one)) for one in found),
        *(("record", "caution", text) for text in judged.cautions),
    ]


@pytest.mark.parametrize("name", CHECKED)
def test_followed_remedy_removes_the_finding_of_check(tmp_path, name):
    """It is there, its remedy is the one that is followed, and it is gone, without another in its place."""
    text, log, check, told, edit = CHECKED[name]
    before = doubts(tmp_path, text, log)
    ((level, do),) = [(level, do) for one, level, do in before if one == check]
    assert told in do
    after = doubts(tmp_path, edit(text), log)
    assert (check, level) not in {one[:2] for one in after}, after
    assert {one for one, *_ in after} <= {one for one, *_ in before}, after


def test_a_sensor_that_is_added_uses_its_channel(tmp_path):
    after = doubts(tmp_path, TURNS + '[sensors.r]\nnoise = "0.02 rad/s"\n', rows())
    assert "channel-unused" not in [one for one, *_ in after]


def test_a_control_that_changes_at_each_sample_is_measured_or_a_command(tmp_path):
    log = [(time, 5.0 + 3.0 * np.sin(0.7 * float(time)), speed) for time, _, speed in feedback(0)]
    (told,) = [do for one, _, do in doubts(tmp_path, CAMPAIGN, log) if one == "record"]
    for way in ("line", "held"):
        assert f'between = "{way}"' in told
        text = CAMPAIGN.replace('unit = "N" }', f'unit = "N", between = "{way}" }}')
        assert "record" not in [one for one, *_ in doubts(tmp_path, text, log)]


@pytest.mark.proof
def test_a_velocity_that_is_given_needs_no_sensor(tmp_path):
    """Neither remedy of an unused channel can be followed for it: it has no sensor, and the model needs its column."""
    folder = write_yaw(tmp_path / "yaw")
    campaign = load_campaign(folder)
    for judged in check_records(campaign, get_trials(campaign)):
        assert [one for one in judged.findings if one.code == "channel-unused"] == []
    text = (folder / "campaign.toml").read_text()
    assert load(folder, text + '[sensors.u]\nnoise = "0.01 m/s"\n') is not None


@pytest.mark.parametrize(("size", "way"), [(0.1, "delay-of-actuators"), (-0.004, "measured-command")])
def test_a_delay_below_zero_is_an_error_of_clocks(size, way):
    """A prior of the delay from 0 on would leave out the value that was found."""
    found = SimpleNamespace(
        effect=Effect("delay", "", "s"), alike=(), shift=np.array([3.0]), log_odds=9.0, size=size, sd=0.001
    )
    posterior = SimpleNamespace(likelihood=SimpleNamespace(model=SimpleNamespace(per_unit_mass=False)))
    budget = SimpleNamespace(names=("X_u",), omitted=(found,))
    (finding,) = left_out(posterior, SimpleNamespace(terms=("X_u",)), budget)
    assert finding.remedies == (way,)
