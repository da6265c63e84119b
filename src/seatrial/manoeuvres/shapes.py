"""Every shape of an open-loop input by its name in a campaign file."""

from seatrial.manoeuvres.shape import Shape
from seatrial.manoeuvres.steps import Steps
from seatrial.manoeuvres.waves import Chirp, Multisine

DOWN = (1.0, 0.6, 0.3, 0.1, 0.0, -0.1, -0.3, -0.6, -1.0)
SHAPES: dict[str, Shape] = {
    "step": Steps("time away from trim", (1.0,), 1, "once"),
    "free-decay": Steps("time away from trim", (-1.0,), 1, "once"),
    "turning-circle": Steps("time of the turn", (1.0,), 1, "once"),
    "doublet": Steps("period", (1.0, -1.0), 2, "once"),
    "repeated-doublet": Steps("period", (1.0, -1.0), 2, "whole"),
    "multistep-3211": Steps("period of the pattern", (1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0), 7, "whole"),
    "spiral": Steps("time at each angle", (*DOWN, *DOWN[-2::-1]), 1, "once"),
    "random-steps": Steps("time at each level", "uniform", 1, "cut"),
    "telegraph": Steps("time at each level", "telegraph", 1, "cut"),
    "prbs": Steps("clock of the sequence", "prbs", 1, "cut"),
    "multisine": Multisine("longest wave", tuple(range(1, 11))),
    "chirp": Chirp("first wave", 8.0),
}
"""Every shape by its name in a campaign file."""
