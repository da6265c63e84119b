"""The picture of profile likelihoods: intervals, open ends and the ends of the prior."""

import numpy as np

from seatrial.estimation.posterior.profile_result import DROP, Profile
from seatrial.report.drawing import draw_svg
from seatrial.report.figures.posterior import ProfilePanel, profile_figure


def profile(kind: str) -> Profile:
    """A parabola about -3 with standard error 0.5, cut at the prior's end on the sides that are open."""
    half = 0.5 * np.sqrt(2 * DROP)
    values = np.linspace(-3 - half, -3 + half, 9)
    lower, upper, bounds = -3 - half, -3 + half, (-9.0, 3.0)
    drop = 0.5 * ((values + 3) / 0.5) ** 2
    if kind in ("open above", "flat"):
        values, drop = values[values <= -2.7], drop[values <= -2.7]
        upper, bounds = np.inf, (-9.0, float(values[-1]))
    if kind == "flat":
        lower, drop = -np.inf, 0.1 * drop
    return Profile("X_u", "kg/s", "X_{u}", -3.0, values, drop, values[:, None], lower, upper, bounds)


def labels_of(axes) -> list[str]:
    return [str(artist.get_label()) for artist in (*axes.patches, *axes.lines)]


def test_each_parameter_has_its_interval_and_its_truth():
    panels = [ProfilePanel(profile(kind), "$X_{u}$", -2.9) for kind in ("closed", "open above", "flat", "closed")]
    figure = profile_figure(panels, ["cost $5"])
    closed, above, flat, _ = figure.axes
    assert {"profile", "1.92 below", "95 % interval", "true value"} <= set(labels_of(closed))
    assert "end of the prior" not in labels_of(closed)
    assert "end of the prior" in labels_of(above)
    titles = [axes.get_title(loc="left") for axes in (closed, above, flat)]
    assert titles == ["−3.98 to −2.02", "above −3.98", "flat: any value of the prior"]
    assert closed.get_xlabel() == "$X_{u}$ [kg/s]"
    assert "cost $5" in draw_svg(figure)


def test_between_its_points_the_curve_is_the_parabola():
    (axes,) = profile_figure([ProfilePanel(profile("closed"), "$X_{u}$")]).axes
    curve = next(line for line in axes.lines if line.get_label() == "profile")
    x, y = map(np.asarray, curve.get_data())
    np.testing.assert_allclose(y, -0.5 * ((x + 3) / 0.5) ** 2, atol=1e-9)
