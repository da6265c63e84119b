"""A prior that excludes what the data say: refused, with what the check of the records finds wrong with them as the likely cause."""

from contextlib import suppress

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.data.check import likely_causes
from seatrial.core.errors import InputError, SeatrialError
from seatrial.estimation.diagnostics.prior_checks import NOT_NEEDED, prior_excluding_data
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.messages.render import remedy, sentences, statement


def check_prior_of(study: Study, posterior: Posterior, mode: Mode) -> None:
    """Check that the priors of a campaign contain what its records say; arguments as `prior_excluding_data`.

    Raises:
        InputError: naming the parameter, and first of its remedies what `seatrial check` finds, where a fault of a record may be the cause.
    """
    finding = prior_excluding_data(posterior, mode)
    if finding is None:
        return
    causes, advice = [], remedy(finding)
    if finding.remedies[0] not in NOT_NEEDED.values():  # no fault of a record makes a noise small, or a lag none
        with suppress(SeatrialError):  # of a record that cannot be judged nothing is added
            causes = sentences(likely_causes(study.campaign, study.records))
    if causes:
        advice = f"`seatrial check` finds a likely cause: {'. '.join(causes)}. If that is not it: {advice}"
    where = study.campaign.where_of_prior(f"prior.{finding.subject[0]}")
    raise InputError(where, found=statement(finding), expected="a prior that contains what the data say", remedy=advice)
