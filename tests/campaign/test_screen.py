from dataclasses import replace
from math import comb

import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.schema import SelectionTable
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.selection.screening import can_be_screened, screen_terms, shortlist_of, with_shortlist
from seatrial.core.errors import InputError
from seatrial.messages.structures import screening_lines
from seatrial.selection.screened import Screened
from seatrial.vehicles.catalogue import load_surge
from seatrial.vehicles.simulate import simulate
from seatrial.vehicles.whole import whole_vehicle
from tests.campaign.small import LOGGED, write_small
from tests.campaigns import import_log

EXTRA = {"X_0": 3.0, "X_u3": 1.0, "T_n": 0.05, "T_un": 0.05, "T_uun": 0.05, "T_unn": 0.001}
"""Further terms, and half the width of their priors."""
PRIORS = "".join(
    f'[prior.{name}]\ndistribution = "uniform"\nlower = {-half}\nupper = {half}\n\n' for name, half in EXTRA.items()
)
IMPORT = import_log("1", "log.csv", u=("u", "m/s"), n=("n", "rad/s"))
NAMES = ", ".join(f'"{name}"' for name in ("X_u", *EXTRA))


def write_log(folder):
    """Thirty seconds of doublets, simulated with the catalogue's coefficients."""
    time = np.arange(0.0, 30.0, 0.1)
    entry = load_surge("remus100_surge")
    model = whole_vehicle(entry.hull, list(entry.coefficients), moves=("u",))
    control = entry.hull.trim["n"] + 20.0 * np.where(time % 10 < 5, 1.0, -1.0) + 30.0 * np.sin(0.3 * time**1.3)
    start = jnp.array([entry.hull.trim["u"]])
    states = simulate(model, entry.coefficients, jnp.asarray(control[:, None]), jnp.full(time.size, 0.1), start)
    speed = np.asarray(states)[:, 0] + 0.05 * np.random.default_rng(1).normal(size=time.size)
    np.savetxt(
        folder / "log.csv",
        np.column_stack([time, speed, control]),
        delimiter=",",
        header="t,u,n",
        comments="",
        fmt="%.9g",
    )


def many(folder, rules=(), g=None):
    lines = ", ".join(f'"{rule}"' for rule in rules)
    folder.mkdir(exist_ok=True)
    write_log(folder)
    return load_campaign(
        write_small(
            folder,
            (LOGGED[0], IMPORT),
            ('optional = ["X_u"]', f"optional = [{NAMES}]\nrules = [{lines}]\nshortlist = 4{g or ''}"),
            ("[sensors.u]", PRIORS + "[sensors.u]"),
        )
    )


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return many(tmp_path_factory.mktemp("many"))


@pytest.fixture(scope="module")
def trials(campaign):
    return get_trials(campaign)


def test_a_large_campaign_gets_a_shortlist(campaign, trials):
    assert campaign.is_large
    assert set(campaign.full.terms) == {"X_uabsu", "T_nabsn", "X_u", *EXTRA}
    chosen = with_shortlist(campaign, trials)
    assert [one.label for one in chosen.structures] == ["M-0", "M-1", "M-2", "M-3"]
    sizes = [len(one.terms) for one in chosen.structures]
    assert sizes == sorted(sizes, reverse=True)
    assert all({"X_uabsu", "T_nabsn"} <= set(one.terms) for one in chosen.structures)
    screened, shortlist = screen_terms(campaign, trials), shortlist_of(chosen, trials)
    assert sum(shortlist.probability) == pytest.approx(screened.data["probability"].values[:4].sum())
    best = chosen.structures[int(np.argmax(shortlist.probability))]
    assert set(best.terms) == set(screened.terms(0))
    with pytest.raises(InputError, match="128 structures"):
        _ = campaign.structures


