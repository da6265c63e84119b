"""placeholder until the page is drawn"""


def write_report(outcome):
    return outcome.campaign.folder / "report.html"
