"""Work of a few milliseconds for tests of workers: nothing here imports JAX."""

import time

from seatrial.core.errors import InputError, NumericalError


def power(shared, item, report):
    """`shared` to the power of an item; items below 0 fail."""
    report(1, 2)
    if item == -1:
        raise InputError("here", found="-1", expected="0 or more", remedy="another")
    if item == -2:
        raise NumericalError("it diverges")
    if item == -3:
        raise ZeroDivisionError("a mistake of ours")
    return shared**item


def slowly(shared, item, report):
    """An item after a while, with reports on the way."""
    for i in range(6):
        time.sleep(shared / 6)
        report(i, 6)
    return item


def mute():
    """What a process answers that cannot import seatrial."""
    raise ModuleNotFoundError("No module named 'seatrial'")
