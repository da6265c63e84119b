"""Every shape of an open-loop input by its name in a campaign file."""

from seatrial.manoeuvres.shape import Shape
from seatrial.manoeuvres.steps import Steps
from seatrial.manoeuvres.waves import Chirp, Multisine

DOWN = (1.0, 0.6, 0.3, 0.1, 0.0, -0.1, -0.3, -0.6, -1.0)
SHAPES: dict[str, Shape] = {
    "step": Steps("the time away from trim", (1.0,), 1, "once"),
    "free-decay": Steps("the time for which the control is let go, downwards from trim", (-1.0,), 1, "once"),
    "turning-circle": Steps("the time for which the rudder is held", (1.0,), 1, "once"),
    "doublet": Steps("the doublet", (1.0, -1.0), 2, "once"),
    "repeated-doublet": Steps("one doublet", (1.0, -1.0), 2, "whole"),
    "multistep-3211": Steps("one pattern of 3-2-1-1", (1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0), 7, "whole"),
    "spiral": Steps("the time for which each angle is held", (*DOWN, *DOWN[-2::-1]), 1, "once"),
    "random-steps": Steps("the time for which each level is held", "uniform", 1, "cut"),
    "telegraph": Steps("the time after which the sign may change", "telegraph", 1, "cut"),
    "prbs": Steps("the clock of the sequence", "prbs", 1, "cut"),
    "multisine": Multisine("the longest wave", tuple(range(1, 11))),
    "chirp": Chirp("the longest wave, at the start", 8.0),
}
"""Every shape by its name in a campaign file."""
