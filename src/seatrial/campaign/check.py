"""Judges a campaign's records before anything is fitted to them: direction, size, delay, outliers, holes and excitation."""

from dataclasses import dataclass

import numpy as np

from seatrial.campaign.belief import coefficient_priors
from seatrial.campaign.config import Campaign
from seatrial.campaign.problem import initial_state
from seatrial.campaign.record_checks import record_cautions
from seatrial.campaign.trials import Trials
from seatrial.core.record import Record
from seatrial.design.plan import TrialPlan
from seatrial.estimation.record_checks import Finding, check_excitation, check_motion, check_samples


@dataclass(frozen=True, eq=False)
class RecordJudgement:
    """What was found about one record.

    Attributes:
        record: it.
        findings: every check, also those that pass.
        cautions: holes and controls that never move.
    """

    record: Record
    findings: tuple[Finding, ...]
    cautions: tuple[str, ...]

    @property
    def level(self) -> str:
        """The gravest."""
        levels = {finding.level for finding in self.findings}
        return "fail" if "fail" in levels else "caution" if "caution" in levels or self.cautions else "pass"

    def lines(self) -> list[str]:
        """A headline, one line for each trouble, and what passes."""
        head = f"record {self.record.label}: {self.level}; {self.record.time.size} samples over {self.record.time[-1]:.1f} s"
        troubles = [f"  {finding.line}" for finding in self.findings if finding.level != "pass"]
        passed: dict[str, list[str]] = {}
        for finding in self.findings:
            if finding.level == "pass":
                passed.setdefault(finding.check, []).append(finding.signal)
        fine = "; ".join(f"{check} of {', '.join(signals)}" for check, signals in passed.items())
        cautions = [f"  caution {text}" for text in self.cautions]
        return [head, *troubles, *cautions, *((f"  pass    {fine}",) if fine else ())]


def check_records(campaign: Campaign, trials: Trials) -> list[RecordJudgement]:
    """Judge every record, fitted and held back; the vehicle at the prior means says what is expected."""
    return [_judge(campaign, record) for record in (*trials.fit, *trials.predict)]


def _judge(campaign: Campaign, record: Record) -> RecordJudgement:
    model = campaign.model(campaign.full)
    priors = coefficient_priors(campaign, model)
    mean = np.array([float(prior.mean) for prior in priors])
    step = np.append(np.diff(record.time), 0.0)
    control = np.column_stack([record.channel(name) for name in model.controls])
    measured = {name: record.channel(name) for name in campaign.channels}
    weight = np.column_stack([np.isfinite(column) / campaign.noise(name) for name, column in measured.items()])
    plan = TrialPlan(model, campaign.channels, np.array(initial_state(campaign, model, record)), step, weight)
    alone = TrialPlan(model, campaign.channels, plan.start, step, np.ones_like(weight))
    expected = np.asarray(alone.outputs(mean, control))
    findings = [
        finding for name, column in measured.items() for finding in check_samples(name, column, campaign.noise(name))
    ]
    if not np.isfinite(expected).all():
        remedy = "narrow the priors, so that the vehicle at their means can be simulated over this record"
        findings.append(
            Finding("motion", "direction", "caution", "the vehicle at the prior means runs away", "finite", remedy)
        )
        return RecordJudgement(record, tuple(findings), tuple(record_cautions(record)))
    usual = float(np.median(step[:-1]))
    for index, (name, column) in enumerate(measured.items()):
        findings += check_motion(name, usual, column, expected[:, index])
    before = np.array([float(prior.sd) for prior in priors])
    information = np.asarray(plan.information(mean, control))
    after = np.sqrt(np.diag(np.linalg.inv(information + np.diag(before**-2.0))))
    findings += check_excitation(plan.names, before, after)
    return RecordJudgement(record, tuple(findings), tuple(record_cautions(record)))
