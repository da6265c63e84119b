"""A vehicle with three thrusters in the plane, whose log is made by plain Newtonian mechanics: what is imported, checked and refused."""

import jax
import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials, read_untrimmed
from seatrial.campaign.data.thruster_check import check_thrusters, thruster_lines
from seatrial.campaign.design.schedule import commands_of, write_schedule
from seatrial.campaign.inference.posterior import build_posterior, initial_state
from seatrial.campaign.live.channels import Channels
from seatrial.campaign.prior.predictive import predict_from_prior
from seatrial.core.errors import InputError
from seatrial.estimation.posterior.first_guess import first_guess
from seatrial.estimation.posterior.record_posterior import make_posterior
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.schedule import read_rows
from seatrial.vehicles.thrusters import ThrustLaw
from tests.campaigns import MEASURED, import_log, joined, normal, priors, sensors, small_design, uniform, write_campaign

PLACES = np.array([[-0.3, 0.2], [-0.3, -0.2], [0.1, 0.0]])
PUSHES = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
MASS, INERTIA, WORN = 20.0, 1.5, 0.7
TRUTH = {"X_u": -12.0, "Y_v": -25.0, "N_r": -2.0}
CAMPAIGN = joined(
    """[campaign]
name = "three thrusters"
seed = 1

[vehicle]
mass = "20 kg"
inertia = ["1.5 kg m^2", "1.5 kg m^2", "1.5 kg m^2"]
moves = ["u", "v", "r"]

[vehicle.thrust_laws.main]
polynomial = [0.0, 0.08]
neutral = 1500
dead_zone = [1480, 1520]
reverse = 0.8

[[vehicle.thrusters]]
place = ["-0.3 m", "0.2 m", "0 m"]
direction = [1, 0, 0]

[[vehicle.thrusters]]
place = ["-0.3 m", "-0.2 m", "0 m"]
direction = [2, 0, 0]

[[vehicle.thrusters]]
place = ["0.1 m", "0 m", "0 m"]
direction = [0, 1, 0]

[structure]
always = ["X_u", "Y_v", "N_r"]
""",
    priors(X_u=uniform(-40.0, 0.0), Y_v=uniform(-60.0, 0.0), N_r=uniform(-8.0, 0.0), gain_f_2=normal(1.0, 0.3)),
    sensors(u="0.005 m/s", v="0.005 m/s", r="0.005 rad/s"),
    MEASURED,
    small_design("f_1", "5 N", "10 N"),
    import_log(
        "log",
        "{run}.csv",
        f_1=("pwm[0]", "command"),
        f_2=("pwm[1]", "command"),
        f_3=("pwm[2]", "command"),
        u=("u", "m/s"),
        v=("v", "m/s"),
        r=("r", "rad/s"),
        psi=("psi", "rad"),
    ),
)


def law(command):
    force = np.where(np.abs(command - 1500.0) <= 20.0, 0.0, 0.08 * (command - 1500.0))
    return np.where(force < 0, 0.8 * force, force)


def rates(nu, force):
    """m (udot - v r) = X, m (vdot + u r) = Y, I rdot = N, each with linear damping."""
    u, v, r = nu
    x, y = force @ PUSHES
    n = np.sum(force * (PLACES[:, 0] * PUSHES[:, 1] - PLACES[:, 1] * PUSHES[:, 0]))
    return np.array(
        [(x + TRUTH["X_u"] * u) / MASS + v * r, (y + TRUTH["Y_v"] * v) / MASS - u * r, (n + TRUTH["N_r"] * r) / INERTIA]
    )


@pytest.fixture(scope="module")
def log():
    rng = np.random.default_rng(2)
    command = np.repeat(rng.integers(1300, 1700, (40, 3)), 10, axis=0).astype(float)
    nu, motion = np.zeros(3), []
    for row in law(command) * [1.0, WORN, 1.0]:
        motion.append(nu)
        for _ in range(50):
            nu = nu + 0.002 * rates(nu + 0.001 * rates(nu, row), row)
    return command, np.array(motion)


