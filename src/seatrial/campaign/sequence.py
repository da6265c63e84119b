"""Trial after trial on a simulated vehicle, each decided on what those before have taught, until the goal is met."""

from seatrial.campaign.config import Campaign
from seatrial.campaign.loop import Outcome, run_loop
from seatrial.campaign.proposal import Proposal, propose
from seatrial.campaign.simulated import add_trial
from seatrial.campaign.watch import SILENT, Watch


def run_sequence(campaign: Campaign, watch: Watch = SILENT) -> tuple[Outcome, Proposal]:
    """Run the loop, and while it is a simulated campaign with a goal run what it proposes; a kill loses the work in flight.

    Returns:
        what was found after the last trial, and what to do next.
    """
    while True:
        outcome = run_loop(campaign, watch)
        proposal = propose(outcome)
        goal = campaign.goal
        if not campaign.is_simulated or goal is None or proposal.trial is None:
            return outcome, proposal
        for line in proposal.lines:
            watch.say(line)
        if len(outcome.trials.fit) >= goal.trials:
            end = f"stop: {goal.trials} trial{'s are' if goal.trials != 1 else ' is'} run, the most that [goal] allows"
            return outcome, Proposal(None, (proposal.lines[0], end))
        add_trial(campaign, proposal.trial)
