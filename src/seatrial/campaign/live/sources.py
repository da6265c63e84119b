"""Where samples come from: a growing text, standard input, MAVLink over UDP, topics of ROS 2. Each hands on what has come, as it came."""

import importlib
import io
import os
import select
import socket
import sys
import time
from collections.abc import Callable, Container, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from seatrial.core.errors import InputError
from seatrial.logs.formats.protocol import LOG_TIME
from seatrial.logs.formats.telemetry import mavlink, packets

CHUNK_BYTES = 1 << 16  # Bytes that are read at a time
POLL_SECONDS = 0.02  # Seconds between two looks at a file that does not grow
MOST_DATAGRAMS = 1000  # Datagrams that are taken at a time
_LONGEST_LINE = 1 << 16
_KINDS = "a path, `-` for standard input, `udp:HOST:PORT` for MAVLink, or `ros2` for topics"


class Piece(NamedTuple):
    """What has come at one time.

    Attributes:
        text: whole lines of a table of text; None of others.
        messages: table, sender or "", and numbers by column, each with its time of receipt in us under `log_time`.
        raw: all that has come, as it is kept.
        begins: whether the text begins anew, with its header.
    """

    text: list[str] | None = None
    messages: Sequence[tuple[str, str, dict[str, float]]] = ()
    raw: bytes = b""
    begins: bool = False


