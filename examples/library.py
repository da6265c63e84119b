"""seatrial as a library, without a folder: simulate a trial, fit it, predict another, weigh two models, design the next one.

Usage: `python examples/library.py`; under a minute.
"""

import numpy as np

import seatrial as st

RPM = 2 * np.pi / 60
START, RATES, NOISE = {"u": 1.5}, {"u": 5.0}, {"u": 0.02}


def main() -> None:
    """Find out whether a REMUS 100 has linear drag, from one trial of a minute less a third."""
    st.configure()
    vehicle = st.load_vehicle("remus100_surge")
    full = vehicle.build(free=["X_u", "X_uabsu", "T_nabsn"])
    truth = {**vehicle.coefficients, "X_u": -6.0, "sigma_u": NOISE["u"]}
    family = st.Family("n", 1200 * RPM, duration=40.0, active=30.0, sample_time=0.05, kind="doublet")
    first, second = (
        st.simulate(full, truth, family.schedule(amplitude * RPM, period), ["u"], start=START, rates=RATES, key=seed)
        for amplitude, period, seed in ((200, 10.0, 1), (-150, 15.0, 2))
    )

    priors = {
        "X_u": st.Uniform(-20.0, 0.0),
        "X_uabsu": st.half_normal(20.0, upper=0.0),
        "T_nabsn": st.LogNormal(6e-4, 1.5),
        "sigma_u": st.LogUniform(0.002, 0.2),
    }
    posterior = st.make_posterior(full, first, priors, start=START)
    print(st.error_budget(posterior, st.find_mode(posterior, key=1), st.StatedErrors(inertia=0.02)))
    draws = st.sample(posterior, settings=st.ChainSettings(chains=16, warmup=400, draws=800))
    print(draws)
    explained = st.predict(posterior, draws, second, start=START).score("u").explained
    print(f"of the second trial's variance {explained:.0%} was predicted")

    simple = vehicle.without("X_u").build(free=["X_uabsu", "T_nabsn"])
    without = {name: prior for name, prior in priors.items() if name != "X_u"}
    rival = st.make_posterior(simple, first, without, start=START)
    size = st.EvidenceSettings(repeats=2, smc=st.SMCSettings(particles=256))
    print(st.compare({"with X_u": posterior, "without": rival}, settings=size))

    amplitudes, periods = np.linspace(100, 300, 5) * RPM, [5.0, 10.0, 15.0, 20.0]
    problem = st.make_design_problem(full, draws, family, amplitudes, periods, NOISE, start=START, rates=RATES)
    design = st.design_trial(problem)
    print(f"next: {design}")
    assert draws.findings() == []
    assert all(abs(draws[name].mean() - truth[name]) < 4 * draws[name].std() for name in draws.names)
    assert explained > 0.9
    assert all(design.sd_after[name] < sd for name, sd in design.sd_before.items())


if __name__ == "__main__":
    main()
