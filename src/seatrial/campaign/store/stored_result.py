"""What a campaign keeps on disk: results in plain files, each stamped with the key of everything it depends on.

A result is current when its stamp equals the key computed from today's configuration, data and version; otherwise the
step runs again, as it does where the result is damaged. There is no other memory of what has been done, so a kill at any
moment loses only work in flight. What a result depends on stands beside its work: `estimate_key` in `inference/estimate.py`.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Generic, Literal, NamedTuple, TypeVar, cast
from zipfile import ZIP_STORED

import numpy as np
from pydantic import BaseModel

from seatrial import __version__
from seatrial.core import dataset_file
from seatrial.core.dataset import Dataset
from seatrial.core.dataset_file import SEAL, is_sealed, open_dataset, stored, text_of
from seatrial.core.errors import InputError
from seatrial.core.files import atomic_path, depend_on, open_regular, read_bytes, set_aside, sha256_of_json, write_json
from seatrial.core.record import Record
from seatrial.core.record_file import read_record, record_dataset
from seatrial.core.serialise import from_dataset, from_plain, to_dataset, to_plain

# Format of results on disk: raise it when a type of `StoredResult` changes, so that what was written before is made
# again. Records have a format of their own.
FORMAT = 2
FILE_NAME = "campaign.toml"  # What a campaign is, in its folder


def campaign_folder(path: Path) -> Path:
    """Return the folder of a campaign, which may be named by its file."""
    return path.parent if path.name == FILE_NAME and path.is_file() else path


class ResultFile(NamedTuple):
    """A file below the folder of results."""

    name: str

    def __get__(self, store: "Store", owner: type) -> Path:
        return store.results / self.name


class LabelledFile(NamedTuple):
    """One file for each label, such as that of a structure, a run or a method, which stands for the braces in the name."""

    name: str

    def __get__(self, store: "Store", owner: type) -> Callable[[object], Path]:
        return lambda label: store.results / self.name.format(label)


@dataclass(frozen=True)
class Store:
    """Places of results under a campaign's folder."""

    folder: Path
    design = ResultFile("design.nc")  # swept designs
    next_design = ResultFile("next.nc")  # designs swept for the next trial
    mode_design = ResultFile("next_by_mode.nc")  # designs swept for the next trial from what the posterior mode says
    free_design = ResultFile("free_form.json")  # the free-form trial
    own_design = ResultFile("own.json")  # what a schedule of one's own is worth beside the families
    relay_design = ResultFile("self_oscillation.json")  # the self-oscillating test
    batch_schedule = LabelledFile("batch_{}_schedule.csv")  # schedule of one of the trials that are planned together
    plan_schedule = LabelledFile("plan_{}_schedule.csv")  # schedule of one trial of the plan of the campaign
    searched = ResultFile("searched.json")  # the design found by a global search
    measures = ResultFile("measures.nc")  # every measure of some designs side by side
    coefficients = ResultFile("coefficients.csv")  # table of the parameters of every structure, as CSV
    modes = ResultFile("modes.json")  # highest posterior mode of each structure, from which commands begin
    all_modes = ResultFile("all_modes.json")  # these and further ones, as a search finds them
    mode = ResultFile("mode.json")  # posterior mode of the most probable structure, a first answer
    quote = ResultFile("quote.csv")  # table of the value to quote of each parameter, as CSV
    sequence = ResultFile("sequence.json")  # trials decided after the first, of a simulated vehicle
    proposed = ResultFile("proposed_schedule.csv")  # schedule of the trial that is proposed
    known_design = ResultFile("known/design.json")  # what the best design would tell
    known = LabelledFile("known/{}.json")  # what the data tell about each parameter of one structure
    profiles = LabelledFile("profiles/{}.json")  # profile likelihoods of one structure's parameters
    criteria = LabelledFile("criteria/{}.json")  # information criteria of one structure
    cross_validation = ResultFile(
        "cross_validation.json"
    )  # how well each structure and model of the error predicts runs left out
    filter = ResultFile("filter.nc")  # filter traces
    calibration = LabelledFile("calibration-{}.nc")  # ranks of a calibration by one method
    rehearsal = ResultFile("rehearsal.nc")  # trials that each strategy needed, on vehicles drawn from the priors
    predictions = ResultFile("predictions.nc")  # fitted and predicted records
    mode_predictions = ResultFile("mode_predictions.nc")  # held-back records, as the posterior mode predicts them
    baselines = ResultFile("baselines.nc")  # held-back records as baselines predict them
    screening = ResultFile("screening.nc")  # all structures in closed form
    contenders = ResultFile("contenders.json")  # the best structure beside the runner-up
    selection = ResultFile("selection.json")  # evidences, probabilities and verdicts
    summary = ResultFile("summary.json")  # everything an engineer copies out
    answer = LabelledFile("answers/{}.json")  # what a command said last
    record = LabelledFile("records/{}.nc")  # one trial
    posterior = LabelledFile("posterior/{}.nc")  # draws of one structure's parameters
    checkpoint = LabelledFile("checkpoints/{}.npz")  # unfinished work

    @property
    def results(self) -> Path:
        """Folder of all results."""
        return self.folder / "results"

    @property
    def report(self) -> Path:
        """The page."""
        return self.folder / "report.html"

    def schedule(self, design: Path) -> Path:
        """Table of time and control of a design's best trial, for the operator."""
        return design.with_name(f"{design.stem}_schedule.csv")


