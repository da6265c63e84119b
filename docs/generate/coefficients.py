"""The page of the grammar of coefficient names, from the code that reads them."""

from seatrial.core.coefficients import AXES, CoefficientName
from seatrial.core.signals import RATES, SIGNALS

EXAMPLES = (
    "X_0", "X_u", "X_uabsu", "X_uu", "X_u3", "X_du3", "X_udot", "X_vr", "X_tau_X", "T_nabsn", "T_absnu", "Q_nabsn",
    "T_f", "T_fdV", "T_uabsf",
    "Y_v", "Y_vabsv", "Y_ur", "Y_uv", "Y_uudelta_r", "Y_vdot", "Z_w", "Z_uw", "Z_uq", "Z_uudelta_s", "K_p", "K_pabsp",
    "M_q", "M_uq", "M_uw", "M_uudelta_s", "M_qdot", "N_r", "N_rabsr", "N_ur", "N_uv", "N_uudelta_r", "N_tau_N",
)  # fmt: skip
INTRODUCTION = """# Coefficient names

A coefficient's name is its equation: the axis, an underscore, and the signals it multiplies.

| part | written | means |
|---|---|---|
| axis | `X_` `Y_` … | the force or moment, from the table below |
| signal | `u`, `delta_r` … | a factor, from the table below |
| modulus | `abs` before a signal | its magnitude: `X_uabsu` multiplies u\\|u\\| |
| change | `d` before a signal | its change from trim: `X_du3` multiplies (u - u_trim)^3 |
| derivative | `dot` after a velocity | added mass: `X_udot` multiplies du/dt |
| power | a digit from 2 to 9 | `X_u3` multiplies u^3 |
| constant | `0` alone | `X_0` is a constant force |

Names follow SNAME, *Nomenclature for Treating the Motion of a Submerged Body Through a Fluid* (1950), in the form that
T. I. Fossen uses, *Handbook of Marine Craft Hydrodynamics and Motion Control*, 2nd ed. (2021). The page is written from
`seatrial.core.coefficients`; a name that cannot be read is refused with a mark under its first wrong character.
"""


def page() -> str:
    """Axes, signals, and common names with what they multiply."""
    parts = [INTRODUCTION, "## Axes", "", "| axis | is | SI unit |", "|---|---|---|"]
    parts += [f"| `{name}` | {meaning} | {unit} |" for name, (unit, meaning) in AXES.items()]
    parts += ["", "## Signals", "", "| signal | is | SI unit | `dot` |", "|---|---|---|---|"]
    parts += [
        f"| `{name}` | {signal.meaning} | {signal.dimension} | {'yes' if name in RATES else ''} |"
        for name, signal in SIGNALS.items()
    ]
    parts += [
        "",
        "## Common names",
        "",
        "| name | printed | force or moment is the coefficient times | SI unit |",
        "|---|---|---|---|",
    ]
    for text in EXAMPLES:
        name = CoefficientName.parse(text)
        product = " ".join(factor.label for factor in name.factors) or "1"
        parts.append(f"| `{text}` | {_math(name.label)} | {_math(product)} | {name.unit} |")
    return "\n".join([*parts, ""])


def _math(tex: str) -> str:
    return "$" + tex.replace("|", r"\vert ") + "$"