class Source(Protocol):
    """A stream of samples."""

    suffix: str
    """Of the file in which what it gives is kept."""

    def read(self, wait: float) -> Piece | None:
        """Return what has come, waiting for it for so many seconds at most; None when the stream has ended."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


def open_source(text: str, tables: Sequence[str]) -> Source:
    """Open a stream.

    Args:
        text: as the user names it.
        tables: types of messages, or topics, that are wanted.

    Raises:
        InputError: nothing of that name, or a library that is missing.
    """
    if text == "-":
        if sys.stdin.isatty():
            raise InputError(
                "SOURCE",
                found="standard input from a keyboard",
                expected=_KINDS,
                remedy="name it, or pipe into it",
            )
        return PipedText(sys.stdin.fileno())
    if text.startswith("udp:"):
        host, _, port = text.removeprefix("udp:").rpartition(":")
        if not host or not port.isdigit() or not 0 <= int(port) < 65536:
            raise InputError(
                f"SOURCE {text}",
                found="no host and port",
                expected="udp:HOST:PORT",
                remedy="for example udp:0.0.0.0:14550",
            )
        return MavlinkUdp(host, int(port), wanted={table.split(" of ")[0] for table in tables})
    if text == "ros2":
        return RosTopics(tables)
    path = Path(text)
    if not path.exists():
        raise InputError(
            f"SOURCE {text}", found="no such file", expected=_KINDS, remedy="correct it, or start the logger"
        )
    if path.is_dir():
        raise InputError(f"SOURCE {text}", found="a folder", expected=_KINDS, remedy="name the file that grows in it")
    return GrowingText(path)


class _Lines:
    """Whole lines of a text that comes in pieces."""

    def __init__(self) -> None:
        self.rest = b""

    def add(self, data: bytes) -> list[str]:
        *whole, self.rest = (self.rest + data).split(b"\n")
        self.rest = self.rest[-_LONGEST_LINE:]
        return [line.decode("utf-8", "replace").rstrip("\r") for line in whole]


class PipedText:
    """Text of a pipe."""

    suffix = ".received.csv"

    def __init__(self, handle: int):
        self.handle, self.lines, self.is_first = handle, _Lines(), True

    def read(self, wait: float) -> Piece | None:
        """See `Source.read`."""
        if not select.select([self.handle], [], [], wait)[0]:
            return Piece([])
        data = os.read(self.handle, CHUNK_BYTES)
        first, self.is_first = self.is_first, False
        if data:
            return Piece(self.lines.add(data), raw=data, begins=first)
        return Piece(self.lines.add(b"\n"), begins=first) if self.lines.rest else None

    def close(self) -> None:
        """See `Source.close`."""


class GrowingText:
    """A file from its beginning on, and what is written to it; when it is cut or replaced, the new one from its beginning."""

    suffix = ".received.csv"

    def __init__(self, path: Path):
        self.path = path
        self._open()

    def read(self, wait: float) -> Piece | None:
        """See `Source.read`."""
        until = time.monotonic() + wait
        while not (data := self.stream.read(CHUNK_BYTES)):
            if self._is_another():
                self._open()
            elif time.monotonic() >= until:
                return Piece([])
            else:
                time.sleep(min(POLL_SECONDS, wait))
        first, self.is_first = self.is_first, False
        return Piece(self.lines.add(data), raw=data, begins=first)

    def close(self) -> None:
        """See `Source.close`."""
        self.stream.close()

    def _open(self) -> None:
        if hasattr(self, "stream"):
            self.stream.close()
        self.stream: io.FileIO = io.FileIO(self.path)
        self.number, self.lines, self.is_first = os.fstat(self.stream.fileno()).st_ino, _Lines(), True

    def _is_another(self) -> bool:
        """Return whether the file was cut below what has been read, or another one has taken its place."""
        try:
            status = os.stat(self.path)
        except FileNotFoundError:  # between the two halves of a rotation
            return False
        return status.st_ino != self.number or status.st_size < self.stream.tell()


class MavlinkUdp:
    """MAVLink messages that are sent to a port of this machine."""

    suffix = ".tlog"

    def __init__(self, host: str, port: int, wanted: Container[str]):
        mavlink(Path("MAVLink over UDP"))
        self.wanted = wanted
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        try:
            self.socket.bind((host, port))
        except OSError as cause:
            self.socket.close()
            raise InputError(
                f"SOURCE udp:{host}:{port}",
                found=f"a port that cannot be opened ({cause.strerror or cause})",
                expected="an address of this machine, and a port that no other program uses",
                remedy="0.0.0.0 listens on all networks; stop the other program, or have it forward to another port",
            ) from cause

    def read(self, wait: float) -> Piece | None:
        """See `Source.read`."""
        found, raw = [], []
        for number in range(MOST_DATAGRAMS):
            if not select.select([self.socket], [], [], wait if number == 0 else 0.0)[0]:
                break
            for packet in packets(self.socket.recv(CHUNK_BYTES), time.time_ns() // 1000, self.wanted):
                raw.append(packet.record)
                if packet.columns:
                    found.append((packet.table, f"{packet.sender[0]}/{packet.sender[1]}", packet.columns))
        return Piece(messages=found, raw=b"".join(raw))

    def close(self) -> None:
        """See `Source.close`."""
        self.socket.close()


class RosTopics:
    """Messages of ROS 2 topics; fields are columns by their paths, as in a bag."""

    suffix = ".received.csv"

    def __init__(self, topics: Sequence[str]):
        try:
            self.rclpy, types = importlib.import_module("rclpy"), importlib.import_module("rosidl_runtime_py.utilities")
        except ModuleNotFoundError as cause:
            raise InputError(
                "SOURCE ros2",
                found=f"no {cause.name} in this Python",
                expected="the Python of a ROS 2 installation, with its set-up sourced",
                remedy="or pipe a topic: ros2 topic echo --csv /TOPIC | seatrial live DIR -, its columns given by `names`",
            ) from cause
        self.rclpy.init()
        self.node, self.waiting = self.rclpy.create_node("seatrial_live"), []
        known, until = {}, time.monotonic() + 5.0
        while set(topics) - set(known) and time.monotonic() < until:
            self.rclpy.spin_once(self.node, timeout_sec=0.1)
            known = dict(self.node.get_topic_names_and_types())
        for topic in topics:
            if topic not in known:
                self.close()
                raise InputError(
                    "SOURCE ros2",
                    found=f"no publisher of {topic}",
                    expected="the topics of [import]: " + ", ".join(topics),
                    remedy="start the publisher, or correct `table` of the file; `ros2 topic list` lists them",
                )
            self.node.create_subscription(types.get_message(known[topic][0]), topic, self._keeper(topic), 100)

    def read(self, wait: float) -> Piece | None:
        """See `Source.read`."""
        self.rclpy.spin_once(self.node, timeout_sec=wait)
        found, self.waiting = self.waiting, []
        return Piece(messages=found)

    def close(self) -> None:
        """See `Source.close`."""
        self.node.destroy_node()
        self.rclpy.shutdown()

    def _keeper(self, topic: str) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            columns = {LOG_TIME: time.time_ns() / 1e3}
            _flatten(message, "", columns)
            self.waiting.append((topic, "", columns))

        return keep


def _flatten(value: Any, path: str, columns: dict[str, float]) -> None:
    """Write the numbers of a message by their paths: `twist.twist.linear.x`, `axes[0]`, `header.stamp` in ns."""
    if hasattr(value, "nanosec"):
        columns[path] = value.sec * 1e9 + value.nanosec
    elif hasattr(value, "get_fields_and_field_types"):
        for name in value.get_fields_and_field_types():
            _flatten(getattr(value, name), f"{path}.{name}" if path else name, columns)
    elif isinstance(value, bool | int | float):
        columns[path] = float(value)
    elif not isinstance(value, str | bytes) and hasattr(value, "__len__"):
        for place, one in enumerate(value):
            _flatten(one, f"{path}[{place}]", columns)