def key_of(*parts: Any) -> str:
    """Key of a result: hash of everything it depends on, the package version included; parts as `as_json` takes them."""
    return sha256_of_json([__version__, FORMAT, as_json(parts)])


def as_json(part: Any) -> Any:
    """Return a part of a configuration as JSON, so that parts of equal content are equal there.

    Tables of a campaign file go by type and by their keys, frozen dataclasses by the fields that they are compared by. Numbers go by
    twelve digits, since a quantity that is written in another unit differs in the sixteenth, and large ones by nine decimals: of seconds
    since 1970 every nanosecond counts.
    """
    if isinstance(part, float):
        return round(part, 9) if abs(part) >= 1e3 else float(f"{part:.11e}")
    if is_dataclass(part) and not isinstance(part, type):
        content = {field.name: as_json(getattr(part, field.name)) for field in fields(part) if field.compare}
        return {"": type(part).__name__, **content}
    if isinstance(part, BaseModel):
        return {"": type(part).__name__, **{name: as_json(value) for name, value in part}}
    if isinstance(part, Mapping):
        return {name: as_json(value) for name, value in part.items()}
    return [as_json(one) for one in part] if isinstance(part, list | tuple) else part


def stamp_of(path: Path) -> str | None:
    """Return the key that a result was written with, None if it is missing or damaged; of a dataset the header alone is read."""
    try:
        return _stamp(path)
    except InputError:
        return None


def seal_of(path: Path) -> str | None:
    """Return the hash of a JSON result, of its key and its content together; None if it is missing or damaged."""
    try:
        return read_json(path, "seatrial run").get(SEAL)
    except InputError:
        return None


def is_current(path: Path, key: str) -> bool:
    """Return whether a result was written with this key; a damaged one is set aside, and said, so that it is computed again."""
    try:
        return _stamp(path) == key
    except InputError as damage:
        set_aside(path, damage.found)
        return False


Result = TypeVar("Result")
State = Literal["current", "stale", "missing"]


class StepState(NamedTuple):
    """One step of a campaign.

    Attributes:
        name: of the step.
        state: whether its results are current.
        command: that makes them so.
        alarms: why current results are not to be used: checks of the chains or of the evidence that they have failed.
    """

    name: str
    state: State
    command: str
    alarms: tuple[str, ...] = ()


@dataclass(frozen=True)
class StoredResult(Generic[Result]):
    """One result of a step: its place, its key, and its type, by which it is read and written.

    Attributes:
        path: of the file; NetCDF or JSON, as its name says.
        key: of everything that it depends on.
        kind: type of the result, as `seatrial.core.serialise` takes it; or `Dataset`, or `Record`.
        command: makes the result.
    """

    path: Path
    key: str
    kind: type[Result]
    command: str = "seatrial run"

    def is_current(self) -> bool:
        """Return whether it is there as it would be computed now; a damaged file is set aside, and said."""
        return is_current(self.path, self.key)

    def state(self) -> State:
        """Return whether it is current; nothing is moved, and of a dataset the header alone is read."""
        depend_on(self.path)
        if not self.path.is_file():
            return "missing"
        return "current" if stamp_of(self.path) == self.key else "stale"

    def read(self) -> Result:
        """Read it; errors as `read_result`."""
        return read_result(self.kind, self.path, self.command)

    def write(self, result: Result) -> None:
        """Write it with its key, atomically."""
        if self.path.suffix == ".json":
            write_stamped_json(self.path, to_plain(result), self.key)
        elif isinstance(result, Dataset):
            write_dataset(self.path, result, self.key)
        else:
            write_dataset(
                self.path, record_dataset(result) if isinstance(result, Record) else to_dataset(result), self.key
            )

    def read_or_make(self, make: Callable[[], Result], after: Callable[[], object] | None = None) -> Result:
        """Read it if it is current and sound; otherwise make it, write it, and read what was written.

        Args:
            make: computes it.
            after: is called once what was made is safe on disk, such as to remove checkpoints.
        """
        if self.is_current():
            try:
                return self.read()
            except InputError as damage:
                set_aside(self.path, damage.found)
        self.write(make())
        if after is not None:
            after()
        return self.read()