def test_a_screening_is_kept_and_read_again(campaign, trials):
    first, again = screen_terms(campaign, trials), screen_terms(campaign, trials)
    assert first.data.attrs["count"] == 128
    assert set(first.optional) == {"X_u", *EXTRA}
    np.testing.assert_array_equal(first.data["inclusion"], again.data["inclusion"])
    assert first.data["probability"].values.sum() <= 1.0 + 1e-9
    said = "\n".join(screening_lines(first))
    assert "screening of 128 structures in closed form" in said
    assert said.endswith("output-error or filter-error likelihood")


def test_a_g_prior_by_file_is_the_closed_form(tmp_path, campaign, trials):
    """Worth one row, it is what stands beside the stated priors anyway; with a g, the mean shrinks by 1 / (1 + 1 / g)."""
    beside = screen_terms(campaign, trials).data["inclusion_by_unit_information"]
    rows = many(tmp_path / "rows", g='\ng = "rows"')
    found = screen_terms(rows, get_trials(rows))
    np.testing.assert_allclose(found.data["inclusion"], beside, rtol=1e-9)
    assert "in closed form, under a g-prior, g = rows (" in screening_lines(found)[0]
    few = many(tmp_path / "few", g="\ng = 20")
    other = screen_terms(few, get_trials(few)).data
    assert np.abs(other["inclusion"] - beside).max() > 0.05
    with pytest.raises(InputError, match=r"(?s)structure.g.*greater than 0"):
        many(tmp_path / "none", g="\ng = 0")


def test_a_screening_has_the_prior_of_the_campaign(tmp_path):
    """Of seven terms in question one is always there by a rule: it counts."""
    rules = ["always T_n"]
    alike = many(tmp_path / "equal", rules)
    sparse = replace(alike, selection=SelectionTable(structure_prior="multiplicity"))
    trials = get_trials(alike)
    found, equal = (screen_terms(one, trials).data for one in (sparse, alike))
    optional = {"X_u", *EXTRA}
    for data, weight in ((equal, lambda j: 1.0), (found, lambda j: 1 / comb(7, j))):
        sizes = [len(optional.intersection(Screened(data).terms(rank))) for rank in range(data.sizes["model"])]
        weights = np.exp(data["log_evidence"].values) * [weight(j) for j in sizes]
        assert data["probability"].values / data["probability"].values[0] == pytest.approx(weights / weights[0])
    assert found.attrs["count"] == equal.attrs["count"] == 64


def test_mistakes_in_names_are_told_where_they_are(tmp_path):
    with pytest.raises(InputError, match=r"(?s)key truth.X_u.*remove X_u from \[truth\], or the rule that excludes it"):
        load_campaign(
            write_small(tmp_path / "never", ('optional = ["X_u"]', 'optional = ["X_u"]\nrules = ["never X_u"]'))
        )
    with pytest.raises(InputError, match=r"prior.X_u\b[^?]*is \[prior.X_uu\] meant"):
        load_campaign(write_small(tmp_path / "name", ("[prior.X_u]", "[prior.X_uu]")))


def test_rules_shrink_it_until_all_can_be_simulated(tmp_path):
    ruled = many(tmp_path, ["never T_unn", "never T_uun", "T_un requires T_n"])
    assert not ruled.is_large
    assert len(ruled.structures) == 24
    assert not any({"T_unn", "T_uun"} & set(one.terms) for one in ruled.structures)


def test_rules_that_contradict_each_other_name_both_and_the_file(tmp_path):
    with pytest.raises(InputError, match=r"campaign.toml:\d+, key structure") as refused:
        many(tmp_path, ["never X_uabsu"])
    assert "never X_uabsu" in str(refused.value)
    assert "always X_uabsu" in str(refused.value)


def test_campaign_without_optional_terms_is_not_screened(tmp_path):
    alone = load_campaign(
        write_small(
            tmp_path / "alone",
            ('always = ["X_uabsu", "T_nabsn"]\noptional = ["X_u"]', 'always = ["X_uabsu", "T_nabsn", "X_u"]'),
        )
    )
    assert not can_be_screened(alone)
    assert with_shortlist(alone, get_trials(alone)) is alone
