from dataclasses import replace

import numpy as np
import pytest

from seatrial.campaign.data.import_logs import Trials
from seatrial.core.errors import InputError
from seatrial.core.record import Channel, make_record
from tests.cases import CHANNELS, PROVENANCE

TIME = np.array([0.0, 0.1, 0.2, 0.35, 0.4])


def columns(**changed):
    return {"n": np.full(5, 80.0), "u": np.sin(TIME) + 1.5, "udot": np.cos(TIME), **changed}


def record_of(time=TIME, channels=CHANNELS, **changed):
    return make_record(time, columns(**changed), channels, PROVENANCE, "run 7")


def at(index, value, channel="u"):
    changed = columns()[channel].copy()
    changed[index] = value
    return {channel: changed}


def test_columns_in_order_of_role():
    record = record_of(channels=CHANNELS[::-1])
    assert record.controls == ("n",)
    assert record.measured == ("udot", "u")
    assert np.array_equal(record.measurement, np.column_stack([columns()["udot"], columns()["u"]]))
    assert np.array_equal(record.channel("u"), columns()["u"])
    assert np.array_equal(record.channel("n"), record.control[:, 0])
    assert np.allclose(record.step, [0.1, 0.1, 0.15, 0.05, 0.05], atol=1e-15)


def test_a_record_is_printed_in_one_line():
    assert (
        repr(record_of()) == 'Record "run 7": 5 samples over 0.4 s; controls n [rad/s]; measured u [m/s], udot [m/s^2]'
    )
    doubted = replace(record_of(), provenance=replace(PROVENANCE, options={"cautions": ["a hole", "a clock"]}))
    assert repr(doubted).endswith("; 2 cautions: read record.cautions")
    assert doubted.cautions == ("a hole", "a clock")


def test_a_record_may_have_no_control():
    assert record_of(channels=CHANNELS[1:]).control.shape == (5, 0)


def test_gaps_in_measurements_are_kept():
    record = record_of(**at([1, 3], np.nan))
    assert np.array_equal(np.isnan(record.channel("u")), [False, True, False, True, False])


@pytest.mark.parametrize(
    ("time", "message"),
    [
        ([0.0, 0.1, 0.1, 0.2, 0.3], r"row 3\n.*same time stamp as the row before \(.*; 1 such rows"),
        ([0.0, 0.1, 0.05, 0.2, 0.15], r"row 3\n.*time running backwards \(.*; 2 such rows"),
        ([0.0, 0.1, np.nan, 0.3, 0.4], r"row 3\n.*time nan"),
        ([0.0, 0.1, 0.2, np.inf, 0.4], r"row 4\n.*time inf"),
    ],
)
def test_time_must_increase(time, message):
    with pytest.raises(InputError, match=message):
        record_of(time=np.array(time))


@pytest.mark.parametrize("size", [0, 1, 2])
def test_too_few_samples(size):
    short = {name: column[:size] for name, column in columns().items()}
    with pytest.raises(InputError, match=f"{size} samples"):
        record_of(time=TIME[:size], **short)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"u": np.full(5, np.nan)}, 'channel "u"\n.*no finite value'),
        ({"n": np.full(5, np.nan)}, 'channel "n"\n.*no finite value'),
        ({"u": np.full(5, 1.5)}, "1.5.* in every sample"),
        ({"u": np.array([np.nan, 1.5, np.nan, 1.5, 1.5])}, "1.5.* in every sample"),
        ({"u": 1e-155 * np.arange(5)}, r"values of at most 4\.0e-155 m/s"),
        ({"udot": 1e12 * np.arange(5)}, r"values of at most 4\.0e\+12 m/s\^2"),
        (at(2, np.nan, "n"), r'channel "n", sample 3\n.*a gap at t = 0\.2 s'),
        ({"u": np.ones(4)}, r"shape \(4,\)"),
        ({"u": np.ones((5, 2))}, r"shape \(5, 2\)"),
    ],
)
def test_unusable_channel(changed, message):
    with pytest.raises(InputError, match=message) as caught:
        record_of(**changed)
    assert caught.value.where.startswith("trial.csv, record 'run 7'")


