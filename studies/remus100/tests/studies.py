"""Studies for tests: the paper's vehicle with samples as small as each part allows."""

from pathlib import Path

from studies.remus100.reading import READINGS, Reading
from studies.remus100.registry import PARTS
from studies.remus100.study import Sizes, Study

A, B = READINGS["A"], READINGS["B"]
TINY = Sizes(
    filter_seeds=8,
    tuning_seeds=4,
    burn_in=500,
    draws=1000,
    listing_repeats=3,
    listing_shared=2,
    listing_draws=2000,
    data_seeds=1,
    smc_particles=64,
    nested_live=50,
)


def study(folder: Path, sizes: Sizes = TINY, reading: Reading = A) -> Study:
    """A study with the real parts."""
    return Study(folder, reading, sizes, PARTS)
