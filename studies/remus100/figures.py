"""Every figure of the study: how it is drawn, what it is, and how to read it."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from seatrial.report.numbers import plain
from studies.remus100.chains import chain_figure
from studies.remus100.designs import ACTIVE, POINTS, draw_figure_3, draw_relay
from studies.remus100.evidence import draw_listing_1, draw_odds
from studies.remus100.filters import (
    BOUND_SHARE,
    FIRST_SEED,
    HOLD,
    SETTLING_TIME,
    draw_figure_1,
    draw_figure_2,
    draw_figure_4,
)
from studies.remus100.iteration import draw_iteration
from studies.remus100.reading import RPM
from studies.remus100.study import Study
from studies.remus100.trial import DURATION
from studies.remus100.trial import PERIOD as DOUBLET

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class PaperFigure(NamedTuple):
    """One figure of the study.

    Attributes:
        draw: draws it from the parts that its item rests on.
        title: what it is, for those who cannot see it.
        caption: what it shows and how to read it, in plain text.
    """

    draw: "Callable[[Study], Figure]"
    title: str
    caption: Callable[[Study], str]


def _figure_1(study: Study) -> str:
    return (
        f"One trial, seed {FIRST_SEED}, of random steps of n held for {plain(HOLD)} s each. Left: input, and the response as "
        "measured, as it truly was, and as each filter has it. Middle: estimates, in the frame of what follows "
        f"{plain(SETTLING_TIME)} s; the first swings leave it. Right: standard deviations that the filters state, on a logarithmic "
        "axis. Where lines lie on one another the filters agree."
    )


def _figure_2(study: Study) -> str:
    return (
        "The trial of Figure 1 by the square-root filter, free (SRUKF) and with its sigma points clipped (SRUKF-C) at the "
        f"dotted bounds, {100 * BOUND_SHARE:g}% to either side of the true values. Lowest row: sigma points clipped at each "
        f"step, mean over {study.sizes.filter_seeds} trials, and the acceleration during the first second of the trial above. "
        "A constrained filter starts sure of itself: its standard deviations begin where the bounds put them."
    )


def _figure_3(study: Study) -> str:
    return (
        "Entropy of the three coefficients before less after the trial, ½ ln(|P before| / |P after|), by the SRUKF along "
        f"noise-free motion, for {POINTS} x {POINTS} repeated doublets. Surface and contours: doublets within a window of "
        f"{plain(ACTIVE['short'])} s, then quiet to {plain(DURATION)} s. Lower right: the largest amplitude, for three windows. "
        "Each drop after a ridge is one whole doublet fewer in the window."
    )


def _figure_4(study: Study) -> str:
    return (
        f"The SRUKF along doublets of {plain(study.reading.highest / RPM)} rpm and {plain(DOUBLET)} s for "
        f"{plain(ACTIVE['medium'])} s, then quiet. Left: input, and response as measured, as it truly was and, for u, as "
        f"the filter has it. Middle: estimates, in the frame of what follows {plain(SETTLING_TIME)} s. Right: standard "
        "deviations, which fall while the doublets run; the quiet time after them teaches little more."
    )


def _relay(study: Study) -> str:
    return (
        "The self-oscillating test: n stands at trim plus or minus the control amplitude, and reverses each time u has "
        f"moved from trim by the oscillation amplitude, for {plain(ACTIVE['medium'])} s. Left: entropy reduction over both; "
        "the star is the best, and hatched tests reverse fewer than twice, since what they wait for is out of reach. Right: "
        f"input and response of the best, beside the largest doublets of {plain(DOUBLET)} s."
    )


def _chain(study: Study) -> str:
    sizes = study.sizes
    return (
        f"One of {sizes.chains} chains of {sizes.burn_in} + {sizes.draws} iterations, a row for each parameter. Left: the chain "
        "over its true value, from the first iteration on; dots are Geweke's scores of the first half of what is kept "
        "(right axis, variance of the mean), of which 95% should lie in the band. Middle: autocorrelation of the draws as "
        "they are, near 1 unless their mean is near 0, and with mean and trend taken out, which says how far apart draws are "
        "independent. Right: the draws of all chains, their normal approximation, mean, 95% interval of highest density, "
        "and the true value."
    )


def _listing_1(study: Study) -> str:
    methods = study.part("evidence-4").sizes["method"]
    return (
        "The same question answered many times. Histograms: Listing 1 over seeds, its draws independent for each model or "
        f"shared by both ({study.sizes.listing_draws} each); the percentages are of the seeds that gave less than 0.05 or more "
        "than 0.95. A method that works gives one answer whatever its seed. Below: the number that the paper prints, then "
        f"{methods} methods that share no code, with bars of one Monte Carlo error. Left the smaller true coefficient (Table IV), "
        "right the larger (Table V)."
    )


def _odds(study: Study) -> str:
    return (
        f"What the data say: probability of M-0, the model with the doubted term, on {study.sizes.data_seeds} trials for each "
        "true value, by importance sampling. On the dashed line the data do not tell the models apart."
    )


def _iteration(study: Study) -> str:
    doubted = study.reading.doubted
    return (
        f"Left: standard deviation of {doubted} that each second trial would leave, by Fisher information, alone and together "
        "with the first. Right: what was then found with one trial, with the same trial twice, and with the best second "
        "trial: standard deviations of M-0, and the probability of M-0 under its wide prior (dashed: undecided)."
    )


# By the key of the item it stands under, in the order of the paper.
FIGURES: dict[str, PaperFigure] = {
    "figure-1": PaperFigure(draw_figure_1, "Responses and estimates of EKF, UKF and SRUKF", _figure_1),
    "figure-2": PaperFigure(draw_figure_2, "Responses and estimates of SRUKF and SRUKF-C", _figure_2),
    "figure-3": PaperFigure(draw_figure_3, "Entropy reduction over amplitude and period", _figure_3),
    "figure-4": PaperFigure(draw_figure_4, "The square-root filter along the chosen doublet", _figure_4),
    "relay": PaperFigure(draw_relay, "The self-oscillating test beside the doublet", _relay),
    "figure-6": PaperFigure(chain_figure("chain-3"), "The chain of Table III", _chain),
    "listing-1": PaperFigure(draw_listing_1, "Listing 1 over seeds, beside four other methods", _listing_1),
    "odds": PaperFigure(draw_odds, "Probability of M-0 over the true doubted coefficient", _odds),
    "figure-7": PaperFigure(chain_figure("chain-6-full"), "The chain of M-0", _chain),
    "figure-8": PaperFigure(chain_figure("chain-6-reduced"), "The chain of M-1", _chain),
    "iteration": PaperFigure(draw_iteration, "Second trials, predicted and run", _iteration),
}