def campaign(folder, log, *changes):
    command, motion = log
    write_campaign(folder, CAMPAIGN, *changes, count=1)
    rows = [",".join(f"{x:.8g}" for x in (0.1 * k, *command[k], *motion[k], 0.0)) for k in range(len(command))]
    (folder / "log.csv").write_text("t,pwm[0],pwm[1],pwm[2],u,v,r,psi\n" + "\n".join(rows) + "\n")
    return load_campaign(folder)


def test_commands_become_thrust_and_a_worn_thruster_is_found(tmp_path, log):
    found = campaign(tmp_path, log)
    (record,) = get_trials(found).fit
    for k in range(3):
        np.testing.assert_allclose(record.channel(f"f_{k + 1}"), law(log[0])[:, k], atol=1e-9)
    # A heading that never moves is no fault of a campaign that does not read it.
    assert "psi" not in record.measured
    model = found.model(found.full)
    guess = first_guess(model, [record], [initial_state(found, model, record)], found.priors)
    for name, value in {**TRUTH, "gain_f_2": WORN}.items():
        assert guess[name] == pytest.approx(value, rel=0.03), name


@pytest.mark.proof
def test_a_prior_of_several_axes_that_is_right_expects_the_log(tmp_path, log):
    """Priors a thousandth wide about the truth leave one motion, that of plain mechanics; half the thrust reaches less far."""
    known = campaign(
        tmp_path,
        log,
        ("lower = -40.0\nupper = 0.0", "lower = -12.01\nupper = -11.99"),
        ("lower = -60.0\nupper = 0.0", "lower = -25.01\nupper = -24.99"),
        ("lower = -8.0\nupper = 0.0", "lower = -2.001\nupper = -1.999"),
        ("mean = 1.0\nsd = 0.3", f"mean = {WORN}\nsd = 0.0007"),
    )
    found = predict_from_prior(known)
    assert [one.channel for one in found.channels] == ["u", "v", "r"]
    assert found.settled is None
    for one, exact in zip(found.channels, log[1].T, strict=True):
        np.testing.assert_allclose(one.bands[2], np.interp(found.time, 0.1 * np.arange(len(exact)), exact), atol=0.01)
        assert one.held == 1.0
    reach = {item.name: item.alone for item in predict_from_prior(campaign(tmp_path / "wide", log)).believed}
    assert reach["N_r"].channel == "r"
    assert reach["N_r"].low < reach["N_r"].high  # at 5 % it damps most
    assert all(one is None or one.low <= one.high for one in reach.values())
    assert reach["sigma_u"] is None


def test_check_tells_a_thruster_that_is_turned_round(tmp_path, log):
    turned = ('column = "pwm[2]", unit = "command"', 'column = "pwm[2]", unit = "command", scale = -1.0')
    found = campaign(tmp_path, log, turned)
    levels = {one.subject[0]: one.level for one in check_thrusters(found, get_trials(found).fit[0])}
    assert levels["f_1"] == "pass"
    assert levels["f_3"] == "alarm"
    lines = "\n".join(thruster_lines(found.vehicle, found.channels))
    assert "rank 3 on the 3 axes that move, X Y N" in lines
    assert "each has its mirror image" in lines


def test_check_tells_what_the_thrusters_do_not_span(tmp_path, log):
    found = campaign(tmp_path, log, ("direction = [0, 1, 0]", "direction = [1, 0, 0]"))
    said = [one for one in check_thrusters(found, get_trials(found).fit[0]) if one.code == "axis-not-driven"]
    assert [(one.subject, one.level) for one in said] == [(("Y",), "caution")]
    assert any(
        "rank 2 on the 3 axes" in line and "1 Y" in line for line in thruster_lines(found.vehicle, found.channels)
    )


