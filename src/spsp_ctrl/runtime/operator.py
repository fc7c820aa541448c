"""Requests from a person or a program: judged at this boundary, stamped with the cycle that takes them.

Two ways in, one judge: lines from a pipe (the keys of the live screen) and lines on a local socket (``spsp-ctrl ctl``, target streams).
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
from collections.abc import Sequence
from math import isfinite, radians
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from spsp_ctrl.messages import OperatorRequest

PLAIN = ("arm", "disarm", "stop", "reset", "home", "present")
ANGLES = ("heading", "turn", "target", "jog")
VERBS = (*PLAIN, *ANGLES)
JOG_AXES = ("pitch", "roll", "azimuth")
MAX_LINE = 4096
MAX_CLIENTS = 8
MAX_JOG_DEG = 5.0
MAX_RATE_DEG_S = 30.0
SOCKET_NAME = "ctl.sock"


class Refused(ValueError):
    """A request that is not understood or out of range; the text says what would be right."""


class Judge:
    """From one line of JSON, ``{"verb": ..., "value": degrees, "rate": degrees per second, "axis": ...}``, to a request.

    ``heading`` goes to a heading; ``turn`` changes the present demand; ``target`` is one sample of a stream; ``jog`` moves the demand of an axis on.
    """

    def __init__(self, source: str) -> None:
        self._source = source
        self._heading_rad = 0.0

    def __call__(self, line: bytes, now_ns: int) -> OperatorRequest:
        """Raises ``Refused``."""
        try:
            data = json.loads(line)
            verb = data["verb"]
        except (ValueError, KeyError, TypeError):
            raise Refused('not understood; expected a line like {"verb": "heading", "value": 10}') from None
        if verb not in VERBS:
            raise Refused(f"unknown verb {verb!r}; known: {', '.join(VERBS)}")
        value, rate = _number(data, "value"), _number(data, "rate")
        if verb in PLAIN:
            return OperatorRequest(now_ns, verb, 0.0, self._source)
        if verb == "jog":
            return self._jog(data.get("axis"), value, now_ns)
        if abs(value) > 360.0:
            raise Refused(f"{verb}: {value:g} deg is beyond 360")
        if abs(rate) > MAX_RATE_DEG_S:
            raise Refused(f"{verb}: {rate:g} deg/s is beyond {MAX_RATE_DEG_S:g}")
        self._heading_rad = radians(value) + (self._heading_rad if verb == "turn" else 0.0)
        if verb == "target":
            return OperatorRequest(now_ns, verb, self._heading_rad, self._source, radians(rate))
        return OperatorRequest(now_ns, "heading", self._heading_rad, self._source)

    def _jog(self, axis: Any, value: float, now_ns: int) -> OperatorRequest:
        if axis not in JOG_AXES:
            raise Refused(f"jog: unknown axis {axis!r}; known: {', '.join(JOG_AXES)}")
        if abs(value) > MAX_JOG_DEG:
            raise Refused(f"jog: {value:g} deg is beyond {MAX_JOG_DEG:g}")
        if axis == "azimuth":
            self._heading_rad += radians(value)
            return OperatorRequest(now_ns, "heading", self._heading_rad, self._source)
        return OperatorRequest(now_ns, f"jog-{axis}", radians(value), self._source)


def _number(data: dict[str, Any], key: str) -> float:
    try:
        value = float(data.get(key) or 0.0)
    except (TypeError, ValueError):
        raise Refused(f"{key} must be a number, not {data.get(key)!r}") from None
    if not isfinite(value):
        raise Refused(f"{key} must be finite")
    return value


class PipeOperator:
    """Newline-delimited requests from a non-blocking file descriptor. What is refused is counted and dropped."""

    def __init__(self, fd: int, source: str) -> None:
        os.set_blocking(fd, False)
        self._fd = fd
        self._judge = Judge(source)
        self._buffer = b""
        self.rejected = 0

    def poll(self, now_ns: int) -> tuple[OperatorRequest, ...]:
        """Requests since the last call."""
        try:
            data = os.read(self._fd, MAX_LINE)
        except (BlockingIOError, OSError):
            return ()
        if not data:
            return ()
        self._buffer += data
        *lines, self._buffer = self._buffer.split(b"\n")
        if len(self._buffer) > MAX_LINE:
            self._buffer = b""
            self.rejected += 1
        found = []
        for line in lines:
            try:
                found.append(self._judge(line, now_ns))
            except Refused:
                self.rejected += 1
        return tuple(found)


class _Client(NamedTuple):
    connection: socket.socket
    judge: Judge
    rest: bytes


@contextlib.contextmanager
def _short(path: Path) -> Any:
    """A name for ``path`` that fits into a socket address (108 bytes), however deep the folder lies."""
    fd = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{fd}/{path.name}"
    finally:
        os.close(fd)


class SocketOperator:
    """A listening unix socket in the run folder, readable and writable by its owner alone. ``poll`` never waits; every line is answered with one."""

    def __init__(self, path: Path) -> None:
        """Raises ``OSError``."""
        self.path = path
        self._server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        with _short(path) as name:
            path.unlink(missing_ok=True)
            mask = os.umask(0o177)
            try:
                self._server.bind(name)
            finally:
                os.umask(mask)
        self._server.listen(MAX_CLIENTS)
        self._server.setblocking(False)
        self._clients: list[_Client] = []
        self.rejected = 0

    def poll(self, now_ns: int) -> tuple[OperatorRequest, ...]:
        """Requests since the last call, of every connection."""
        if len(self._clients) < MAX_CLIENTS:
            with contextlib.suppress(OSError):
                connection, _ = self._server.accept()
                connection.setblocking(False)
                self._clients.append(_Client(connection, Judge("ctl"), b""))
        if not self._clients:
            return ()
        found: list[OperatorRequest] = []
        kept = []
        for client in self._clients:
            after = self._serve(client, now_ns, found)
            if after is None:
                client.connection.close()
            else:
                kept.append(after)
        self._clients = kept
        return tuple(found)

    def _serve(self, client: _Client, now_ns: int, found: list[OperatorRequest]) -> _Client | None:
        connection, judge, rest = client
        try:
            data = connection.recv(MAX_LINE)
        except BlockingIOError:
            return client
        except OSError:
            return None
        if not data:
            return None
        *lines, rest = (rest + data).split(b"\n")
        if len(rest) > MAX_LINE:
            return None
        for line in lines:
            answer: dict[str, object] = {"ok": True, "stamp_ns": now_ns}
            try:
                found.append(judge(line, now_ns))
            except Refused as error:
                self.rejected += 1
                answer = {"ok": False, "error": str(error)}
            # a client that does not read its answers loses them
            with contextlib.suppress(OSError):
                connection.send(json.dumps(answer).encode() + b"\n")
        return _Client(connection, judge, rest)

    def close(self) -> None:
        """Stop listening and take the socket away."""
        for client in self._clients:
            client.connection.close()
        self._clients = []
        self._server.close()
        with contextlib.suppress(OSError):
            self.path.unlink()


class Source(Protocol):
    """Where requests come from."""

    def poll(self, now_ns: int) -> tuple[OperatorRequest, ...]:
        """Requests since the last call, without waiting."""
        ...


class Operators:
    """Several ways in, as one."""

    def __init__(self, sources: Sequence[Source]) -> None:
        self._sources = tuple(sources)

    def poll(self, now_ns: int) -> tuple[OperatorRequest, ...]:
        """Requests of all, in their order."""
        return tuple(request for source in self._sources for request in source.poll(now_ns))


def ask(path: Path, lines: Sequence[dict[str, Any]], timeout_s: float = 2.0) -> list[dict[str, Any]]:
    """The client's end: send requests to the run that listens at ``path``, one after the other, and return its answers. Raises ``OSError``."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(timeout_s)
        with _short(path) as name:
            connection.connect(name)
        answers = []
        with connection.makefile("rwb") as stream:
            for line in lines:
                stream.write(json.dumps(line).encode() + b"\n")
                stream.flush()
                answer = stream.readline()
                if not answer:
                    raise ConnectionError(f"{path}: the run has ended")
                answers.append(json.loads(answer))
        return answers
