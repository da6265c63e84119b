"""Where a run may end."""

ROUNDED = 1e-5
"""Share of a length by which it may be rounded up where it is printed."""


def is_beyond(end: float, available: float) -> bool:
    """Return whether an end lies after what the files of a run have in common, not by rounding alone.

    Args:
        end: s from where they overlap.
        available: how long they overlap, s.
    """
    return end > available * (1 + ROUNDED)
