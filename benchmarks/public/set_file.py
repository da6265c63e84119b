"""A set of the benchmark as a file: whose records they are, the hash of each file, and the campaign that is fitted to some of their runs.

A set file is a campaign file with a few tables more. Its paths are relative to the data folder and stay below it; each file that
`[import]` names stands in `[files]` with the SHA-256 of its content. A file may lie there compressed, with `.gz` behind its name.
"""

import gzip
import hashlib
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated

import tomlkit
from pydantic import Field

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.quantities import Name, Quantity, Table
from seatrial.campaign.config.schema import CampaignFile
from seatrial.campaign.config.templates import example_of
from seatrial.campaign.config.toml import FileKeys, parse_toml, read_text
from seatrial.campaign.store.stored_result import FILE_NAME
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.files import depend_on, write_text

SETS = Path(__file__).parent / "sets"
_PIECE = 1 << 20
_PLAIN = 200
"""Characters of a path."""

Text = Annotated[str, Field(min_length=1, max_length=2000)]
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class SetTable(Table):
    """`[set]`: its name, which names a folder of results, a title, the vehicle, and the short horizon of its tasks."""

    name: str = Field(pattern="^[a-z][a-z0-9_]{0,39}$")
    title: Name
    vehicle: Name
    horizon: Quantity = "10 s"


class SourceTable(Table):
    """`[source]`: who measured, where the records are kept and in which version, their licence, how to get and how to cite them."""

    authors: Text
    where: Text
    version: Text
    licence: Text
    get: Text
    cite: Text


class MadeTable(Table):
    """`[made]`: runs of the simulated vehicle of `benchmarks.public.simulated`, by name, with the seed of waves and noise.

    Each run has a `duration`, and the largest `thrust` and `rudder` of its steps.
    """

    seed: int = Field(ge=0, lt=2**63)
    runs: dict[str, "MadeRunTable"] = Field(min_length=2, max_length=100)


class MadeRunTable(Table):
    """`[made.runs.RUN]`: how long it lasts, and the largest thrust and rudder angle of its steps."""

    duration: Quantity
    thrust: Quantity
    rudder: Quantity


MadeTable.model_rebuild()


class SetFile(CampaignFile):
    """The whole file: `[set]`, `[source]`, `[files]`, `[made]` and `[known]`, and the tables of a campaign file.

    `[known]` holds coefficients that are known from elsewhere, by name, in SI.
    """

    set: SetTable
    source: SourceTable
    files: dict[str, Sha256] = Field(default_factory=dict)
    made: MadeTable | None = None
    known: dict[str, float] = Field(default_factory=dict)


OWN_TABLES = ("set", "source", "files", "made", "known")
"""Tables that a campaign file does not have."""


@dataclass(frozen=True)
class BenchmarkSet:
    """One set.

    Attributes:
        name: of the set and its folder of results.
        path: of its file.
        title: in headings.
        vehicle: in words.
        horizon: length of the short predictions, s.
        source: `authors`, `where`, `version`, `licence`, `get` and `cite`, in words.
        files: SHA-256 of the content of each, by path below the data folder.
        known: coefficients that are known from elsewhere, SI.
        made: how its runs are simulated; None of measured ones.
        text: of the file.
        fit: runs that are fitted.
        held_back: runs that are predicted.
    """

    name: str
    path: Path
    title: str
    vehicle: str
    horizon: float
    source: Mapping[str, str]
    files: Mapping[str, str]
    known: Mapping[str, float]
    made: MadeTable | None
    text: str
    fit: tuple[str, ...]
    held_back: tuple[str, ...]


def set_names() -> tuple[str, ...]:
    """Return the names of the sets that are kept here."""
    return tuple(sorted(one.stem for one in SETS.glob("*.toml")))


def read_set(name: str) -> BenchmarkSet:
    """Read a set by its name, or from a file of one's own.

    Args:
        name: of a set that is kept here, or the path of a set file, which ends in `.toml`.

    Raises:
        InputError: no such set; malformed TOML; an unknown or missing key; a path that leaves the data folder, or a file without a hash.
    """
    path = Path(name)
    if not name.endswith(".toml"):
        if name not in set_names():
            raise InputError(
                f'set "{name}"',
                found="no such set",
                expected="one of " + ", ".join(set_names()) + ", or the path of a set file",
                remedy=nearest(name, set_names()),
            )
        path = SETS / f"{name}.toml"
    elif not path.is_file():
        raise InputError(
            str(path), found="no such file", expected="a set file", remedy="correct the path, or name a set of the list"
        )
    text = read_text(path)
    file, keys = parse_toml(path, text, SetFile, example_of), FileKeys(path, text)
    if file.imported is None or not file.imported.predict:
        raise InputError(
            keys.where("import.predict"),
            found="no run that is held back",
            expected="runs to fit and runs to predict",
            remedy="name them under `fit` and `predict` of [import]",
        )
    if file.vehicle.priors_from or "compute" in file.model_fields_set:
        raise InputError(
            keys.where("compute" if "compute" in file.model_fields_set else "vehicle.priors_from"),
            found="a setting that belongs to one machine",
            expected="a set that gives the same result on every machine",
            remedy="remove it",
        )
    terms = (*file.structure.always, *file.structure.optional)
    for name in file.known:
        if name not in terms:
            raise InputError(
                keys.where(f"known.{name}"),
                found=f'"{name}"',
                expected="a term of [structure]: " + ", ".join(terms),
                remedy=nearest(name, terms),
            )
    _check_paths(file, keys)
    return BenchmarkSet(
        file.set.name,
        path,
        file.set.title,
        file.set.vehicle,
        keys.si(file.set.horizon, "s", "set.horizon"),
        file.source.model_dump(),
        file.files,
        file.known,
        file.made,
        text,
        tuple(file.imported.fit),
        tuple(file.imported.predict),
    )


