"""Files and folders that a campaign file names: one way to find them, and one limit on where they may lie.

They are a log, a curve beside it and an earlier campaign. On the command line they may lie anywhere, and those outside the campaign's
folder are told. The environment variable SEATRIAL_WITHIN keeps them to some folders, one a line; the dashboard sets it for whatever it
asks and starts, because whoever looks at its pages shall not read what they are not served.
"""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from seatrial.campaign.config.import_table import ImportTable
from seatrial.core.errors import InputError

VARIABLE = "SEATRIAL_WITHIN"


def keep_within(folders: Sequence[Path]) -> None:
    """Keep this process, and those that it starts, to files below some folders.

    Raises:
        InputError: the name of a folder has two lines.
    """
    for folder in folders:
        if "\n" in str(folder):
            raise InputError(
                f"folder {str(folder)!r}", found="a name of two lines", expected="one line", remedy="rename it"
            )
    os.environ[VARIABLE] = "\n".join(str(folder.resolve()) for folder in folders)


def find(folder: Path, written: str, where: str, run: str = "") -> Path:
    """Return what a key of a campaign file names.

    Args:
        folder: of the campaign.
        written: relative to it, or absolute; may begin with `~`, and hold environment variables, and `{run}`.
        where: file and key, for errors.
        run: label of a run, instead of `{run}`.

    Raises:
        InputError: a variable that is not set, nothing there, a device or a pipe, or, where files are kept within folders, one
            outside, links followed.
    """
    limits = tuple(Path(line).resolve() for line in os.environ.get(VARIABLE, "").splitlines() if line)
    path = place_of(folder, written, where, run, limits)
    if os.path.isfile(path) or os.path.isdir(path):  # those of Path raise where a name is too long
        return path
    shown = f'"{written}"' if limits else path  # who is kept within folders is not told what variables hold
    raise InputError(
        where,
        found=f"{'a device or a pipe' if os.path.exists(path) else 'no file'} {shown}",
        expected="an existing file",
        remedy="correct the path; it is relative to the campaign's folder",
    )


def place_of(folder: Path, written: str, where: str, run: str, limits: Sequence[Path]) -> Path:
    """Return where a file would be, which need not be there; it is kept within `limits` if there are any. Errors as `find`."""
    text = os.path.expanduser(os.path.expandvars(written))
    if "$" in text:
        raise InputError(
            where,
            found=f'"{written}" with a variable that is not set',
            expected="environment variables that are set",
            remedy="export the variable, or write the path out",
        )
    path = folder / text.replace("{run}", run)
    if not limits or _is_below(path, limits):
        return path
    raise InputError(
        where,
        found=f'"{written[:80]}", which lies outside',
        expected=f"a file below {' or '.join(map(str, limits))}, to which the dashboard, or {VARIABLE}, keeps campaigns",
        remedy="copy it there, or start the dashboard with --allow-read and its folder; in a shell it may lie anywhere",
    )


def named_in(priors_from: Sequence[str], imports: ImportTable | None) -> Iterator[tuple[str, str, str]]:
    """Key, text and run of the earlier campaigns and logs that a campaign names."""
    for item in priors_from:
        yield "vehicle.priors_from", item, ""
    if imports is None:
        return
    for run in imports.runs if imports.schedule is not None else ():
        yield "import.schedule", imports.schedule or "", run
    for run in imports.runs:
        for index, file in imports.of(run).items():
            yield f"import.files[{index}].path", file.path, run
    for index, file in enumerate(imports.files):
        for name, column in file.channels.items():
            if column.curve is not None:
                yield f"import.files[{index}].channels.{name}.curve", column.curve, ""
    for index, rule in enumerate(imports.keep):
        for run in imports.runs:
            yield f"import.keep[{index}].path", rule.path, run


def folders_outside(
    folder: Path, priors_from: Sequence[str], imports: ImportTable | None, others: Sequence[Path] = ()
) -> list[str]:
    """Folders outside a campaign's own from which it reads files, and earlier campaigns; what is missing is left out.

    Args:
        folder: of the campaign.
        priors_from: earlier campaigns, as written.
        imports: runs and their logs.
        others: files that were found.
    """
    folders = {str(path.resolve().parent): None for path in others if not _is_below(path, [folder.resolve()])}
    for key, written, run in named_in(priors_from, imports):
        try:
            path = find(folder, written, key, run)
        except InputError:  # is said when it is read
            continue
        if not _is_below(path, [folder.resolve()]):
            folders[str(path.resolve() if path.is_dir() else path.resolve().parent)] = None
    return list(folders)


def _is_below(path: Path, folders: Sequence[Path]) -> bool:
    try:
        there = path.resolve()
    except (OSError, ValueError, RuntimeError):  # a name that no file system would take, or links that go round
        return False
    return any(there.is_relative_to(folder) for folder in folders)
