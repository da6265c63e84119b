"""Structures that the data do not separate, as one mixture of draws, and where they predict a run differently."""

from types import SimpleNamespace

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.inference.structure_average import StructureAverage, average_of
from seatrial.messages.render import sentence
from seatrial.selection.contenders import disagreements
from seatrial.selection.structures import Structure
from tests.campaign.small import write_small


def drawn(label, **columns):
    """Draws of one structure."""
    table = np.column_stack(list(columns.values()))

    def draws(names=None):
        return table if names is None else table[:, [list(columns).index(name) for name in names]]

    return SimpleNamespace(structure=Structure(label, tuple(columns)), names=tuple(columns), draws=draws, key=label)


def test_draws_are_those_of_the_mixture():
    """Moments as the law of total variance has them; a term that one lacks is 0 there."""
    random = np.random.default_rng(1)
    quadratic = drawn("M-1", X_uabsu=random.normal(-3.0, 0.2, 4000), T_nabsn=random.normal(6.0, 0.1, 4000))
    linear = drawn("M-2", X_u=random.normal(-2.0, 0.3, 4000), T_nabsn=random.normal(7.0, 0.1, 4000))
    average = StructureAverage((quadratic, linear), (0.7, 0.3))
    table = dict(zip(average.names, average.draws().T, strict=True))
    assert {name: column.size for name, column in table.items()} == dict.fromkeys(average.names, 4000)
    assert np.mean(table["X_u"] == 0.0) == pytest.approx(0.7)
    assert table["T_nabsn"].mean() == pytest.approx(6.3, abs=0.01)
    assert table["T_nabsn"].var() == pytest.approx(0.01 + 0.7 * 0.3, rel=0.02)
    np.testing.assert_array_equal(average.draws(["X_u"])[:, 0], table["X_u"])


def test_only_structures_near_the_best_are_averaged(tmp_path):
    campaign = load_campaign(write_small(tmp_path))
    estimates = [drawn(one.label, **{name: np.ones(3) for name in one.terms}) for one in campaign.structures]
    selection = SimpleNamespace(structures=campaign.structures, chosen=1, probability=np.array([0.03, 0.97]))
    assert average_of(campaign, estimates, selection) is estimates[1]
    selection.probability = np.array([0.2, 0.7])
    average = average_of(campaign, estimates, selection)
    assert isinstance(average, StructureAverage)
    assert average.labels == {"M-1": pytest.approx(7 / 9), "M-0": pytest.approx(2 / 9)}
    assert set(average.structure.terms) == {"X_u", "X_uabsu", "T_nabsn"}


def test_a_difference_beyond_the_stated_deviation_is_a_caution():
    """Two that are 0.2 apart, of equal weight, lie 0.1 about their mean; only the second channel states less."""
    time = np.linspace(0.0, 1.0, 11)
    means = [np.column_stack([time, time]), np.column_stack([time + 0.2, time + 0.2])]
    sd = np.column_stack([np.full(11, 0.15), np.full(11, 0.05)])
    (one,) = disagreements({"M-0": 0.5, "M-1": 0.5}, means, sd, ("v", "u"), run="circle", held_back=True)
    assert (one.subject, one.values["spread"], one.values["stated"]) == (
        ("u",),
        pytest.approx(0.1),
        pytest.approx(0.05),
    )
    assert sentence(one) == (
        "held-back run circle: M-0 and M-1, which the data do not separate, predict u differently: the standard deviation between them "
        "is 0.1 m/s, that of M-0 is 0.05 m/s. Fit a run like it, which separates the structures"
    )
