"""Several controls at once in a campaign: designed, written, simulated and read back; limits of each; what cannot be is told by its key."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.templates import template_text
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.design.sweep import design_first
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import InputError
from seatrial.manoeuvres.family import design_words
from seatrial.manoeuvres.schedule import read_rows
from tests.campaigns import write_campaign

RPM, DEG = np.pi / 30, np.pi / 180
TRUTH = "\n[truth]\nY_uv = -28.6\nY_uudelta_r = 9.64\nN_uv = -24.0\nN_ur = -2.0\nN_uudelta_r = -6.15\n"
LIMITS = '[limits.n]\nlower = "1000 rpm"\nupper = "1400 rpm"\n\n[limits.u]'
SMALL = (
    ('families = ["repeated-doublet", "multistep-3211", "doublet"]', 'families = ["repeated-doublet", "multisine"]'),
    ('utility = "fisher-d"\n', ""),
    ("points = 5 }", "points = 2 }"),
    ('period = { from = "4 s", to = "32 s", points = 8 }', 'period = { from = "6 s", to = "24 s", points = 2 }'),
    ('control = "delta_r"', 'control = "delta_r"\ntogether = { n = "150 rpm" }'),
    ("[limits.u]", LIMITS),
)


def campaign(folder, *changes):
    write_campaign(folder, template_text("steering") + TRUTH, *SMALL, *changes)
    return load_campaign(folder)


@pytest.mark.proof
def test_both_controls_are_designed_written_and_run(tmp_path):
    made = campaign(tmp_path)
    found = design_first(made)
    assert "and ±" in found.lines()[0]
    assert "rpm in n" in found.lines()[0]
    store = Store(made.folder)
    rows = read_rows(store.schedule(store.design), ["delta_r", "n"])
    schedule = rows.schedule(made.family.sample_time)
    best = found.best.best_controls()
    for place, name in enumerate(made.model(made.full).controls):
        np.testing.assert_allclose(schedule.controls[name][: len(best)], best[:, place], rtol=1e-6, atol=1e-6)
    assert schedule.controls["n"].max() <= 1400 * RPM + 1e-6
    amplitude = float(found.best.amplitude[found.best.best[0]])
    assert np.ptp(schedule.controls["n"]) == pytest.approx(2 * 150 * RPM * amplitude / (11.2 * DEG), rel=1e-2)
    (record,) = get_trials(made).fit
    np.testing.assert_allclose(record.channel("n"), best[:, made.model(made.full).controls.index("n")], rtol=1e-9)
    assert np.ptp(record.channel("delta_r")) > 0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            '{ n = "150 rpm" }',
            '{ delta_s = "5 deg" }',
            r"design.together.delta_s[^$]*another control of the vehicle: n",
        ),
        ('{ n = "150 rpm" }', '{ delta_r = "5 deg" }', r"design.together.delta_r[^$]*which is driven"),
        ('{ n = "150 rpm" }', '{ n = "150 deg" }', "design.together.n"),
        ('{ n = "150 rpm" }', '{ n = "0 rpm" }', r"design.together.n[^$]*more than 0"),
    ],
)
def test_what_cannot_move_together_is_told_by_its_key(tmp_path, old, new, said):
    with pytest.raises(InputError, match=said):
        campaign(tmp_path, (old, new))


def test_a_period_of_its_own_is_read_and_told(tmp_path):
    made = campaign(tmp_path, ('{ n = "150 rpm" }', '{ n = { amplitude = "150 rpm", period = 2.0 } }'))
    assert made.family.beside[0].period == 2.0
    assert "rpm in n, 2 times as slowly" in design_words(made.families[0], 5 * DEG, 8.0)


def test_another_control_beyond_its_limits_leaves_no_design(tmp_path):
    made = campaign(tmp_path, ('"150 rpm"', '"1500 rpm"'))
    with pytest.raises(InputError, match=r"lower their amplitudes under `together` of \[design\]"):
        design_first(made)