COMMANDED = {
    "linear, with a dead zone": (ThrustLaw("", (0.0, 0.08), 1500.0, (1480.0, 1520.0), 0.8), None, 1.0),
    "cubic": (ThrustLaw("", (0.0, 0.05, 0.0, 2e-7), 1500.0), None, 0.0),
    "a falling table": (ThrustLaw("t.csv"), ((1100.0, 1480.0, 1530.0, 1900.0), (30.0, 0.0, 0.0, -24.0)), 0.0),
}


@pytest.mark.parametrize("name", COMMANDED)
def test_a_command_makes_the_thrust_that_it_was_found_for(name):
    """The law forwards is the check; below the jump of a dead zone, 1.6 N ahead and 1.28 N astern, there is none."""
    law, points, least = COMMANDED[name]
    for thrust in np.r_[-np.geomspace(20, 2 * least + 0.01, 7), 0.0, np.geomspace(2 * least + 0.01, 20, 7)]:
        command = np.array([law.command(float(thrust), points)])
        table = None if points is None else lambda c, points=points: np.interp(c, *points)
        assert law.thrust(command, table)[0] == pytest.approx(thrust, abs=1e-8)
    if least:
        assert np.isnan([law.command(thrust) for thrust in (-1.2, 1.5)]).all()
    elif points:
        assert law.command(0.0, points) == 1505
        assert np.isnan(law.command(31.0, points))


def test_a_schedule_has_the_commands_of_its_thrusts(tmp_path, log):
    """10 N ahead are 125 us from neutral, 10 N astern 156.25; the column is not read back; a thrust in the jump is told instead."""
    commands, trial = commands_of(campaign(tmp_path, log)), Family("f_1", 0.0, 12.0, 10.0, 0.1, kind="doublet")
    path = write_schedule(tmp_path / "a.csv", trial.manoeuvre(10.0, 4.0), 0.1, commands=commands)
    head, *rows = path.read_text().splitlines()
    assert head == "time_s,f_1_N,f_1_command"
    told = {float(n): float(c) for _, n, c in (row.split(",") for row in rows)}
    assert {n: round(c, 6) for n, c in told.items() if n in (-10.0, 0.0, 10.0)} == {
        0.0: 1500.0,
        10.0: 1625.0,
        -10.0: 1343.75,
    }
    assert set(read_rows(path, ["f_1"]).controls) == {"f_1"}
    path = write_schedule(tmp_path / "b.csv", trial.manoeuvre(1.0, 4.0), 0.1, commands=commands)
    assert path.read_text().startswith("time_s,f_1_N\n")
    assert "# f_1: no command column, because no command makes 1 N by its law of thrust" in path.read_text()
    assert set(read_rows(path, ["f_1"]).controls) == {"f_1"}


