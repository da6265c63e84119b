"""What is known about each parameter and about several together, kept on disk: of the best design, and of each fit.

The directions are the eigenvectors v of the information of the data alone, scaled by the values: v / sqrt(eigenvalue) is the
change of all parameters at once, in shares of their values, that makes the data one standard error less likely.
"""

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.design.sweep import design_key
from seatrial.campaign.inference.estimate import Estimate
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.campaign.store.files import Store, is_current, key_of, read_json, write_stamped_json
from seatrial.core.coefficients import CoefficientName
from seatrial.design.sweep import Sweep
from seatrial.estimation.identifiability import Identifiability, identifiability_of_design, identify
from seatrial.estimation.information import likelihood_information
from seatrial.estimation.output_error import is_deviation
from seatrial.estimation.posterior import Parameter
from seatrial.estimation.remedies import measured, percent

NAMED = 0.1
"""Share of the largest move from which a parameter is named in a direction."""
VAIN = 10.0
"""Standard deviation over the value from which a percentage says nothing."""
BY_ITSELF = "each parameter is known by itself"


@dataclass(frozen=True)
class KnownParameter:
    """One parameter: its value, what is known of it, and what it is confused with.

    Attributes:
        name: parameter.
        unit: SI unit.
        value: prior mean before the data, posterior mode after.
        sd: its standard deviation, expected before the data.
        relative: `sd` over the size of the value.
        left: `sd` over the prior's.
        partner: the parameter it is most strongly correlated with; empty if it is the only one.
        correlation: with that one.
    """

    name: str
    unit: str
    value: float
    sd: float
    relative: float
    left: float
    partner: str
    correlation: float

    @property
    def known_to(self) -> str:
        """`relative` in words."""
        return "not at all" if self.relative >= VAIN else percent(self.relative)


@dataclass(frozen=True)
class Direction:
    """A change of several parameters at once that the data alone know to one standard error.

    Attributes:
        sd: length of the change, 1 / sqrt(eigenvalue).
        moves: parameters and their changes, the largest first: shares of the value, or of the prior's standard deviation.
        relative: of each, whether it is a share of the value.
    """

    sd: float
    moves: tuple[tuple[str, float], ...]
    relative: tuple[bool, ...]

    @property
    def parts(self) -> tuple[tuple[str, str], ...]:
        """Each parameter with its change in words."""
        return tuple(
            (name, _share(move) if share else f"{move:+.2g} prior sd")
            for (name, move), share in zip(self.moves, self.relative, strict=True)
        )

    @property
    def words(self) -> str:
        """`X_u +25 %, X_uabsu -11 %`."""
        return ", ".join(f"{name} {size}" for name, size in self.parts)


