"""Names of the samplers, apart from them so that a configuration is checked without loading any."""

from typing import Literal, get_args

SamplerName = Literal["independence-metropolis", "adaptive-metropolis", "metropolis", "de-metropolis", "nuts"]
DEFAULT: SamplerName = "independence-metropolis"
# Everything that draws from a posterior: the samplers by chains, and two by populations.
METHODS: tuple[str, ...] = (*get_args(SamplerName), "tempered-smc", "nested")
