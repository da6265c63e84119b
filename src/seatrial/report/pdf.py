"""A Matplotlib figure as a PDF file for an article: fonts embedded as outlines that journals accept, no date, the same bytes each time."""

import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_pdf(figure: "Figure") -> bytes:
    """Draw a figure as a PDF file, in the light palette, its text embedded as TrueType."""
    import matplotlib

    stream = io.BytesIO()
    with matplotlib.rc_context({"pdf.fonttype": 42}):
        figure.savefig(
            stream, format="pdf", transparent=True, metadata={"CreationDate": None, "Creator": None, "Producer": None}
        )
    return stream.getvalue()