LAW = CAMPAIGN[CAMPAIGN.index("[vehicle.thrust_laws") : CAMPAIGN.index("[[vehicle.thr")]
CURVE = ("polynomial = [0.0, 0.08]\nneutral = 1500", 'curve = "thrust.csv"')
GAINS = priors(gain_f=normal(1.0, 0.3), gain_f_1=normal(1.0, 0.3), gain_f_3=normal(1.0, 0.3))
REFUSED = {
    "two in one place": ([('"-0.3 m", "-0.2 m"', '"-0.3 m", "0.2 m"')], ("thruster 2 in the place of thruster 1",)),
    "no direction": ([("direction = [2, 0, 0]", "direction = [0, 0, 0]")], ("thrusters[1].direction",)),
    "no law of that name": ([("direction = [2, 0, 0]", 'direction = [2, 0, 0]\nlaw = "mian"')], ("mian", "main")),
    "thrust where commands are due": ([('pwm[1]", unit = "command"', 'pwm[1]", unit = "N"')], ('"N"', "thrust_laws")),
    "commands without a law": (
        [(LAW, "")],
        ('"command", of a channel without a law',),
    ),
    "a polynomial that turns back": ([("[0.0, 0.08]", "[0.0, 0.08, 0.0005]")], ("turns back", "near 14")),
    "a table that turns back": ([CURVE], ("turns back at 1400", "thrust.csv")),
    "a command beyond the table": ([CURVE], ("1500 to 1600", "thrust.csv")),
    "two kinds of law": ([("neutral = 1500", 'curve = "thrust.csv"')], ("both curve and polynomial",)),
    "a curve of each of the columns of a thruster": (
        [
            (LAW, ""),
            ('column = "pwm[0]", unit = "command"', 'sum = "pwm[0] - pwm[1]", unit = "N", curve = "thrust.csv"'),
        ],
        ("channels.f_1.curve", "a law acts on the sum"),
    ),
    "column and sum": ([('{ column = "u"', '{ column = "u", sum = "u"')], ("both column and sum",)),
    "gains of all and of each": (
        [("[prior.gain_f_2]", f"{GAINS}\n[prior.gain_f_2]")],
        ("prior.gain_f\n", "they multiply"),
    ),
    "a gain without a prior that could be": ([("gain_f_2", "gain_f_9")], ("gain_f_9", "nothing uses")),
}
TABLES = {
    "a table that turns back": "1200,-20\n1300,-25\n1400,-30\n1500,0\n1800,20\n",
    "a command beyond the table": "1500,0\n1600,8\n",
}


@pytest.mark.parametrize("what", REFUSED)
def test_impossible_thruster_is_refused_by_key(tmp_path, log, what):
    changes, parts = REFUSED[what]
    (tmp_path / "thrust.csv").write_text("pwm,thrust\n" + TABLES.get(what, "1000,-40\n2000,40\n"))
    with pytest.raises(InputError) as refused:
        get_trials(campaign(tmp_path, log, *changes))
    for part in parts:
        assert part in str(refused.value)


ARMED = '[[import.keep]]\npath = "log.csv"\nwhen = "pwm[0] > 0"\n\n[[import.files]]'
LAWS = {"polynomial": [("[0.0, 0.08]", "[0.0, 0.08, 0.00005]")], "table": [CURVE]}


@pytest.mark.parametrize("law", LAWS)
def test_pulses_of_0_before_arming_need_no_thrust_if_they_are_cut_away(tmp_path, log, law):
    (tmp_path / "thrust.csv").write_text("pwm,thrust\n1000,-40\n2000,40\n")
    resting = [np.concatenate([np.zeros((10, 3)), one]) for one in log]
    kept = campaign(tmp_path, resting, ("[[import.files]]", ARMED), *LAWS[law])
    (record,) = get_trials(kept).fit
    (alone,) = get_trials(
        campaign(tmp_path / "alone", log, *[(a, b.replace("thrust", "../thrust")) for a, b in LAWS[law]])
    ).fit
    assert record.provenance.options["start"] == pytest.approx(1.0)
    np.testing.assert_allclose(record.control, alone.control, atol=1e-9)
    np.testing.assert_array_equal(record.measurement, alone.measurement)
    assert read_untrimmed(kept, "log").time.size == record.time.size + 10
    with pytest.raises(InputError, match=r"import\.keep"):
        get_trials(campaign(tmp_path, resting, *LAWS[law]))
    dead = campaign(tmp_path, resting, *LAWS[law], ("dead_zone = [1480, 1520]", "dead_zone = [0, 1520]"))
    assert not get_trials(dead).fit[0].control[:10].any()


MOUNTED = joined(
    """[mounts.dvl]
channels = ["u", "v"]
""",
    priors(
        x_dvl=normal(0.0, 0.5),
        yaw_dvl=normal(0.0, 10.0) + '\nunit = "deg"',
        scale_dvl='distribution = "log-normal"\nmedian = 1.0\nfactor = 1.1',
    ),
)


