"""What to write into a campaign file that says nothing of its trials, once one has been run or is to be simulated."""

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.store.stored_result import Store
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.estimation.priors import nominal


def no_record(campaign: Campaign) -> InputError:
    """Return the error of what needs a record in a campaign that has neither [import] nor [truth]: both, ready to paste."""
    store, log = Store(campaign.folder), "`seatrial inspect LOG --map`"
    schedule = store.schedule(store.design if campaign.own_schedule is None else store.own_design)
    first = "" if schedule.is_file() else f"design it with `seatrial design {campaign.folder}`, "
    return InputError(
        campaign.where("import"),
        found="neither [import] nor [truth], so there is no trial",
        expected="the log of a trial, or a vehicle to simulate",
        remedy=f"{first}run the trial of {schedule}, put its log into {campaign.folder}, and add to the file, as {log} prints it:\n"
        + _indented(import_example(campaign))
        + "\n  or, to simulate it, a value of each coefficient:\n"
        + _indented(truth_example(campaign)),
    )


def import_example(campaign: Campaign) -> str:
    """Return an [import] that maps every control and sensor of a campaign to a column of its name."""
    names = dict.fromkeys((*campaign.model(campaign.full).controls, *campaign.channels))
    columns = [f'channels.{name} = {{ column = "{name}", unit = "{shown_unit(name)[1]}" }}' for name in names]
    head = ["[import]", 'fit = ["1"]', "", "[[import.files]]", 'path = "log_{run}.csv"']
    return "\n".join([*head, 'time = { column = "time", unit = "s" }', *columns])


def truth_example(campaign: Campaign) -> str:
    """Return a [truth] at the nominal values of the coefficients by their priors, SI."""
    model = campaign.model(campaign.full)
    values = [(term.text, nominal(campaign.prior(term.text))) for term in model.coefficients]
    return "\n".join(["[truth]", *(f"{name} = {value:.4g}" for name, value in values)])


def _indented(text: str) -> str:
    """Return lines set in below a remedy."""
    return "\n".join(f"    {line}".rstrip() for line in text.splitlines())
