"""Figure 5: a posterior as a graph: circles are stochastic, rectangles deterministic, and the shaded one is observed.

Nothing is drawn that the posterior does not hold: its parameters are the circles, `sigma_u` says that u was observed, and
everything else enters the simulation.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from seatrial.core.coefficients import CoefficientName
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.priors import LogUniform, Uniform
from seatrial.report.figures.style import BAND, BLUE, INK, MUTED, PAPER, POINT
from seatrial.report.labels import label_mathtext
from seatrial.report.numbers import plain
from studies.remus100.panels import NOISE_PREFIX, PAGE, TEXT, printed_unit
from studies.remus100.study import Study
from studies.remus100.trial import paper_posterior, paper_trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

HEIGHT, RADIUS = 262, 21
PARAMETERS, FUNCTIONS, OBSERVED = 200, 112, 30  # Heights of the three rows of nodes, in points
BOX = 32
BOLD = 10


def draw_figure_5(study: Study) -> "Figure":
    """Draw the posterior of M-1, as it is sampled."""
    reading = study.reading
    posterior = paper_posterior(reading, [paper_trial(reading, None)], None)
    units = {name: printed_unit(reading, name) for name in posterior.names}
    return model_graph(posterior, reading.print_scales, units)


def model_graph(posterior: Posterior, scales: Mapping[str, float], units: Mapping[str, str]) -> "Figure":
    """Draw a posterior as a graph.

    Args:
        posterior: whose parameters are the nodes.
        scales: SI value of the unit in which a parameter is printed; 1 where absent.
        units: that unit, by parameter.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE * POINT, HEIGHT * POINT), dpi=72)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, PAGE), ylim=(0, HEIGHT))
    axes.set_axis_off()
    noises = [parameter for parameter in posterior.parameters if parameter.name.startswith(NOISE_PREFIX)]
    terms = [parameter for parameter in posterior.parameters if parameter not in noises]
    step = PAGE / len(posterior.parameters)
    places = {parameter.name: step * (i + 0.5) for i, parameter in enumerate((*terms, *noises))}
    for parameter in posterior.parameters:
        _stochastic(axes, places[parameter.name], parameter, scales.get(parameter.name, 1.0), units[parameter.name])
    for noise in noises:
        _observed_channel(axes, noise, terms, places)
    return figure


def _observed_channel(axes: "Axes", noise: Parameter, terms: list[Parameter], places: Mapping[str, float]) -> None:
    """Draw mean, precision and observation of one channel, and the arrows into them."""
    channel, at = noise.name.removeprefix(NOISE_PREFIX), places[noise.name]
    middle = sum(places[term.name] for term in terms) / len(terms)
    width = min(2 * (at - middle) - 120, 2 * middle - 12)
    mean = _rectangle(axes, middle, f"mean_{channel}", _equation(terms), width)
    precision = _rectangle(axes, at, f"prec_{channel}", rf"$\tau_{{{channel}}} = 1/\sigma_{{{channel}}}^2$", 84)
    for term in terms:
        # Straight below, or as near as the box reaches.
        _arrow(
            axes,
            (places[term.name], PARAMETERS - RADIUS),
            (min(max(places[term.name], middle - 0.46 * width), middle + 0.46 * width), _top()),
        )
    _arrow(axes, (at, PARAMETERS - RADIUS), (at, _top()))
    centre = (middle + at) / 2
    _circle(axes, centre, OBSERVED, f"obs_{channel}", fill=True)
    _text(axes, centre, OBSERVED, f"obs_{channel}", weight="bold")
    _text(axes, centre + 2 * RADIUS + 26, OBSERVED, rf"$N(\mathrm{{mean}},\,1/\tau_{{{channel}}})$")
    for start in (middle, at):
        side = -0.75 if start < centre else 0.75
        _arrow(axes, (start, FUNCTIONS - BOX / 2), (centre + side * (RADIUS + 2), OBSERVED + 0.7 * RADIUS))
    mean.set_label(f"mean_{channel}: {', '.join(term.name for term in terms)}")
    precision.set_label(f"prec_{channel}: {noise.name}")


def _stochastic(axes: "Axes", x: float, parameter: Parameter, scale: float, unit: str) -> None:
    _circle(axes, x, PARAMETERS, parameter.name)
    _text(axes, x, PARAMETERS, label_mathtext(parameter.label), size=BOLD)
    _text(axes, x, PARAMETERS + RADIUS + 20, _prior(parameter, scale))
    _text(axes, x, PARAMETERS + RADIUS + 8, f"[{unit}]")


def _prior(parameter: Parameter, scale: float) -> str:
    """Write a prior with its bounds, or with mean and standard deviation where it has none."""
    prior = parameter.prior
    if isinstance(prior, (Uniform, LogUniform)):
        low, high = (plain(float(bound) / scale) for bound in prior.bounds)
        return f"{'U' if isinstance(prior, Uniform) else 'log U'}({low}, {high})"
    return f"N({plain(float(prior.mean) / scale)}, {plain(float(prior.sd) / scale)}²)"


def _equation(terms: list[Parameter]) -> str:
    """Equation of motion that the simulation integrates, as mathtext."""
    products = []
    for term in terms:
        name = CoefficientName.parse(term.name)
        share = r"(1-\tau)\," if name.axis == "T" else ""
        products.append(rf"{share}{name.label}\,{''.join(factor.label for factor in name.factors)}")
    return rf"$(m - X_{{\dot{{u}}}})\,\dot{{u}} = {' + '.join(products)}$"


def _top() -> float:
    return FUNCTIONS + BOX / 2


def _circle(axes: "Axes", x: float, y: float, label: str, fill: bool = False) -> None:
    from matplotlib.colors import to_rgba
    from matplotlib.patches import Ellipse

    inside = to_rgba(BLUE, BAND if fill else 0.0)
    axes.add_patch(
        Ellipse((x, y), 2.6 * RADIUS, 2 * RADIUS, facecolor=inside, edgecolor=BLUE, linewidth=1.2, label=label)
    )


def _rectangle(axes: "Axes", x: float, name: str, content: str, width: float) -> "Patch":
    from matplotlib.patches import Rectangle

    box = Rectangle(
        (x - width / 2, FUNCTIONS - BOX / 2), width, BOX, facecolor=PAPER, edgecolor=MUTED, linewidth=1.1, label=name
    )
    _text(axes, x, FUNCTIONS + 7, name, weight="bold")
    _text(axes, x, FUNCTIONS - 7, content)
    return axes.add_patch(box)


def _arrow(axes: "Axes", start: tuple[float, float], end: tuple[float, float]) -> None:
    axes.annotate(
        "", end, start, arrowprops={"arrowstyle": "-|>", "color": MUTED, "linewidth": 0.9, "shrinkA": 1, "shrinkB": 1}
    )


def _text(axes: "Axes", x: float, y: float, content: str, size: float = TEXT, weight: str = "normal") -> None:
    axes.text(x, y, content, ha="center", va="center", fontsize=size, color=INK, weight=weight, zorder=5)
