"""The exporters by the name that `--to` takes."""

from collections.abc import Callable
from typing import Any

from seatrial.core.errors import InputError, nearest
from seatrial.export.target import Exporter
from seatrial.export.targets.fossen import Fossen
from seatrial.export.targets.gz import Gz
from seatrial.export.targets.holoocean import HoloOcean
from seatrial.export.targets.own_json import OwnJson
from seatrial.export.targets.stonefish import Stonefish
from seatrial.export.targets.table import Table
from seatrial.export.targets.uuv import Uuv

EXPORTERS: dict[str, Callable[..., Exporter]] = {
    "gz": Gz,
    "uuv": Uuv,
    "stonefish": Stonefish,
    "fossen": Fossen,
    "holoocean": HoloOcean,
    "json": OwnJson,
    "csv": Table,
}
"""In the order in which they are listed."""


def make_exporter(name: str, **options: Any) -> Exporter:
    """Build an exporter; options that are None keep the target's own.

    Raises:
        InputError: no target of that name, or an option that it does not have.
    """
    if name not in EXPORTERS:
        raise InputError(
            f"--to {name}",
            found=f'"{name}"',
            expected="one of " + ", ".join(EXPORTERS),
            remedy=nearest(name, EXPORTERS),
        )
    given = {key: value for key, value in options.items() if value is not None}
    fields = set(EXPORTERS[name].__dataclass_fields__) - {"name", "target"}  # pyright: ignore[reportFunctionMemberAccess]
    for key in given:
        if key not in fields:
            raise InputError(
                f"--{key}",
                found=f"--to {name}",
                expected="a target that has this option: "
                + ", ".join(other for other, one in EXPORTERS.items() if key in one.__dataclass_fields__),  # pyright: ignore[reportFunctionMemberAccess]
                remedy=f"leave --{key} out",
            )
    return EXPORTERS[name](**given)