@pytest.mark.proof
def test_library_has_the_same_posterior_of_gain_mount_and_start(tmp_path, log):
    """All three without a campaign: the same parameters, priors and first guess, and the same density bit for bit."""
    estimated = ('initial = "measured"', 'initial = "estimated"')
    found = campaign(tmp_path, log, ("[sensors.u]", f"{MOUNTED}\n[sensors.u]"), estimated)
    records = get_trials(found).fit
    theirs = build_posterior(found, found.full, records)
    assert {"gain_f_2", "x_dvl", "yaw_dvl", "scale_dvl", "u_0[log]"} <= set(theirs.names)
    channels, dvl = ("u", "v", "r"), found.mounts["u"]
    ours = make_posterior(
        found.model(found.full),
        records,
        {parameter.name: parameter.prior for parameter in theirs.parameters},
        [Sensor(name, mount=dvl if name != "r" else None) for name in channels],
    )
    assert ours.parameters == theirs.parameters
    np.testing.assert_array_equal(ours.guess, theirs.guess)
    z = ours.sample_prior(jax.random.key(0), 3)
    np.testing.assert_array_equal(jax.vmap(ours.log_density)(z), jax.vmap(theirs.log_density)(z))


def test_a_mount_of_a_channel_without_a_sensor_is_refused(tmp_path, log):
    with pytest.raises(InputError, match=r"mounts\.dvl\.channels"):
        campaign(tmp_path, log, ("[sensors.u]", '[mounts.dvl]\nchannels = ["w"]\n\n[sensors.u]'))


AXES = [
    (f'channels.f_{k + 1} = {{ column = "pwm[{k}]", unit = "command" }}', f"channels.f_{k + 1} = {{ {text} }}")
    for k, text in enumerate(
        (
            'sum = "pwm[0] - pwm[1]", unit = "command"',
            'sum = "0.5 pwm[0] + pwm[1]", unit = "command", offset = 3.0, scale = -2.0',
            'column = "pwm[2]", unit = "command"',
        )
    )
]
LINEAR = "polynomial = [0.0, 0.08]\nneutral = 1500\ndead_zone = [1480, 1520]\nreverse = 0.8"


def test_the_law_of_a_thruster_acts_on_the_sum_of_the_axes(tmp_path, log):
    """Of 0.1 c + c^3 mN, two columns of 10 make 8.002 N together, not 1.001 N each."""
    axes, motion = (log[0] - 1500.0) / 20.0, log[1]
    axes[0] = [10.0, -10.0, 5.0]
    cubic = LINEAR, "polynomial = [0.0, 1e-4, 0.0, 1e-3]"
    (record,) = get_trials(campaign(tmp_path, (axes, motion), cubic, *AXES)).fit
    mixed = np.column_stack([axes[:, 0] - axes[:, 1], 0.5 * axes[:, 0] + axes[:, 1] + 3.0, axes[:, 2]])
    expected = (1e-4 * mixed + 1e-3 * mixed**3) * [1.0, -2.0, 1.0]
    np.testing.assert_allclose(record.control, expected, rtol=1e-6, atol=1e-6)
    assert record.channel("f_1")[0] == pytest.approx(8.002)


@pytest.mark.parametrize("name", ["table", "polynomial"])
def test_a_sum_that_misses_the_neutral_of_its_law_is_refused(tmp_path, log, name):
    """The remedy, followed, makes the force of the law."""
    command, motion = 0.5 * log[0] + 750.0, log[1]
    (tmp_path / "thrust.csv").write_text("pwm,thrust\n1000,-40\n2000,40\n")
    changes = [CURVE] if name == "table" else []
    one, mixed = 'column = "pwm[0]", unit = "command"', 'sum = "pwm[0] - pwm[1] - pwm[2]", unit = "command"'
    with pytest.raises(InputError) as refused:
        get_trials(campaign(tmp_path, (command, motion), *changes, (one, mixed)))
    total = command @ [1.0, -1.0, -1.0]
    ends = "1000 to 2000, the ends of thrust.csv" if changes else "500 to 2500, the pulse widths"
    for part in ('log.csv, column "pwm[0] - pwm[1] - pwm[2]"', f"first is {total[0]:g}, 0 s into", ends, "the offset"):
        assert part in str(refused.value)
    followed = one, f"{mixed}, offset = 3000"
    (record,) = get_trials(campaign(tmp_path, (command, motion), *changes, followed)).fit
    np.testing.assert_allclose(record.channel("f_1"), law(total + 3000.0), atol=1e-9)


