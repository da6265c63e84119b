"""The loop in ten lines: design, run, estimate, select, and what to run next. Usage: loop_in_ten_lines.py [FOLDER]."""

import sys
from pathlib import Path

import seatrial as st

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "outputs/ten_lines")
if not folder.exists():
    st.init_campaign(folder, "remus100")
campaign = st.load_campaign(folder)
designs = st.design_first(campaign)
trials = st.get_trials(campaign)
estimates = st.estimate_all(campaign, trials)
selection = st.select_structure(campaign, trials)
print("most informative:", designs.lines()[0])
print(estimates[selection.chosen].data[["mean", "sd"]].to_dataframe())
print(*selection.verdicts, sep="\n")
print(st.run_loop(campaign).summary.next_trial.words)
