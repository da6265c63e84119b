"""Every judge is fed results that agree with the paper, then results that do not: its verdict must follow."""

import json
from math import isfinite

import numpy as np
import pytest

from studies.remus100.registry import ENTRIES
from studies.remus100.tests.made_up import BUILD, PRINTED, SD, change, evidence, made_up_study, sweep

OPEN, NO = "not comparable", "contradicted"
SETTLED = ("figure-5", "figure-6", "figure-7", "figure-8")
"""Items whose verdict no data change: a drawing of the model itself, and chains of which the paper prints no number."""


def put(name, index, value):
    def function(x):
        x[index] = value
        return x

    return change(name, function)


def replaced(build):
    return lambda _: build


def criteria(*reduced):
    """Criteria of M-1: DIC, BPIC, p_D, Dbar, WAIC, PSIS-LOO; M-0 has -999, -994, 5, -1004, -999, -999."""
    return {"chain-6-reduced": put("criterion_value", ..., reduced)}


def no_ridges(data):
    return data.assign(gain=(data["gain"].dims, np.sort(data["gain"].values, axis=1)))


FAR = put("mean", 0, -3.0)
APART = put("r_hat", 0, 1.1)
LATE = put("clipped", np.s_[3, 500:], 1)
FEWER_WITH_AMPLITUDE = change("gain", lambda gain: gain[::-1])
CONTRARY = {
    "equations-2": [(NO, {"equations": put("ours", 0, -0.4000001)})],
    "vehicle": [
        (NO, {"vehicle": change("linear", lambda x: x + 0.05)}),
        (NO, {"vehicle": change("surge", lambda x: x + np.linspace(0, 0.05, x.size))}),
    ],
    "table-1": [
        (NO, {"filters": put("final_mean", 0, PRINTED + SD)}),
        (NO, {"filters": change("final_sd", lambda sd: 3 * sd)}),
    ],
    "figure-1": [
        (NO, {"filters": put("sd", ..., SD)}),
        (NO, {"filters": put("u", np.s_[1, 800], 9.0)}),
    ],
    "claim-filters-equal": [(NO, {"filters": put("final_mean", 1, PRINTED + SD)})],
    "claim-ekf-faster": [(NO, {"filters": put("seconds", 0, 0.05)})],
    "claim-ekf-better": [
        (NO, {"filters": put("relative_error", np.s_[0, :, 2], 0.2)}),
        (NO, {"filters": put("relative_error", np.s_[0, :, 14], 0.3)}),
    ],
    "claim-stability": [
        (OPEN, {"filters": put("failures", 1, 0)}),
        (NO, {"filters": put("failures", 2, 1)}),
    ],
    "table-2": [
        (NO, {"filters": put("final_sd", 3, 0.5 * SD)}),
        (NO, {"filters": change("final_mean", lambda x: PRINTED + (x - PRINTED) * [[[1]], [[1]], [[1]], [[2]]])}),
    ],
    "figure-2": [(NO, {"filters": LATE})],
    "claim-clipping": [(NO, {"filters": LATE})],
    "claim-transient": [(NO, {"filters": put("early_udot_error", 3, 0.05)})],
    "claim-only-square-root": [("reproduced", {"filters": put("smallest_sd", 3, 0.0)})],
    "relay": [(NO, {"relay": put("gain", (0, 0), 19.0)})],
    "claim-large-p": [(NO, {"tuning": put(name, 1, 0.5)}) for name in ("error", "travelled", "sd")],
    "claim-large-q": [
        (NO, {"tuning": put("residual", 2, 3.0)}),
        (NO, {"tuning": put("error", 2, 0.5)}),
    ],
    "claim-large-r": [
        (NO, {"tuning": put("error_at_3_s", 3, 0.5)}),
        (NO, {"tuning": put("error", 3, 0.5)}),
    ],
    "claim-noise": [(NO, {"tuning": put("noise", 1, 0.11)})],
    "equations-3": [
        (NO, {"equations": put("ours", 1, 4.00000001)}),
        (NO, {"equations": put("ours", 2, 4.2)}),
    ],
    "figure-3": [
        (NO, {"sweep-short": replaced(sweep(9.0, 0.1))}),
        (NO, {"sweep-short": FEWER_WITH_AMPLITUDE}),
    ],
    "claim-amplitude": [(NO, {"sweep-long": FEWER_WITH_AMPLITUDE})],
    "claim-ten-seconds": [(NO, {"sweep-long": replaced(sweep(15.0, 0.3))})],
    "claim-ridges": [
        (NO, {"sweep-medium": replaced(sweep(9.0, 0.2))}),
        (NO, {f"sweep-{window}": no_ridges for window in ("short", "medium", "long")}),
    ],
    "claim-quiet-time": [(NO, {"sweep-short": replaced(sweep(10.0, 0.4))})],
    "figure-4": [
        (NO, {"chosen-doublet": put("sd", ..., SD)}),
        (NO, {"chosen-doublet": change("sd", lambda sd: sd * np.linspace(1, 0, 6000)[:, None])}),
    ],
    "claim-single-pass": [(NO, {"sweep-medium": put("seconds", ..., 100.0)})],
    "equations-4": [
        (NO, {"equations": put("ours", 3, 2.1)}),
        (NO, criteria(-1000.1, -996, 4, -1004, -1000, -1000)),
        (NO, criteria(-1000, -995.9, 4, -1004, -1000, -1000)),
    ],
    "table-3": [(NO, {"chain-3": FAR}), (NO, {"chain-3": APART})],
    "claim-near-normal": [
        (NO, {"chain-3": FAR}),
        (NO, {"chain-3": change("draws", np.exp)}),
    ],
    "claim-sampler": [
        (NO, {"chain-3-metropolis": put("seconds", ..., 20.0)}),
        (NO, {"chain-3-metropolis": FAR}),
    ],
    "claim-start": [
        (NO, {"starts": put("height", np.s_[1, :5], -1e4)}),
        ("reproduced", {"starts": put("height", 0, -1e4)}),
        (NO, {"starts": put("height", 1, -1e4)}),
    ],
    "listing-1": [(NO, {"listing-5": put("ess", ..., 1.0)})],
    "table-4": [
        (NO, {"listing-4": put("ess", ..., 1.0)}),
        (NO, {"evidence-4": replaced(evidence(0.8))}),
    ],
    "table-5": [
        (NO, {"listing-5": put("ess", ..., 1.0)}),
        (NO, {"evidence-5": replaced(evidence(0.4))}),
    ],
    "odds": [
        (NO, {"odds": put("probability", 0, 0.8)}),
        ("reproduced", {"odds": put("probability", np.s_[:2], [[0.46, 0.465, 0.47], [0.54, 0.55, 0.56]])}),
    ],
    "table-6": [
        (NO, {"chain-6-reduced": put("sd", 1, 0.6)}),
        (NO, {"chain-6-reduced": put("mean", 1, 3.0)}),
        (OPEN, {"chain-6-full": APART}),
    ],
    "claim-extra-term": [
        (NO, {"chain-6-full": put("sd", 3, 0.1)}),
        (NO, {"chain-6-full": put("sd", 3, 100.0)}),
    ],
    "claim-tighter": [(NO, {"chain-6-reduced": put("sd", 0, 0.6)})],
    "claim-criteria-favour": [
        (NO, criteria(-999, -995, 4, -1003, -999, -999)),
        (NO, criteria(-998, -993, 5, -1003, -998, -998)),
    ],
    "claim-criteria-insensitive": [(NO, criteria(-900, -896, 4, -904, -900, -900))],
    "iteration": [(NO, {"iteration": put("full_sd", 2, 5.0)})],
    "readings": [(NO, {"readings": put("probability", np.s_[1, 0], 0.9)})],
}
CASES = [(key, *case) for key, cases in CONTRARY.items() for case in cases]


