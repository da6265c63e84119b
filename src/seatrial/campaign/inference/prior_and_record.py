"""A prior that excludes what the data say: refused, with what the check of the records finds wrong with them as the likely cause."""

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.data.check import likely_causes
from seatrial.core.errors import InputError, SeatrialError
from seatrial.estimation.diagnostics.prior_checks import check_prior_contains_data
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.messages.render import sentences


def check_prior_of(study: Study, posterior: Posterior, mode: Mode) -> None:
    """Check that the priors of a campaign contain what its records say; arguments as `check_prior_contains_data`.

    Raises:
        InputError: naming the parameter, and first of its remedies what `seatrial check` finds, where a fault of a record may be the cause.
    """
    try:
        check_prior_contains_data(posterior, mode, study.campaign.where_of_prior)
    except InputError as error:
        if "check" not in error.remedy:  # no fault of a record makes a noise small, or a lag none
            raise
        try:
            causes = sentences(likely_causes(study.campaign, study.records))
        except SeatrialError:  # of a record that cannot be judged nothing is added
            causes = []
        if not causes:
            raise
        remedy = f"`seatrial check` finds a likely cause: {'. '.join(causes)}. If that is not it: {error.remedy}"
        raise InputError(error.where, found=error.found, expected=error.expected, remedy=remedy) from None