def campaign_of(benchmark_set: BenchmarkSet, data: Path, folder: Path) -> Campaign:
    """Write the campaign of a set into a folder and read it; its paths lead into the data folder, whose files are checked.

    Args:
        benchmark_set: the set.
        data: folder of its files.
        folder: of the campaign and its results.

    Raises:
        InputError: a file that is missing or of another hash, or a campaign that cannot be read.
    """
    places = {path: check_file(benchmark_set, data, path) for path in benchmark_set.files}
    document = tomlkit.parse(benchmark_set.text)
    for table in OWN_TABLES:
        document.pop(table, None)
    for file in document["import"]["files"]:  # pyright: ignore[reportGeneralTypeIssues, reportIndexIssue]
        file["path"] = _written(file["path"], benchmark_set, places, data)
        for column in file["channels"].values():
            if "curve" in column:
                column["curve"] = _written(column["curve"], benchmark_set, places, data)
    text = f"# The campaign of the benchmark's set {benchmark_set.name}.\n" + tomlkit.dumps(document).lstrip("\n")
    path = folder / FILE_NAME
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)
    with located(str(benchmark_set.path)):
        return load_campaign(folder)


def check_file(benchmark_set: BenchmarkSet, data: Path, path: str) -> Path:
    """Return where a file of a set lies, which may be compressed.

    Raises:
        InputError: it is missing, lies outside the data folder, or its content has another hash than the set says.
    """
    place = next((one for one in (data / path, data / f"{path}.gz") if one.is_file()), None)
    if place is None:
        raise InputError(
            str(data / path),
            found="no such file",
            expected=f'a file of the set "{benchmark_set.name}", plain or with .gz behind its name',
            remedy=f"{benchmark_set.source['get']} Licence: {benchmark_set.source['licence']}.",
        )
    if not place.resolve().is_relative_to(data.resolve()):
        raise InputError(
            str(place),
            found=f"a link to {place.resolve()}",
            expected=f"a file below {data}",
            remedy="copy the file there",
        )
    digest = _sha256_of_content(place)
    if digest != benchmark_set.files[path]:
        raise InputError(
            str(place),
            found=f"SHA-256 {digest}",
            expected=f'SHA-256 {benchmark_set.files[path]}, as the set "{benchmark_set.name}" says',
            remedy=f"get the file again in version {benchmark_set.source['version']}: {benchmark_set.source['get']}",
        )
    return place


def _check_paths(file: SetFile, keys: FileKeys) -> None:
    """Check that paths are plain and stay below the data folder, and that each file of a run has a hash, unless runs are made."""
    assert file.imported is not None
    for path in file.files:
        _check_plain(path, keys.where("files"))
    for index, log in enumerate(file.imported.files):
        named = [(f"import.files[{index}].path", log.path)]
        named += [
            (f"import.files[{index}].channels.{name}.curve", column.curve)
            for name, column in log.channels.items()
            if column.curve is not None
        ]
        for key, path in named:
            _check_plain(path, keys.where(key))
            for run in (*file.imported.fit, *file.imported.predict):
                if file.made is None and (one := path.replace("{run}", run)) not in file.files:
                    raise InputError(
                        keys.where(key),
                        found=f'"{one}", of which [files] holds no hash',
                        expected="a file of the set",
                        remedy=f'add "{one}" = "its SHA-256" to [files]; `sha256sum` prints it',
                    )


def _check_plain(path: str, where: str) -> None:
    parts = PurePosixPath(path).parts
    if not path or len(path) > _PLAIN or path.startswith("/") or ".." in parts or set(path) & set("\\$~:"):
        raise InputError(
            where,
            found=f'"{path[:_PLAIN]}"',
            expected="a path below the data folder",
            remedy="write it relative to that folder, with / between its parts",
        )


def _written(path: str, benchmark_set: BenchmarkSet, places: Mapping[str, Path], data: Path) -> str:
    """Return a path of `[import]` as the campaign names it; the files of all runs are compressed, or none of them."""
    runs = (*benchmark_set.fit, *benchmark_set.held_back)
    lie = {
        places[one].name.endswith(".gz") and not one.endswith(".gz")
        for run in runs
        if (one := path.replace("{run}", run)) in places
    }
    if len(lie) > 1:
        raise InputError(
            str(data / path),
            found="some compressed files and some plain ones",
            expected="all of them, or none",
            remedy="compress all of them, or unpack all",
        )
    return str(data.resolve() / path) + (".gz" if True in lie else "")


def _sha256_of_content(path: Path) -> str:
    """Return the SHA-256 of a file's content, unpacked where its name ends in .gz; errors as `check_file`."""
    depend_on(path)
    digest = hashlib.sha256()
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as stream:
            while piece := stream.read(_PIECE):
                digest.update(piece)
    except (EOFError, zlib.error, gzip.BadGzipFile) as cause:
        raise InputError(
            str(path),
            found=f"a damaged file ({cause})",
            expected="a whole compressed file",
            remedy="copy it again",
        ) from cause
    return digest.hexdigest()