def test_a_constant_control_is_no_fault():
    assert np.ptp(record_of().control) == 0


@pytest.mark.parametrize(
    "channels",
    [
        (*CHANNELS, Channel("v", "m/s", "measurement")),
        (*CHANNELS, CHANNELS[1]),
        (*CHANNELS[:2], Channel("udot", "m/s^2", "output")),
    ],
    ids=["without a column", "named twice", "of no role"],
)
def test_unusable_channel_map(channels):
    with pytest.raises(InputError):
        record_of(channels=channels)


@pytest.mark.parametrize(
    ("channel", "message"),
    [
        (
            Channel("n", "rpm", "control"),
            r'"n", unit\n.*"rpm"\n.*"rad/s".*\n.*multiply the column by 0\.1047198, and write "rad/s"',
        ),
        (Channel("u", "cm/s", "measurement"), r"multiply the column by 0\.01, "),
        (Channel("u", "furlong", "measurement"), r'unknown unit "furlong"'),
        (Channel("u", "rad", "measurement"), r'a unit like "m/s"'),
        (Channel("tau_X", "kN", "control"), r'multiply the column by 1000, and write "N"'),
        (Channel("u", "", "measurement"), r'unit\n.*\n.*\n.*write "m/s"'),
        (Channel("u", None, "measurement"), r"unit\n.*None"),
        (Channel("u", "m/s", "ctrl"), r"role 'ctrl'"),
        (Channel("", "m/s", "measurement"), r"the name ''"),
        (Channel(3, "m/s", "measurement"), "the name 3"),
        (Channel("uu", "m/s", "measurement"), r'the name \'uu\'\n.*\n.*did you mean "u"'),
    ],
)
def test_a_channel_is_a_signal_in_its_unit_of_si(channel, message):
    column = {str(channel.name): np.sin(TIME)}
    with pytest.raises(InputError, match=message) as caught:
        make_record(TIME, column, (channel,), PROVENANCE, "run 7")
    assert caught.value.where.startswith("trial.csv, record 'run 7', channel")


@pytest.mark.parametrize(
    ("name", "unit"),
    [("tau_X", "N"), ("tau_X", "kg m/s^2"), ("tau_N", "N m"), ("psi_set", "rad"), ("q_w", "1"), ("n_act", "rad/s")],
)
def test_a_unit_of_si_may_be_written_in_any_way(name, unit):
    column = {name: np.sin(TIME)}
    assert make_record(TIME, column, (Channel(name, unit, "control"),), PROVENANCE).controls == (name,)


def test_a_record_has_a_channel():
    with pytest.raises(InputError, match=r"channels\n.*none\n.*one channel at least"):
        make_record(TIME, {}, (), PROVENANCE)


def test_infinite_and_complex_values_are_refused():
    with pytest.raises(InputError, match=r'"u", sample 3\n.*inf at t = 0\.2 s\n.*NaN without a measurement'):
        record_of(**at(2, -np.inf))
    with pytest.raises(InputError, match='channel "u"'):
        record_of(u=np.sin(TIME) + 1j)


def test_unknown_channel():
    with pytest.raises(InputError, match='no channel "v"') as caught:
        record_of().channel("v")
    assert "n, u, udot" in caught.value.expected


def test_records_of_a_campaign_are_printed_a_line_each():
    trials = Trials((record_of(), record_of()), (record_of(),), "")
    lines = repr(trials).splitlines()
    assert [line.partition(": ")[0] for line in lines] == ["fitted", "fitted", "only predicted"]
    assert lines[0].endswith(repr(record_of()))
    assert trials._repr_html_().count("\n") == 2
    assert repr(Trials((), (), "")) == "no records"