def judged(key, changes=None, **options):
    return ENTRIES[key].judge(made_up_study(changes, **options))


def check(item, key):
    """What every item owes the reader, whatever its verdict."""
    assert item.key == key
    assert item.because or item.verdict == "reproduced"
    assert all(isfinite(number.found) and number.error >= 0 for number in item.numbers)
    assert item.settings
    assert json.loads(json.dumps(item.as_json(), allow_nan=False))["verdict"] == item.verdict


@pytest.mark.parametrize("key", ENTRIES)
def test_agreeing_results(key):
    """Two items cannot agree: one is an argument, one says that the printed preferences are not in the data."""
    item = judged(key)
    check(item, key)
    assert (item.verdict == NO) == (key in ("claim-only-square-root", "odds"))
    assert item.verdict in ("reproduced", OPEN, NO)


@pytest.mark.parametrize(("key", "verdict", "changes"), CASES)
def test_contrary_results(key, verdict, changes):
    item = judged(key, changes)
    check(item, key)
    assert item.verdict == verdict


def test_every_judge_can_fail():
    assert set(CONTRARY) | set(SETTLED) == set(ENTRIES)
    assert not set(CONTRARY) & set(SETTLED)
    assert {part for entry in ENTRIES.values() for part in entry.parts} == set(BUILD)


def test_printed_numbers_stand_beside_those_found():
    item = judged("table-1")
    found = {number.name: number for number in item.numbers}
    mean = found["EKF X_uabsu, mean over seeds"]
    assert (mean.printed, found["EKF X_u, stated sd"].printed) == (-2.93, 0.37)
    draws = BUILD["filters"]()["final_mean"].values[0, :, 1]
    assert (mean.found, mean.error) == pytest.approx((draws.mean(), draws.std(ddof=1) / np.sqrt(40)))
    rms = found["EKF X_uabsu, rms error"]
    assert (rms.printed, rms.found) == (None, pytest.approx(np.sqrt(np.mean((draws + 2.93) ** 2))))


def test_listing_1_says_how_unsure_it_is():
    """Five of ten seeds certain of either model: share .5, its error sqrt(.25 / 10)."""
    certain = np.repeat([[0.999, 0.001], [0.5, 0.5]], 5, axis=0)
    unstable = {"listing-4": lambda d: put("ess", ..., 1.5)(put("probability", ..., certain)(d))}
    item = judged("listing-1", unstable)
    found = {number.name: number for number in item.numbers}
    share = found["Table IV: share of seeds with P(M-0) below .01 or above .99"]
    assert (item.verdict, share.found, share.error) == (NO, 0.5, pytest.approx(np.sqrt(0.025)))
    assert found["Table IV: share of seeds with P(M-0) above a half"].found == 0.5
    assert found["Table IV: median effective sample size of 2000 draws"].found == 1.5
    assert "1.5 are effective" in item.because


def test_a_tie_of_dic_is_called_one():
    only_bpic = judged("claim-criteria-favour", criteria(-999, -995, 4, -1003, -999, -999))
    assert "only BPIC" in only_bpic.because
    assert "DIC favours M-0" in judged("claim-criteria-favour", criteria(-996, -991, 5, -1001, -999, -999)).because
    assert "tie" in judged("claim-criteria-favour", criteria(-999, -994, 5, -1004, -999, -999)).because


def test_a_relay_that_always_oscillates():
    item = judged("relay", {"relay": put("switches", ..., 9)})
    check(item, "relay")
    assert "reach the reversal" not in item.because
