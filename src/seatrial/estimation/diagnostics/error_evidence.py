"""Evidence of rival models with every error: the average over sets S of sources of error, log sum_S P(S) p(y | S), instead of none.

Sets and their densities are those of the error budget. Models that differ in their terms alone share one linear model, about the motion of
all their terms with the best set of sources: an absent term is one whose column is left out. So they differ by what the data say, and not
by how well each was followed; 16 structures take one pass. What the normal approximation misses of an evidence within a model is taken to
be missing here too.

Models are rivals of each other already: an effect that one of them has as a term, or as a parameter, is a source of error of none.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from seatrial.estimation.diagnostics.error_budget import follow_sources
from seatrial.estimation.diagnostics.error_sources import StatedErrors, lay_out
from seatrial.estimation.diagnostics.linear_model import LOG_ROOT, LinearModel, Shape, edges_of, inside
from seatrial.estimation.posterior.mode import Mode, expand_prior
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.priors.box import log_slopes


def log_evidence_gains(
    posteriors: Sequence[Posterior], modes: Sequence[Mode | None], stated: StatedErrors = StatedErrors()
) -> list[float] | None:
    """Return by how much each log evidence is larger with every error than within the model, nats.

    Args:
        posteriors: of the same records.
        modes: of each; None if none was found.
        stated: standard deviations of stated inputs.

    Returns:
        None if a likelihood has process noise or is one's own, a mode is missing, or a motion diverges.
    """
    known = [mode for mode in modes if mode is not None]
    if len(known) < len(posteriors) or not all(isinstance(one.likelihood, OutputError) for one in posteriors):
        return None
    groups: dict[tuple[int, int], list[int]] = {}
    for i, one in enumerate(posteriors):
        groups.setdefault((id(one.likelihood), id(one.data)), []).append(i)
    hosts = [_host([posteriors[i] for i in own], [known[i] for i in own]) for own in groups.values()]
    laid = [lay_out(posterior, inside(mode.z, edges_of(posterior)), stated) for posterior, mode in hosts]
    if any(one is None for one in laid):
        return None
    among = frozenset.intersection(*(frozenset(source.effect for source in one.sources) for one in laid if one))
    totals = np.zeros(len(posteriors))
    for (host, mode), own in zip(hosts, groups.values(), strict=True):
        model, _ = follow_sources(host, mode, stated, among)
        for i in own:
            narrow = _narrowed(model, host, posteriors[i])
            totals[i] = np.logaddexp.reduce([one.log_density for one in narrow.average()]) + _constant(narrow)
    within = np.array([mode.log_evidence for mode in known])
    best = int(np.argmax(within))
    at = lay_out(posteriors[best], inside(known[best].z, edges_of(posteriors[best])), stated, among=())
    assert at is not None, "the motion at the mode is finite"
    alone = LinearModel(posteriors[best], at)
    alone.channels = [(count, shapes[:1]) for count, shapes in alone.channels]  # the noise as it is modelled
    same = within[best] - alone.members([{}])[0].log_density - _constant(alone)  # that of the noise: of all
    return (totals + same - within).tolist()


def _host(posteriors: Sequence[Posterior], modes: Sequence[Mode]) -> tuple[Posterior, Mode]:
    """Return the posterior of all terms of some that share a likelihood, and of these the mode of most density to begin at."""
    best = max(modes, key=lambda mode: mode.log_density)
    present = [one.present for one in posteriors if one.present is not None]
    return replace(posteriors[0], present=np.max(present, 0) if len(present) == len(posteriors) else None), best


def _narrowed(model: LinearModel, host: Posterior, posterior: Posterior) -> LinearModel:
    """Return the linear model without what a posterior lacks: its values there are 0, and known."""
    kept = [k for k, place in enumerate(model.moving) if place in {*posterior.places}]
    if len(kept) == len(model.moving):
        return model
    _, value, slope, _ = map(np.asarray, expand_prior(host, model.at.z))
    zero = model.x - value / slope * np.exp(log_slopes(model.at.z, edges_of(host)))
    count, sizes = len(model.moving), model.at.sizes.size
    places = np.r_[0, 1 + np.array(kept, int), 1 + count + np.arange(sizes)]
    turn = np.eye(1 + count + sizes)[:, places]
    for k in {*range(count)} - {*kept}:
        turn[1 + k, 0] = -zero[model.moving[k]]
    narrow = copy(model)
    narrow.moving = [model.moving[k] for k in kept]
    narrow.edges, narrow.curvature = model.edges[kept], model.curvature[kept]
    narrow.peak, narrow.height = model.peak[kept], model.height[kept]
    narrow.channels = [
        (n, [Shape(turn.T @ one.products @ turn, one.log_sd) for one in shapes]) for n, shapes in model.channels
    ]
    return narrow


def _constant(model: LinearModel) -> float:
    """Return what the log density of a member lacks of an evidence, but for what is the same of every structure."""
    return float((model.height + LOG_ROOT).sum())
