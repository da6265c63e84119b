"""How often is the right structure simulated? `python docs/shortlists.py [--records N]`, or `--redraw`.

Vehicles with eight terms in question have 256 structures, of which a campaign simulates the six that its screening finds most probable.
As in `term_probabilities.py` the priors decide which terms a vehicle has, and a plain loop simulates it with white noise; a campaign
screens its records. It is counted whether the true structure is among the six; if it is not, its evidence is compared with the best of
theirs. What is done is kept in outputs/shortlists. Writes docs/dev/shortlists.json and the table in docs/dev/shortlists.md.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import plain_vehicles
import study_numbers
from term_probabilities import ARMS, SURGE, THREE_AXES, Arm, masked, vehicle

import seatrial as st
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.campaign.selection.screening import screen_terms, with_shortlist
from seatrial.core.errors import InputError
from seatrial.core.files import write_text
from seatrial.estimation.diagnostics.error_evidence import log_evidence_gains
from seatrial.estimation.diagnostics.error_sources import StatedErrors

STATE = Path(__file__).parents[1] / "outputs" / "shortlists"
NAMES = {"S": "surge", "T": "three axes"}
SURGE_TERMS = {
    "X_u4": st.Normal(-0.2, 0.12),
    "T_n": st.Normal(0.02, 0.012),
    "T_uun": st.Normal(-0.005, 0.003),
    "T_unn": st.Normal(-6e-5, 4e-5),
}
TURNING_TERMS = {
    "X_v2": st.Normal(-20.0, 12.0),
    "Y_v": st.Normal(-25.0, 15.0),
    "N_r": st.Normal(-6.0, 4.0),
    "N_vabsv": st.Normal(-20.0, 12.0),
}
WIDER = {
    "S": ARMS["A"]._replace(family=SURGE._replace(optional={**SURGE.optional, **SURGE_TERMS})),
    "T": ARMS["F"]._replace(family=THREE_AXES._replace(optional={**THREE_AXES.optional, **TURNING_TERMS})),
}
"""Vehicles with eight terms in question."""
BODIES = {
    "S": 'catalogue = "remus100_surge"',
    "T": f"""mass = "{plain_vehicles.MASS} kg"
inertia = {json.dumps(3 * [f"{plain_vehicles.INERTIA} kg m^2"])}
centre_of_gravity = ["{plain_vehicles.CENTRE} m", "0 m", "0 m"]
thrust_deduction = {plain_vehicles.DEDUCTION}
moves = ["u", "v", "r"]
fixed = {{ {", ".join(f"{name} = {value}" for name, value in plain_vehicles.ADDED.items())} }}""",
}
"""Of the campaign files, the lines under `[vehicle]`."""


def campaign_of(arm: str) -> Campaign:
    """Return the campaign of an arm's vehicles, with all that the study takes for known."""
    family, folder = WIDER[arm].family, STATE / arm
    noises = {name: prior for name, prior in family.nuisances.items() if name.startswith("sigma")}
    priors = {**family.always, **family.optional, **noises}
    lines = [f'[campaign]\nname = "{NAMES[arm]}"\nseed = 1\n\n[vehicle]\n{BODIES[arm]}\n\n[structure]']
    lines += [f"{key} = {json.dumps(list(getattr(family, key)))}" for key in ("always", "optional")]
    for name, prior in priors.items():
        normal = isinstance(prior, st.Normal)
        numbers = {"mean": prior.mean, "sd": prior.sd} if normal else {"lower": prior.lower, "upper": prior.upper}
        lines += [f'\n[prior.{name}]\ndistribution = "{"normal" if normal else "log-uniform"}"']
        lines += [f"{key} = {value}" for key, value in numbers.items()]
    units = {one.name: one.unit for one in family.channels}
    lines += [f'\n[sensors.{name}]\nnoise = "{noise} {units[name]}"' for name, noise in family.noise.items()]
    channels = ", ".join(f'{name} = {{ column = "{name}", unit = "{unit}" }}' for name, unit in units.items())
    lines += ['\n[estimation]\ninitial = "estimated"\n\n[import]\nfit = ["1"]\n\n[[import.files]]\npath = "log.csv"']
    lines += [f'time = {{ column = "t", unit = "s" }}\nchannels = {{ {channels} }}\n']
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "campaign.toml", "\n".join(lines))
    return load_campaign(folder)


