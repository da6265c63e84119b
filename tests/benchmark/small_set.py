"""A small set: the surge of the simulated vehicle, two short runs to fit and two held back."""

SURGE = """
[set]
name = "surge"
title = "Surge of a simulated vehicle"
vehicle = "simulated"
horizon = "5 s"

[source]
authors = "nobody"
where = "here"
version = "1"
licence = "none"
get = "Nothing is to be fetched."
cite = "nobody"

[made]
seed = 1

[made.runs]
a = { duration = "60 s", thrust = "30 N", rudder = "1 deg" }
b = { duration = "60 s", thrust = "60 N", rudder = "1 deg" }
c = { duration = "60 s", thrust = "40 N", rudder = "1 deg" }
d = { duration = "60 s", thrust = "50 N", rudder = "1 deg" }

[known]
X_uabsu = -0.35

[campaign]
name = "Surge"
seed = 3

[vehicle]
name = "simulated"
mass = "unknown"

[structure]
always = ["X_tau_X", "X_u", "X_uabsu"]

[prior]
X_tau_X = { distribution = "normal", mean = 0.0, sd = 0.1 }
X_u = { distribution = "normal", mean = 0.0, sd = 1.0 }
X_uabsu = { distribution = "normal", mean = 0.0, sd = 2.0 }
sigma_u = { distribution = "log-uniform", lower = 1e-3, upper = 0.5 }
tau_u = { distribution = "log-uniform", lower = 0.05, upper = 60.0 }

[sensors]
u = { noise = "0.01 m/s" }

[design]
control = "tau_X"
trim = "0 N"
duration = "60 s"
active = "50 s"
sample_time = "0.2 s"
amplitude = { from = "5 N", to = "25 N", points = 5 }
period = { from = "5 s", to = "40 s", points = 5 }

[estimation]
initial = "measured"
residuals = "coloured"

[import]
fit = ["a", "b"]
predict = ["c", "d"]
step = "0.2 s"

[[import.files]]
path = "{run}.csv"
time = { column = "t", unit = "s" }

[import.files.channels]
tau_X = { column = "tau_X", unit = "N" }
u = { column = "u", unit = "m/s" }
"""


def write_set(folder, **replaced):
    """Write the set with some of its text replaced; returns its path. Keys are of no meaning, values are pairs."""
    text = SURGE
    for old, new in replaced.values():
        assert old in text
        text = text.replace(old, new)
    path = folder / "surge.toml"
    path.write_text(text, encoding="utf-8")
    return path
