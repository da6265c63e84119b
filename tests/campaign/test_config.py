"""The campaign file: what is wrong with it is said with key, found, expected and remedy, before any work is done."""

import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.templates import TEMPLATES, init_campaign
from seatrial.core.errors import InputError
from tests.campaign.small import write_small

MISTAKES = {
    "unknown key": (("seed = 3", "seed = 3\nsede = 4"), 'unknown key "sede"', 'did you mean "seed"?'),
    "unknown key in a named table": (('noise = "0.05 m/s"', 'noize = "0.05 m/s"'), "sensors.u.", "noise"),
    "a control that never moves": (
        ('upper = "1500 rpm"', 'upper = "1500 rpm"\nrate = "0 rpm/s"'),
        "limits.n.rate",
        "above 0",
    ),
    "too few importance draws": (("repeats = 2", "repeats = 2\ndraws = 10"), "selection.draws", "1024"),
    "unknown nested key": (("points = 3", "point = 3"), "design.amplitude.", "points"),
    "unknown unit": (('"100 rpm"', '"100 rpn"'), 'unknown unit "rpn"', 'did you mean "rpm"?'),
    "unit of another dimension": (('upper = "1500 rpm"', 'upper = "1500 m"'), "limits.n.upper", "rad/s"),
    "number without unit": (('duration = "30 s"', "duration = 30"), "design.duration", 'write "30 s"'),
    "limit without unit": (('upper = "1500 rpm"', 'upper = "1500"'), "limits.n.upper", 'write "1500 rpm"'),
    "noise without unit": (('noise = "0.05 m/s"', "noise = 0.05"), "sensors.u.noise", 'write "0.05 m/s"'),
    "noise of another unit": (('noise = "0.05 m/s"', 'noise = "0.05 s"'), "sensors.u.noise", "one of: m/s, kn"),
    "rate of another unit": (
        ('noise = "0.05 m/s"', 'noise = "1 kn"\nrate = "5 m"'),
        "sensors.u.rate",
        "one of: Hz, 1/s",
    ),
    "unit that computes": (('upper = "1500 rpm"', 'upper = "1 rpm**9**9**9"'), "limits.n.upper", "cannot be read"),
    "missing table": (("[sensors.u]", "[sensor.u]"), "sensor", "sensors"),
    "malformed term": (('"X_u"]', '"X_uu_"]'), "character", "X_uu_"),
    "repeated term": (('"X_u"]', '"X_absuu"]'), "same regressor", "X_uabsu"),
    "term of another axis": (
        ('"X_u"]', '"Y_v"]'),
        "key structure",
        "Y_v, which has no part in the motion: the model has no sway",
    ),
    "term without a prior": (('"X_u"]', '"X_uu"]'), "prior.X_uu", "add [prior.X_uu]"),
    "prior nothing uses": (("[prior.X_u]", "[prior.X_w]"), "prior.X_", "prior"),
    "unknown vehicle": (('"remus100_surge"', '"remus10_surge"'), "no such vehicle", 'did you mean "remus100_surge"?'),
    "unknown channel": (("[sensors.u]", "[sensors.w]"), 'channel "w"', "udot"),
    "unknown control": (('control = "n"', 'control = "n_1"'), "design.control", "n"),
    "a range of one point": (('to = "200 rpm", points = 3', 'to = "200 rpm", points = 1'), "design.amplitude"),
    "no quiet tail": (('active = "20 s"', 'active = "40 s"'), "design.active", "lengthen"),
    "unknown code of a finding": (
        ("seed = 3", 'seed = 3\n[checks]\naccept = ["step-too-long"]'),
        "step-too-long",
        'did you mean "steps-too-long"?',
    ),
    "truth of an unknown term": (("X_u = -1.21", "X_w = -1.21"), "truth.X_w", "did you mean"),
    "truth of a term put out": (
        ("X_u = -1.21", "X_uu = -1.21"),
        "[truth] has X_uu, and no structure has it",
        "remove X_uu from [truth], or list it",
    ),
    "no noise": (('noise = "0.05 m/s"', 'noise = "0 m/s"'), "sensors.u.noise", "more than 0"),
    "chains thinned away": (("draws = 1000", "draws = 100\nthin = 10"), "estimation.thin", "10 of 100 draws"),
    "chains that are no multiple": (("warmup = 500", "warmup = 530"), "estimation.warmup", "multiple of 100"),
    "both truth and import": (
        ("[truth]", '[import]\nfit = ["1"]\n[[import.files]]\npath = "log"\nchannels = {}\n[truth]'),
        "both [truth] and [import]",
        "remove one of the two",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_with_its_remedy(tmp_path, name):
    replacement, *words = MISTAKES[name]
    with pytest.raises(InputError) as raised:
        load_campaign(write_small(tmp_path, replacement))
    text = str(raised.value)
    assert "campaign.toml" in text
    assert "remedy" in text
    for word in words:
        assert word in text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["campaign.toml"]


@pytest.mark.parametrize("template", TEMPLATES)
def test_templates_are_valid_and_never_overwrite(tmp_path, template):
    init_campaign(tmp_path / "new", template)
    load_campaign(tmp_path / "new")
    with pytest.raises(InputError, match="a campaign already"):
        init_campaign(tmp_path / "new", template)
