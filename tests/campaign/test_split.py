"""A long log in pieces, whose commands are pulse widths: each piece starts where the vehicle was."""

import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import import_trials
from seatrial.campaign.inference.quick_estimates import posterior_modes
from tests.campaign.test_check import write


@pytest.mark.proof
def test_pieces_are_fitted_jointly(tmp_path):
    write(tmp_path / "a", "1.0")
    path = tmp_path / "a" / "campaign.toml"
    text = path.read_text().replace('fit = ["one"]', 'fit = ["one"]\nsplit = "10 s"')
    path.write_text(text.replace('unit = "N" }', 'unit = "N", curve = "pwm.csv" }'))
    (tmp_path / "a" / "pwm.csv").write_text("pwm,thrust\n-10,-10\n10,10\n")
    campaign = load_campaign(tmp_path / "a")
    trials = import_trials(campaign)
    assert [record.label for record in trials.fit] == ["one.1", "one.2", "one.3", "one.4"]
    assert [record.time.size for record in trials.fit] == [100, 100, 100, 100]
    (answer,) = posterior_modes(campaign, trials)
    values = {name: pairs[0] for name, _, pairs in answer.rows}
    for name, true in (("X_tau_X", 1.0), ("X_uabsu", -6.0)):
        value, sd = values[name]
        assert abs(value - true) < 4 * sd
    (tmp_path / "a" / "pwm.csv").write_text("pwm,thrust\n-10,-20\n10,20\n")
    again = import_trials(campaign)
    assert (again.fit[0].channel("tau_X") == 2 * trials.fit[0].channel("tau_X")).all()
    assert again.key != trials.key