def judge(campaign: Campaign, arm: Arm, seed: str, number: int) -> dict:
    """Return whether the truth of a vehicle is on the shortlist, the probability of the list, and the evidence lost if it is not."""
    optional = list(arm.family.optional)
    try:
        present, records = vehicle(arm, seed, number)
        trials = Trials(tuple(records), (), f"{seed} {number}")
        structures = with_shortlist(campaign, trials).shortlist
    except InputError:  # the records do not separate the terms, or the motion diverges
        return {"listed": None, "covered": 0.0, "lost": None}
    listed = [[one in structure.terms for one in optional] for structure in structures]
    screened = screen_terms(campaign, trials).data["probability"].values[: len(listed)]
    is_listed = present in listed
    lost = None if is_listed else evidence_lost(campaign, optional, [*listed, present], records)
    return {"listed": is_listed, "covered": float(screened.sum()), "lost": lost}


def evidence_lost(campaign: Campaign, optional: list[str], sets: list[list[bool]], records: list[st.Record]) -> float:
    """Return the log evidence, with every error, of the best of some structures less that of the last, which is the true one."""
    whole = build_posterior(campaign, campaign.full, records)
    posteriors = masked(whole, optional, sets)
    near = st.find_mode(whole, key=1).by_name
    modes = [st.find_mode(one, key=1, starts=16, tries=1, near=near) for one in posteriors]
    gains = log_evidence_gains(posteriors, modes, StatedErrors())
    *others, true = [mode.log_evidence + gain for mode, gain in zip(modes, gains or [0.0] * len(modes), strict=True)]
    return max(others) - true


def main() -> None:
    """Simulate and judge what is not done yet, and write numbers and table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--redraw", action="store_true", help="only write the table again from the numbers")
    asked = parser.parse_args()
    if not asked.redraw:
        st.configure()
        for number in range(asked.records):
            for name in NAMES:
                judge_next(name, number)
        study_numbers.keep("shortlists", {name: counted(done(name)) for name in NAMES})
    study_numbers.show("shortlists", tables(study_numbers.kept("shortlists")))


def judge_next(name: str, number: int) -> None:
    """Judge a vehicle if that is not done yet."""
    if number == len(rows := done(name)):
        new = judge(campaign_of(name), WIDER[name], name, number)
        write_text(STATE / f"{name}.json", json.dumps([*rows, new]))


def done(name: str) -> list[dict]:
    """Return what is known of the vehicles of an arm."""
    path = STATE / f"{name}.json"
    return json.loads(path.read_text()) if path.exists() else []


def counted(rows: list[dict]) -> dict:
    """Return how often the truth is on the shortlist, with the error of a binomial share, and the evidence lost if it is not."""
    count, rows = len(rows), [row for row in rows if row["listed"] is not None]
    share = float(np.mean([row["listed"] for row in rows]))
    lost = np.array([row["lost"] for row in rows if not row["listed"]])
    return {
        "vehicles": len(rows),
        "refused": count - len(rows),
        "listed": sum(row["listed"] for row in rows),
        "share": [share, float(np.sqrt(share * (1 - share) / len(rows)))],
        "covered": float(np.mean([row["covered"] for row in rows])),
        "better": int((lost < 0).sum()),
        "lost": [float(one) for one in np.quantile(lost, [0.0, 0.5, 1.0])] if lost.size else None,
    }


def tables(found: dict) -> str:
    """Return the table of the page."""
    text = "| vehicle | screened | refused | truth among the six | expected by the screening | best of the six less the truth, nats "
    text += "| truth better than all six |\n|---|---|---|---|---|---|---|\n"
    for name, words in NAMES.items():
        one = found[name]
        share, error = one["share"]
        lost = "" if one["lost"] is None else "median {1:.1f} ({0:.1f} to {2:.1f})".format(*one["lost"])
        text += f"| {words} | {one['vehicles']} | {one['refused']} | {one['listed']}: {100 * share:.0f} ± {100 * error:.0f} % "
        text += f"| {100 * one['covered']:.0f} % | {lost} | {one['better']} |\n"
    return text


if __name__ == "__main__":
    main()