VOLTAGE = (
    "reverse = 0.8\n",
    """reverse = 0.8

[vehicle.thrust_laws.main.voltage]
stated = "16 V"
exponent = [1.2, 0.001]
exponent_above = [0.5]
widening = 30
""",
)
BATTERY = '[[import.files]]\npath = "battery.csv"\ntime = { column = "t", unit = "s" }\nchannels.V = { column = "volts", unit = "mV" }\n'


def test_thrust_is_that_at_the_battery_voltage_logged_last(tmp_path, log):
    """Of another log, with its own stamps: command by command as the law is written down; the voltage is no channel of the record."""
    rows = [(-0.05, 19.0), (3.15, 17.0), (9.95, 13.0), (20.05, 8.0)]
    (tmp_path / "battery.csv").write_text("t,volts\n" + "".join(f"{t},{1000 * v}\n" for t, v in rows))
    found = campaign(tmp_path, log, VOLTAGE, ("[[import.files]]", f"{BATTERY}\n[[import.files]]"))
    (record,) = get_trials(found).fit
    assert set(record.controls) == {"f_1", "f_2", "f_3"}
    assert "V" not in record.measured
    for k in range(0, len(record.time), 7):
        volts = [v for t, v in rows if t <= record.time[k] + 1e-9][-1]
        wide = 20.0 + 30.0 * (16.0 / volts - 1.0)
        for command, thrust in zip(log[0][k], record.control[k], strict=True):
            beyond = max(abs(command - 1500.0) - wide, 0.0)
            size = 0.08 * (20.0 + beyond) * (volts / 16.0) ** (0.5 if volts > 16 else 1.2 + 0.001 * beyond)
            expected = 0.0 if beyond == 0 else size if command > 1500 else -0.8 * size
            assert thrust == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert commands_of(found)["f_1"](10.0) == pytest.approx(1625.0)  # a schedule is written for the stated voltage
    with pytest.raises(InputError, match="different times"):
        Channels(found, "a stream", print)


@pytest.mark.parametrize(
    ("changes", "table", "said"),
    {
        "no voltage": ([VOLTAGE], "", "no channel V"),
        "a voltage of zero": (
            [VOLTAGE, ("[[import.files]]", f"{BATTERY}\n[[import.files]]")],
            "0,0\n1,16000\n2,16000\n",
            "V = 0 V at 0 s",
        ),
        "a curve without zero": (
            [VOLTAGE, CURVE, ("dead_zone = [1480, 1520]\n", "")],
            "",
            "no command without thrust",
        ),
        "a dead zone that is none": (
            [VOLTAGE, ("dead_zone = [1480, 1520]\n", "")],
            "",
            "the polynomial has no dead_zone",
        ),
        "a stated voltage of zero": ([VOLTAGE, ("16 V", "0 V")], "", "stated"),
    }.values(),
)
def test_a_law_with_a_voltage_needs_it(tmp_path, log, changes, table, said):
    (tmp_path / "battery.csv").write_text("t,volts\n" + table)
    (tmp_path / "thrust.csv").write_text("pwm,thrust\n1000,5\n2000,40\n")
    with pytest.raises(InputError, match=said):
        get_trials(campaign(tmp_path, log, *changes))
