"""Pictures from Python: what each shows, its axes and units, and that a result is a table, a notebook cell and an ArviZ tree too."""

import matplotlib as mpl
import numpy as np
import pytest
from arviz_stats import loo
from scipy.stats import norm

import seatrial as st

mpl.use("agg")
RPM = 2 * np.pi / 60
PRIORS = {
    "X_uabsu": st.half_normal(10.0, upper=0.0),
    "T_nabsn": st.LogNormal(6e-4, 1.5),
    "sigma_u": st.LogUniform(0.002, 0.2),
}


def made_draws(population: bool = False) -> st.Draws:
    """Independent normal draws of three parameters: what pictures and tables are made of needs no chain."""
    shape = (1 if population else 4, 200, 3)
    z = np.random.default_rng(1).normal(size=shape)
    values = np.array([-2.9, 6.2e-4, 0.02]) + np.array([0.1, 2e-5, 0.001]) * z
    moved = 0.5 if population else np.nan
    units = ("kg/m", "kg m/rad^2", "m/s")
    return st.Draws(z, -0.5 * (z**2).sum(-1), 0.6, 0, tuple(PRIORS), units, values, moved)


@pytest.fixture(scope="module")
def fitted():
    vehicle = st.load_vehicle("remus100_surge")
    model = vehicle.build(free=["X_uabsu", "T_nabsn"])
    family = st.Family("n", trim=1200 * RPM, duration=10.0, active=8.0, sample_time=0.1, kind="doublet")
    truth = {**vehicle.coefficients, "sigma_u": 0.02}
    schedule = family.schedule(200 * RPM, 4.0)
    record = st.simulate(model, truth, schedule, ["u"], start={"u": 1.5}, rates={"u": 5.0}, key=1)
    return st.make_posterior(model, record, PRIORS, start={"u": 1.5}), record, model, family


def labels(axes) -> list[str]:
    return [str(artist.get_label()) for artist in (*axes.patches, *axes.lines, *axes.collections)]


def test_a_fit_shows_channels_in_si_and_the_propeller_in_rpm(fitted):
    posterior, record, *_ = fitted
    predicted = st.predict(posterior, made_draws(), record, start={"u": 1.5}, n=20)
    speed, propeller = st.plot.fit(predicted)
    assert (speed.get_ylabel(), propeller.get_ylabel()) == ("$u$ [m/s]", "$n$ [rpm]")
    assert [text.get_text() for text in speed.get_legend().get_texts()] == ["measured", "90 % band", "predicted"]
    drawn = next(line for line in speed.lines if line.get_label() == "predicted")
    np.testing.assert_allclose(np.ravel(drawn.get_ydata()), predicted.mean[:, 0])
    residual, lag = st.plot.residuals(predicted)
    assert (residual.get_ylabel(), lag.get_xlabel()) == ("residual [sd]", "lag [s]")
    assert list(predicted.summary().columns) == ["unit", "samples", "explained", "rmse", "coverage"]
    with pytest.raises(st.InputError, match="expected: 2"):
        st.plot.fit(predicted, ax=speed.figure.axes[:1] * 3 + [speed])


