"""Small files that say, or hold, that they are gigabytes: read or refused, in little time and memory."""

import bz2
import gzip
import io
import struct
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from attacks.outcome import Outcome, Watchman, judged

GIGABYTES = 4 << 30
PIECE = bytes(1 << 20)
PACKED = zlib.compress(bytes(8 << 22))


def bomb(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Read one bomb as its user would."""
    name = list(BOMBS)[number]
    place.mkdir(parents=True)
    read = BOMBS[name](place)
    found = judged(read, watchman, place)
    return found._replace(line=f"{name}: {found.line}")


def _log(path: Path) -> Callable[[], None]:
    """Inspecting, and reading u and n of the first table."""

    def work() -> None:
        from seatrial.core.errors import InputError
        from seatrial.logs.inspect import inspect_log
        from seatrial.logs.log_table import read_log_table
        from seatrial.logs.source import ColumnMap, LogSource

        tables = [None]
        with suppress(InputError):
            tables = [table.info.name for table in inspect_log(path).tables]
        for table in tables[:2]:
            channels = {"u": ColumnMap("u", "m/s", "measurement")}
            with suppress(InputError):
                read_log_table(LogSource(path, None, None, channels, table=table))

    return work


def _squeezed(make: Callable[[], object], head: bytes, tail: bytes, size: int = GIGABYTES) -> bytes:
    """Bytes that unpack to a head, zeros and a tail; `make` gives the compressor."""
    compressor = make()
    parts = [compressor.compress(head)]  # type: ignore[attr-defined]
    parts += [compressor.compress(PIECE) for _ in range(size // len(PIECE))]  # type: ignore[attr-defined]
    return b"".join([*parts, compressor.compress(tail), compressor.flush()])  # type: ignore[attr-defined]


def _gzip(size: int, line: bool) -> Callable[[Path], Callable[[], None]]:
    def made(place: Path) -> Callable[[], None]:
        head, row = b"t,u,n\n0,1,1\n", b"1,1,1\n" * 200_000
        path = place / "run.csv.gz"
        with gzip.open(path, "wb", compresslevel=1) as stream:
            stream.write(head)
            for _ in range(size // len(row)):
                stream.write(bytes(len(row)).replace(b"\0", b"1") if line else row)
        return _log(path)

    return made


def _ros_1(compression: str) -> Callable[[Path], Callable[[], None]]:
    """A bag whose one chunk unpacks to gigabytes, as its header says, or says not."""

    def made(place: Path) -> Callable[[], None]:
        if compression == "bz2":
            data = _squeezed(bz2.BZ2Compressor, b"", b"", 1 << 30)
        else:
            import lz4.frame

            data = lz4.frame.compress(bytes(1 << 30))
        path = place / "run.bag"
        path.write_bytes(
            b"#ROSBAG V2.0\n"
            + _record(
                {"op": b"\x03", "index_pos": bytes(8), "conn_count": bytes(4), "chunk_count": b"\1\0\0\0"}, b" " * 4000
            )
            + _record({"op": b"\x05", "compression": compression.encode(), "size": struct.pack("<I", 1 << 30)}, data)
        )
        return _log(path)

    return made


def _record(fields: dict[str, bytes], data: bytes) -> bytes:
    header = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value for name, value in fields.items()
    )
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def _mcap(compression: str) -> Callable[[Path], Callable[[], None]]:
    """An MCAP whose one chunk unpacks to a gigabyte."""

    def made(place: Path) -> Callable[[], None]:
        size = 1 << 30
        if compression == "zstd":
            from backports import zstd

            data = zstd.compress(bytes(size))
        else:
            import lz4.frame

            data = lz4.frame.compress(bytes(size))
        text = compression.encode()
        chunk = (
            struct.pack("<QQQI", 0, 1, size, 0)
            + struct.pack("<I", len(text))
            + text
            + struct.pack("<Q", len(data))
            + data
        )
        magic = b"\x89MCAP0\r\n"
        header = struct.pack("<I", 4) + b"ros2" + struct.pack("<I", 0)
        records = [(1, header), (6, chunk), (15, bytes(4)), (2, bytes(20))]
        path = place / "run.mcap"
        path.write_bytes(
            magic + b"".join(bytes([op]) + struct.pack("<Q", len(body)) + body for op, body in records) + magic
        )
        return _log(path)

    return made


def _matlab(place: Path) -> Callable[[], None]:
    """A compressed variable of four gigabytes of zeros."""

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<2I", kind, len(data)) + data + b"\0" * (-len(data) % 8)

    rows = (GIGABYTES - 4096) // 8
    flags = element(6, struct.pack("<2I", 6, 0)) + element(5, struct.pack("<2i", rows, 1)) + element(1, b"u")
    head = struct.pack("<2I", 14, GIGABYTES - 1) + flags + struct.pack("<2I", 9, rows * 8 & 0xFFFFFFFF)
    data = _squeezed(partial(zlib.compressobj, 1), head, b"")
    path = place / "run.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<2I", 15, len(data)) + data)
    return _log(path)


def _netcdf(chunked: bool) -> Callable[[Path], Callable[[], None]]:
    """HDF5 that declares terabytes, of which nothing, or chunks of zeros, are there."""

    def made(place: Path) -> Callable[[], None]:
        import h5py

        path, size = place / "run.nc", 1 << (27 if chunked else 40)
        with h5py.File(path, "w") as file:
            options: dict[str, Any] = (
                {"compression": "gzip", "chunks": (1 << 22,)} if chunked else {"chunks": (1 << 16,)}
            )
            count = size // 8 if chunked else size
            variables: dict[str, Any] = {
                name: file.create_dataset(name, (count,), "f8", **options) for name in ("time", "u")
            }
            for name, unit in (("time", "s"), ("u", "m/s")):
                variables[name].attrs["units"] = unit
                for at in range(0, count if chunked else 0, 1 << 22):
                    variables[name].id.write_direct_chunk((at,), PACKED)
            variables["time"].make_scale("time")
            variables["u"].dims[0].attach_scale(variables["time"])
        return _log(path)

    return made


def _parquet(codec: str) -> Callable[[Path], Callable[[], None]]:
    """Half a billion equal numbers in some kilobytes."""

    def made(place: Path) -> Callable[[], None]:
        import pyarrow as arrow
        import pyarrow.parquet as store

        path = place / "run.parquet"
        piece = arrow.table({"time": np.zeros(1 << 22), "u": np.zeros(1 << 22)})
        with store.ParquetWriter(path, piece.schema, compression=codec, use_dictionary=True) as writer:
            for _ in range(128):
                writer.write_table(piece)
        return _log(path)

    return made


def _dataflash(place: Path) -> Callable[[], None]:
    """A type of message whose definitions come again and again, each with another length."""
    from tests.logs.log_writers import DATAFLASH_HEAD, described

    path = place / "run.bin"
    path.write_bytes(
        DATAFLASH_HEAD
        + b"".join(described(40 + k % 80, f"A{k}"[:4], "d" * (k % 16), "d" * (k % 16), "a,b") for k in range(40_000))
    )
    return _log(path)


def _moos(place: Path) -> Callable[[], None]:
    """Hundreds of thousands of variables, a row each."""
    path = place / "run.alog"
    path.write_text("%% LOGSTART 1\n" + "".join(f"{k} VAR_{k} app {k}\n" for k in range(300_000)))
    return _log(path)


def _checkpoint(declared: bool) -> Callable[[Path], Callable[[], None]]:
    """A checkpoint whose arrays are gigabytes, or say so."""

    def made(place: Path) -> Callable[[], None]:
        path = place / "checkpoint.npz"
        head = io.BytesIO()
        np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (GIGABYTES // 8,)})
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for name in ("state.npy", "key.npy"):
                with archive.open(name, "w", force_zip64=True) as stream:
                    stream.write(head.getvalue())
                    for _ in range(0 if declared else GIGABYTES // len(PIECE)):
                        stream.write(PIECE)

        def work() -> None:
            from seatrial.campaign.store.stored_result import load_checkpoint

            load_checkpoint(path, "a key")

        return work

    return made


BOMBS: dict[str, Callable[[Path], Callable[[], None]]] = {
    "gzip of short lines": _gzip(1 << 26, line=False),
    "gzip of one line": _gzip(1 << 30, line=True),
    "ros 1, bz2": _ros_1("bz2"),
    "ros 1, lz4": _ros_1("lz4"),
    "mcap, zstd": _mcap("zstd"),
    "mcap, lz4": _mcap("lz4"),
    "matlab, zlib": _matlab,
    "netcdf, declared": _netcdf(chunked=False),
    "netcdf, chunks": _netcdf(chunked=True),
    "parquet, zstd": _parquet("zstd"),
    "parquet, snappy": _parquet("snappy"),
    "parquet, gzip": _parquet("gzip"),
    "dataflash, definitions": _dataflash,
    "moos, variables": _moos,
    "checkpoint, declared": _checkpoint(declared=True),
    "checkpoint, zeros": _checkpoint(declared=False),
}
"""By name, what writes one into a folder and returns what reads it."""
