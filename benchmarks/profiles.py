"""Mode and profile likelihoods of the paper's four parameters: ours against pyPESTO, which begins at the middle of the priors."""

import jax
import numpy as np
from paper_problem import Problem, paper_problem
from timing import Ratio, Row, agree, processor_seconds, row
from tools import ask, later_process

import seatrial as st
from seatrial.estimation.posterior.mode import Mode, find_mode
from seatrial.estimation.posterior.profile import profile_likelihood
from seatrial.estimation.posterior.profile_result import DROP, Profile

GROUP, UNIT = "mode and profiles, paper's posterior", "processor s"
AGREED = 0.005
"""Standard deviations by which the ends of the intervals may differ."""


def seconds(cores: int) -> list[Row | Ratio]:
    """Return processor seconds of both: again, the first time in a process, and for ours with programs that another process kept."""
    problem = paper_problem()
    (mode, profiles), first, again = processor_seconds(lambda: profiled(problem), 5)
    kept = later_process("profiles.py")
    peer = ask("peer_pypesto.py", problem.plain | {"drop": DROP}, {})
    ends = np.array([[one.lower, one.upper] for one in profiles]) / mode.sd[:, None]
    theirs = np.array([peer["ends"][one.name] for one in profiles]) / mode.sd[:, None]
    agree("ends of profiles of seatrial and pyPESTO, in standard deviations,", ends, theirs, AGREED)
    name, peer_again = f"pyPESTO {peer['version']}", np.array(peer["again"])
    return [
        row(GROUP, "seatrial", cores, UNIT, again, 1.0),
        row(GROUP, name, cores, UNIT, peer_again, 1.0),
        Row(GROUP, "seatrial, first run", cores, UNIT, first, first),
        Row(GROUP, "seatrial, first run in a later process", cores, UNIT, kept, kept),
        Row(GROUP, f"{name}, first run", cores, UNIT, peer["first"], peer["first"]),
        Ratio(GROUP, f"{name} / seatrial", cores, peer_again.min() / again.min(), at_least=1),
        Ratio(GROUP, f"{name} / seatrial, first run", cores, peer["first"] / first, at_least=1),
        Ratio(GROUP, f"{name} / seatrial, later process", cores, peer["first"] / kept, at_least=1),
    ]


def profiled(problem: Problem) -> tuple[Mode, tuple[Profile, ...]]:
    """Return what `seatrial profile` computes."""
    mode = find_mode(problem.posterior, key=jax.random.key(0))
    return mode, profile_likelihood(problem.posterior, mode)


def main() -> None:
    """Print the processor seconds of one answer."""
    st.configure()
    problem = paper_problem()
    print(processor_seconds(lambda: profiled(problem), 0)[1])


if __name__ == "__main__":
    main()
