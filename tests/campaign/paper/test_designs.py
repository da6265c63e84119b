import numpy as np
import pytest

from seatrial.campaign.paper.designs import ACTIVE, figure_3, ridges, sweep_paper
from seatrial.campaign.paper.reading import READINGS


def test_ridges_are_local_maxima_inside_the_grid():
    gain = np.array([1.0, 2.0, 3.0, 2.5, 2.0, 2.2, *np.linspace(2.3, 3.5, 14)])
    assert ridges(gain) == [3.0]


@pytest.mark.thorough
def test_figure_3():
    """The acceptance table's entropies and ridges, measured elsewhere."""
    sweeps = {name: sweep_paper(READINGS["A"], active) for name, active in ACTIVE.items()}
    gain = sweeps["medium"].gain
    assert [gain.min(), gain[-1, 9], gain.max()] == pytest.approx([21.582, 25.078, 25.249], abs=1e-3)
    assert [ridges(sweeps[name].gain[-1]) for name in ACTIVE] == [[6, 10], [8, 10, 13], [9, 11, 14, 19]]
    assert figure_3(READINGS["A"], sweeps).verdict == "reproduced in shape"