@dataclass(frozen=True)
class Known:
    """What is known, before or after the data.

    Attributes:
        stage: `before` or `after`.
        structure: label of the structure.
        parameters: one by one.
        directions: together, what is known best first; empty where the model has no derivatives.
        verdict: sentences that name what is known although its parts are not, and what would separate them.
    """

    stage: str
    structure: str
    parameters: tuple[KnownParameter, ...]
    directions: tuple[Direction, ...]
    verdict: tuple[str, ...]

    def lines(self) -> list[str]:
        """A table, the directions known best and least, and the verdict."""
        before = self.stage == "before"
        rows = [
            (
                item.name,
                *([measured(item.value, item.sd, item.unit)] if before else []),
                item.known_to,
                percent(item.left),
                f"{item.correlation:+.3f} with {item.partner}" if item.partner else "-",
            )
            for item in self.parameters
        ]
        heads = ("", *(["expected"] if before else []), "known to", "of the prior's sd left", "strongest correlation")
        widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
        said = [
            "  ".join(
                text.ljust(width) if i in (0, len(heads) - 1) else text.rjust(width)
                for i, (text, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in (heads, *rows)
        ]
        if len(self.directions) > 1:
            said.append(f"one standard error of the data alone, at its smallest: {self.directions[0].words}")
            said.append(f"and at its largest: {self.directions[-1].words}")
        return [f"  {line}" for line in (*said, *(self.verdict or (BY_ITSELF,)))]


def known_after(campaign: Campaign, estimate: Estimate, trials: Trials) -> Known:
    """Judge a fit by the information of its data at the mode and the covariance of its draws; a current result is read."""
    store, label = Store(campaign.folder), estimate.structure.label
    path, key = store.known(label), key_of("known", _LAYOUT, estimate.key)
    if not is_current(path, key):
        posterior = build_posterior(campaign, estimate.structure, trials.fit)
        values = estimate.data["mode"].values
        information = likelihood_information(posterior, values)
        cov = np.atleast_2d(np.cov(estimate.draws().T))
        found = identify(posterior.parameters, values, information, cov=cov, at=campaign.hull.trim)
        write_stamped_json(path, asdict(_known(found, information, label)), key)
    return _read(read_json(path, f"seatrial estimate {campaign.folder}"))


def known_before(campaign: Campaign, sweep: Sweep) -> Known:
    """Judge the best design for the full structure at its prior means, sensors as rare as they are; a current result is read."""
    store, structure = Store(campaign.folder), campaign.full
    key = key_of("known", _LAYOUT, design_key(campaign))
    if not is_current(store.known_design, key):
        model, family = campaign.model(structure), campaign.family
        units = {term.text: model.unit_of(term) for term in model.coefficients}
        parameters = [
            Parameter(name, unit, CoefficientName.parse(name).label, campaign.prior(name))
            for name, unit in units.items()
        ]
        share = campaign.measured_mask(family.time()).mean(axis=0)
        noise = {
            channel: campaign.noise[channel] / float(np.sqrt(present))
            for channel, present in zip(campaign.channels, share, strict=True)
        }
        start = campaign.state_trim(model)
        found = identifiability_of_design(
            parameters, model, sweep.best_controls(), family.sample_time, start, noise, campaign.hull.trim
        )
        write_stamped_json(store.known_design, asdict(_known(found, None, structure.label)), key)
    return _read(read_json(store.known_design, f"seatrial design {campaign.folder}"))


def _known(found: Identifiability, information: np.ndarray | None, label: str) -> Known:
    parameters = []
    for i, name in enumerate(found.names):
        if is_deviation(name):  # its natural value is zero; the trial's own value is told with the estimates
            continue
        others = np.abs(found.correlation[i] * (np.arange(len(found.names)) != i))
        j = int(np.argmax(others))
        parameters.append(
            KnownParameter(
                name,
                found.units[i],
                float(found.values[i]),
                float(found.sd[i]),
                float(found.relative_sd[i]),
                float(found.contraction[i]),
                found.names[j] if j != i else "",
                float(found.correlation[i, j]) if j != i else 0.0,
            )
        )
    directions = () if information is None else _directions(found, information)
    return Known(found.stage, label, tuple(parameters), directions, tuple(found.cautions()))


def _directions(found: Identifiability, information: np.ndarray) -> tuple[Direction, ...]:
    """Eigenvectors of the information in shares of the values, or of prior standard deviations where these are near zero."""
    relative = np.abs(found.values) > 1e-6 * found.prior_sd
    scale = np.where(relative, found.values, found.prior_sd)
    scaled = information * np.outer(scale, scale)
    if not np.isfinite(scaled).all():
        return ()
    eigenvalues, vectors = np.linalg.eigh(scaled)
    said = []
    for value, vector in zip(eigenvalues[::-1], vectors.T[::-1], strict=True):
        if not value > 0:
            continue
        move = vector / np.sqrt(value)
        move = move * np.sign(move[np.argmax(np.abs(move))])
        order = [
            i
            for i in np.argsort(-np.abs(move))
            if abs(move[i]) > NAMED * np.abs(move).max() and not is_deviation(found.names[i])
        ]
        if not order:
            continue
        said.append(
            Direction(
                float(1 / np.sqrt(value)),
                tuple((found.names[i], float(move[i])) for i in order),
                tuple(bool(relative[i]) for i in order),
            )
        )
    return tuple(said)


def _read(content: dict[str, Any]) -> Known:
    return Known(
        content["stage"],
        content["structure"],
        tuple(KnownParameter(**item) for item in content["parameters"]),
        tuple(
            Direction(item["sd"], tuple((str(a), float(b)) for a, b in item["moves"]), tuple(item["relative"]))
            for item in content["directions"]
        ),
        tuple(content["verdict"]),
    )


def _share(move: float) -> str:
    return f"{100 * move:+.0f} %" if abs(move) >= 0.1 else f"{100 * move:+.2g} %"


_LAYOUT = [field.name for kind in (Known, KnownParameter, Direction) for field in fields(kind)]