def read_result(kind: type[Result], path: Path, command: str) -> Result:
    """Read a result by its type.

    Args:
        kind: see `StoredResult`.
        path: of the file.
        command: makes the result.

    Raises:
        InputError: missing, damaged or edited, or of another format; the remedy names the command.
    """
    if kind is Record:
        return cast(Result, read_record(path))
    if path.suffix != ".json":
        dataset = open_dataset(path)
        _check_format(dataset.attrs.get("format"), path, command)
        with decoding(path, command):
            return cast(Result, dataset) if kind is Dataset else from_dataset(kind, dataset)
    content = read_json(path, command)
    _check_format(content.get("format"), path, command)
    with decoding(path, command):
        return from_plain(kind, content)


def _check_format(written: Any, path: Path, command: str) -> None:
    if written != FORMAT:
        raise InputError(
            str(path),
            found=f"a result of format {1 if written is None else written}",
            expected=f"format {FORMAT}, which this version reads",
            remedy=f"run `{command}` to make it again",
        )


def write_dataset(path: Path, dataset: Dataset, key: str) -> None:
    """Write a stamped NetCDF file, atomically."""
    stamp = {"key": key, "seatrial_version": __version__}
    # A record has a format of its own.
    dataset_file.write_dataset(
        path, dataset.assign_attrs(**stamp, **({} if "format" in dataset.attrs else {"format": FORMAT}))
    )


def write_stamped_json(path: Path, content: Mapping[str, Any], key: str) -> None:
    """Write a stamped JSON file with the hash of its content, atomically."""
    stamped = {"key": key, "seatrial_version": __version__, "format": FORMAT, **content}
    write_json(path, {SEAL: sha256_of_json(stamped), **stamped})


def read_json(path: Path, made_by: str) -> dict[str, Any]:
    """Read a JSON result.

    Raises:
        InputError: missing, damaged or edited; the remedy names the command that makes it.
    """
    depend_on(path)
    try:
        content = json.loads(read_bytes(path))
        if sha256_of_json({name: value for name, value in content.items() if name != SEAL}) != content.get(SEAL):
            raise ValueError("its content does not match its hash")
        return content
    except FileNotFoundError as cause:
        raise InputError(
            str(path), found="no such file", expected="a result", remedy=f"run `{made_by}` first"
        ) from cause
    except (IsADirectoryError, ValueError, AttributeError, RecursionError) as cause:
        raise InputError(
            str(path),
            found="a folder" if path.is_dir() else f"damaged JSON ({cause})",
            expected="a result",
            remedy=f"{'move it away' if path.is_dir() else 'delete it'} and run `{made_by}` again",
        ) from cause


@contextmanager
def decoding(path: Path, made_by: str) -> Iterator[None]:
    """Turn what is wrong with the fields of a whole result, such as one of another version, into an error for the user.

    Raises:
        InputError: it lacks a field, or has another; the remedy names the command that makes it.
    """
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError) as cause:
        raise InputError(
            str(path),
            found=f"a result with other fields ({type(cause).__name__}: {' '.join(str(cause).split())[:200]})",
            expected=f"a result of seatrial {__version__}",
            remedy=f"delete it and run `{made_by}` again",
        ) from cause


def save_checkpoint(path: Path, key: str, arrays: Mapping[str, Any]) -> None:
    """Write a checkpoint with the hash of its content, atomically."""
    content = {name: np.asarray(value) for name, value in arrays.items()}
    sealed = {"key": np.array(key), SEAL: np.array(_hash_of(content)), **content}
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **sealed)  # pyright: ignore[reportArgumentType]


def load_checkpoint(path: Path, key: str) -> dict[str, np.ndarray] | None:
    """Read a checkpoint with this key; None if there is none, it belongs to other work, or it is damaged, which is said."""
    try:
        with open_regular(path, links=True) as file, np.load(file, allow_pickle=False) as stored:
            if any(item.compress_type != ZIP_STORED for item in stored.zip.infolist()):
                raise ValueError("it is compressed, but a checkpoint is not")
            content = {name: stored[name] for name in stored.files}
        written, seal = str(content.pop("key")), str(content.pop(SEAL))
        if seal != _hash_of(content):
            raise ValueError("its content does not match its hash")
    except (FileNotFoundError, PermissionError):
        return None
    except Exception as damage:  # `numpy` and `zipfile` raise all kinds of errors
        set_aside(path, "a folder" if path.is_dir() else " ".join(str(damage).split())[:200])
        return None
    return content if written == key else None


def _stamp(path: Path) -> str | None:
    """Return the key that a result was written with; None if there is none.

    The bytes of a dataset are compared with the hash behind them, and its attributes read; its variables are read only where another
    tool has written it again, without that hash.

    Raises:
        InputError: a damaged one.
    """
    depend_on(path)
    if not path.exists():
        return None
    if path.suffix == ".json":
        return read_json(path, "seatrial run").get("key")
    if path.is_file() and not is_sealed(path):
        return open_dataset(path).attrs.get("key")
    with stored(path) as file:
        key = file.attrs.get("key")
        return None if key is None else text_of(key)


def _hash_of(arrays: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(f"{name} {arrays[name].dtype.str} {arrays[name].shape} ".encode())
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()