def test_dots_are_seen_on_a_screen(fitted):
    """Strokes as short as these were snapped away, so that a picture of pixels showed no measurement."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from seatrial.report.figures.style import draw_dots

    figure = Figure(figsize=(2, 2), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    draw_dots(axes, np.linspace(0.0, 20.0, 20), np.linspace(0.0, 1.0, 20), color="#000000")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., 0]
    assert (pixels < 200).sum() >= 20


def test_posteriors_pairs_and_traces_are_of_the_parameters_asked_for():
    draws = made_draws()
    truth = {"X_uabsu": -2.9, "T_nabsn": 6.2e-4}
    found = st.plot.posteriors(draws, priors=PRIORS, truth=truth)
    assert [axes.get_xlabel() for axes in found] == [
        "$X_{u|u|}$ [kg/m]",
        "$T_{n|n|}$ [10⁻⁴ kg m/rad²]",
        "$σ_{u}$ [10⁻² m/s]",
    ]
    assert {"prior", "posterior draws", "true value", "95 % interval"} <= set(labels(found[0]))
    assert "true value" not in labels(found[2])
    prior = next(line for line in found[2].lines if line.get_label() == "prior")
    x, y = (np.asarray(part) for part in prior.get_data())
    shape = y[x > 0] * x[x > 0]
    np.testing.assert_allclose(shape, shape[0], rtol=0.02)  # log-uniform: density times value is constant
    grid = st.plot.pairs(draws, ["X_uabsu", "sigma_u"])
    assert grid.shape == (2, 2)
    assert grid[1, 0].get_xlabel() == "$X_{u|u|}$ [kg/m]"
    assert not grid[0, 1].axison
    (chains,) = st.plot.traces(draws, ["sigma_u"])
    assert labels(chains)[:2] == ["chain 1", "chain 2"]
    with pytest.raises(st.InputError, match="population"):
        st.plot.traces(made_draws(population=True))
    with pytest.raises(st.InputError, match="X_w"):
        st.plot.pairs(draws, ["X_w"])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"names": []}, r"names\n.*none\n.*one parameter at least"),
        ({"priors": 3}, "priors"),
        ({"priors": {"X_uabsu": 3}}, r'priors\["X_uabsu"\]'),
        ({"truth": "a"}, "truth"),
        ({"truth": 3}, "truth"),
        ({"truth": [1]}, "truth"),
        ({"truth": {"X_uabsu": "a"}}, r'truth\["X_uabsu"\]'),
        ({"truth": {"foo": 3.0}}, 'truth\n.*"foo", which is no parameter'),
        ({"mode": 3}, r"mode\n.*an int: 3"),
    ],
)
def test_what_cannot_be_drawn_is_refused(given, message):
    draws = made_draws()
    assert len(st.plot.posteriors(draws, truth={"X_uabsu": -2.9, "X_udot": -0.9})) == 3
    for draw in (st.plot.posteriors, st.plot.pairs)[: 1 if {"priors", "mode"} & set(given) else 2]:
        with pytest.raises(st.InputError, match=message):
            draw(draws, **given)


@pytest.mark.parametrize("name", st.plot.__all__)
def test_what_is_no_result_is_refused(name):
    with pytest.raises(st.InputError, match=r"result[\s\S]*an int: 3[\s\S]*expected: an? "):
        getattr(st.plot, name)(3)


def test_axes_of_ones_own_are_drawn_into_and_returned():
    from matplotlib.figure import Figure

    mine = Figure().subplots(1, 3)
    assert all(one is other for one, other in zip(st.plot.posteriors(made_draws(), ax=mine), mine, strict=True))
    assert mine[2].get_xlabel().startswith("$σ_{u}$")


def test_a_design_and_a_selection_are_pictures_tables_and_cells(fitted):
    *_, model, family = fitted
    problem = st.make_design_problem(
        model, made_draws(), family, np.array([50.0, 100.0]) * RPM, [2.0, 4.0], {"u": 0.02}, start={"u": 1.5}
    )
    design = st.design_trial(problem)
    surface = st.plot.entropy_surface(design)
    assert (surface.get_xlabel(), surface.get_ylabel()) == ("period [s]", "amplitude [rpm]")
    star = next(line for line in surface.lines if line.get_label() == "best design")
    assert np.ravel(star.get_ydata())[0] == pytest.approx(design.sweeps[0].amplitude[design.sweeps[0].best[0]] / RPM)
    left = design.summary()
    np.testing.assert_allclose(left["left"], left["sd_after"] / left["sd_before"])
    structures = (st_structure("with", "X_u X_uabsu"), st_structure("without", "X_uabsu"))
    from seatrial.selection.verdict import select

    found = select(structures, [st.Evidence(-1.0, 0.1, "by hand"), st.Evidence(0.0, 0.1, "by hand")], ["X_u"])
    bars = st.plot.inclusion(found)
    assert [text.get_text() for text in bars.get_yticklabels()] == ["$X_{u}$"]
    assert bars.patches[0].get_width() == pytest.approx(1 / (1 + np.e))  # type: ignore[attr-defined]
    assert list(found.summary().index) == ["without", "with"]
    for one in (design, found, found.evidences[0], made_draws()):
        assert one._repr_html_().count("<table") == 1
    assert dir(st.plot) == st.plot.__all__
    first, head, *rows = repr(found).splitlines()
    assert first == "Which terms the data support"
    assert head.split() == [name for name in found.summary().columns if name != "with_errors"]
    assert [row.split()[0] for row in rows[:2]] == ["without", "with"]
    assert rows[2:] == [f"- {verdict}" for verdict in found.verdicts]
    # A column of which nothing is known is left out: the status of a healthy evidence.
    assert repr(found.evidences[0]).split()[3:6] == ["log_value", "std_error", "method"]
    assert "status" not in repr(found.evidences[0])


def st_structure(label: str, terms: str):
    from seatrial.selection.structures import Structure

    return Structure(label, tuple(terms.split()))


def test_a_tree_for_arviz_has_groups_coordinates_and_units(fitted):
    posterior, record, *_ = fitted
    draws = made_draws()
    tree = st.to_arviz(draws, posterior, record, start={"u": 1.5}, n=800)
    assert list(tree.children) == [
        "posterior",
        "sample_stats",
        "observed_data",
        "constant_data",
        "posterior_predictive",
    ]
    np.testing.assert_array_equal(tree["posterior/T_nabsn"], draws["T_nabsn"])
    assert tree["posterior/T_nabsn"].attrs["units"] == "kg m/rad^2"
    measured = record.channel("u")
    observed, replicated = tree["observed_data/u[trial]"], tree["posterior_predictive/u[trial]"]
    np.testing.assert_array_equal(observed, measured[np.isfinite(measured)])
    np.testing.assert_array_equal(observed["time_u[trial]"], record.time[np.isfinite(measured)])
    assert replicated.dims == ("chain", "draw", "time_u[trial]")
    predicted = st.predict(posterior, draws, record, start={"u": 1.5})
    there = np.isfinite(measured)
    spread = replicated.values.reshape(-1, there.sum()) - predicted.mean[there, 0]
    # The variance of 800 motions that move as a whole is known to sqrt(2 / 800), 5 %.
    assert np.mean(spread**2) == pytest.approx(np.mean(predicted.sd[there, 0] ** 2), rel=0.15)
    with pytest.raises(st.InputError, match=r"n\n.*-1"):
        st.to_arviz(made_draws(), n=-1)
    with pytest.raises(st.InputError, match="records alone"):
        st.to_arviz(draws, None, record)


@pytest.mark.proof
def test_the_log_likelihood_in_a_tree_is_that_of_each_measurement(fitted):
    """Two records of two channels, given in another order than fitted: each density by hand about the motion of one draw."""
    _, _, model, family = fitted
    truth = {**st.load_vehicle("remus100_surge").coefficients, "sigma_u": 0.02, "sigma_udot": 0.01}
    start = {"u": 1.5}
    records = [
        st.simulate(model, truth, family.schedule(size * RPM, 4.0), ["u", "udot"], start=start, key=key, label=label)
        for label, size, key in (("first", 200, 1), ("second", -150, 2))
    ]
    posterior = st.make_posterior(model, records, {**PRIORS, "sigma_udot": st.LogUniform(0.001, 0.1)}, start=start)
    centre = np.array([truth[name] for name in posterior.names])
    shape = (4, 100, centre.size)
    values = centre * (1 + 1e-4 * np.random.default_rng(3).normal(size=shape))
    draws = st.Draws(np.zeros(shape), np.zeros(shape[:2]), 0.6, 0, posterior.names, ("1",) * shape[2], values)
    tree = st.to_arviz(draws, posterior, records[::-1], start=start, n=200, log_likelihood=True)
    group = tree["log_likelihood"]
    assert set(group.data_vars) == {f"{channel}[{label}]" for channel in ("u", "udot") for label in ("first", "second")}
    one = draws.thinned([20])
    alone = st.Draws(one.z[2:3], one.log_density[2:3], 0.6, 0, one.names, one.units, one.values[2:3])
    for record in records:
        predicted = st.predict(posterior, alone, record, start=start)
        for column, channel in enumerate(predicted.channels):
            sd = float(alone[f"sigma_{channel}"].item())
            expected = norm(predicted.mean[:, column], sd).logpdf(record.channel(channel))
            shown = group[f"{channel}[{record.label}]"].sel(chain=2, draw=20)
            np.testing.assert_allclose(shown, expected, rtol=1e-9)
            # Draws as close together as these leave ArviZ's sum near that of any one of them.
            assert loo(tree, var_name=shown.name).elpd == pytest.approx(expected.sum(), abs=0.5)
    with pytest.raises(st.InputError, match="was not fitted"):
        st.to_arviz(draws, posterior, fitted[1], start=start, log_likelihood=True)
    with pytest.raises(st.InputError, match="no records"):
        st.to_arviz(draws, posterior, log_likelihood=True)
