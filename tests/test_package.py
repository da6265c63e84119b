import subprocess
import sys

import pytest

import seatrial


def test_import_loads_neither_jax_nor_pandas():
    code = "import sys, seatrial; print([name for name in ('jax', 'pandas', 'xarray', 'pint') if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


@pytest.mark.parametrize("name", seatrial.__all__)
def test_public_names_resolve(name):
    assert getattr(seatrial, name) is not None


def test_unknown_attribute():
    with pytest.raises(AttributeError, match="no attribute 'CoefficientNam'"):
        _ = seatrial.CoefficientNam
