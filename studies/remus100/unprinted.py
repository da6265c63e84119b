"""What the paper leaves open, and how it is read here."""

from markupsafe import Markup

from seatrial.numerics.sigma_points import UnscentedRule
from seatrial.report.labels import name_html
from seatrial.report.numbers import plain, typeset
from studies.remus100.cards import labels_of
from studies.remus100.compute.designs import ACTIVE as WINDOWS
from studies.remus100.compute.designs import INITIAL_VARIANCE as DESIGN_VARIANCE
from studies.remus100.compute.filters import BOUND_SHARE, HOLD, INITIAL_VARIANCE, N_STEPS, STEP
from studies.remus100.compute.trial import ACTIVE, DURATION, PERIOD, N
from studies.remus100.figures.panels import printed_unit
from studies.remus100.vehicle_file import RPM, Reading


def settings_rows(reading: Reading) -> list[tuple[str, Markup]]:
    """Return pairs of what is left open and how it is read, the values those that were used."""
    rule, doubted = UnscentedRule(), reading.doubted
    low, high = (plain(bound / RPM) for bound in (reading.lowest, reading.highest))
    share = f"{100 * BOUND_SHARE:g}%"
    small, large = map(plain, reading.source.doubted.values)
    rows = {
        "Units of T and n": f"T is printed in {printed_unit(reading, 'T_nabsn')}; trim is at {plain(reading.trim / RPM)} rpm and "
        f"{plain(reading.hull.trim['u'])} m/s",
        "Inertia": f"m - X_udot = {plain(reading.inertia)} kg, thrust deduction {plain(reading.hull.thrust_deduction)}",
        "Input of Figures 1 and 2": f"random steps of up to +-{plain(reading.steps / RPM)} rpm about trim, each held for "
        f"{plain(HOLD)} s, from trim, {plain(N_STEPS * STEP)} s at {plain(STEP)} s",
        "Noise": f"standard deviation {plain(reading.filter_noise)} m/s of u, and the same number of du/dt, for the filters; "
        f"{plain(reading.sigma)} m/s of u, which alone is measured, in Section IV",
        "P of the filters": f"variance {INITIAL_VARIANCE[1]:.0e} of the drag coefficients, as the tables have it, in Section "
        f"III's comparisons; {DESIGN_VARIANCE[1]:.0e}, as the text has it, in its designs",
        "Bounds of SRUKF-C": f"{share} of the true value to either side",
        "Sigma points": f"alpha {plain(rule.alpha)}, beta {plain(rule.beta)}, kappa {plain(rule.kappa)}",
        "Manoeuvre window": "whole doublets within "
        + ", ".join(plain(window) for window in WINDOWS.values())
        + f" s of {plain(DURATION)} s, side by side; amplitudes from {low} to {high} rpm",
        "Entropy": "of the three coefficients, without the speed; H = -E[log p], so that the gain is H(prior) - H(posterior)",
        "Trial of Section IV": f"doublets of {high} rpm and {plain(PERIOD)} s for {plain(ACTIVE)} s, {N} samples in "
        f"{plain(DURATION)} s, noise of seed 1",
        "Priors": "uniform about half the true value, 200% of it to either side; sigma_u from 0 to twice the true one",
        "Prior of the doubted term": f"in Tables IV and V as the others, with {doubted} = {small} and {large}; in Table VI, where it is "
        f"called uninformative, within +-{plain(reading.source.doubted.wide)} [SI]",
        "Geweke's score": "with the variance of the mean of each segment; with that of the draws, as printed, it could hardly fail",
        "Columns BF of Tables IV and V": "posterior probabilities at equal prior ones; M-0 is the model with the doubted term, M-1 "
        "the one without",
    }
    labels = labels_of(reading)
    return [(what, name_html(typeset(words), labels)) for what, words in rows.items()]
