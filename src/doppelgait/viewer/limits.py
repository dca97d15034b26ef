"""Limits of the viewer's server: connections, times, open files."""

from __future__ import annotations

import asyncio
import errno
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, cast

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

if TYPE_CHECKING:
    from doppelgait.viewer.app import App

END_S = 1  # longest time for requests in progress when the server stops
QUEUE = 1024  # number of connections in the queue of the system before the server accepts them
TAKEN_AT_ONCE = 16
"""Number of connections that are accepted at once, before excess ones are closed; each needs an open file."""
OUT_OF_FILES = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
QUIET_S = 60.0  # time without a lack of open files after which the next lack is reported
TOO_SLOW = b"HTTP/1.1 408 Request Timeout\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"
TOO_MANY = b"HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\nretry-after: 1\r\ncontent-length: 0\r\n\r\n"

Phase = Literal["idle", "headers", "body", "answer"]
"""Part of a request for which the server waits on a connection."""


@dataclass(frozen=True)
class Limits:
    """Limits of one server."""

    connections: int = 100
    idle_s: float = 30.0
    headers_s: float = 10.0
    body_s: float = 10.0
    answer_s: float = 60.0


class LimitedConnection(H11Protocol):
    """Connection that closes when its client is slow."""

    def __init__(self, *arguments: Any, limits: Limits, waiting: dict[LimitedConnection, None], **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._limits, self._waiting = limits, waiting
        self._phase: Phase | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._full, self._unsent = False, 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accept a connection, closing others above the limit."""
        super().connection_made(transport)
        if len(self.connections) > self._limits.connections:
            longest = next(iter(self._waiting), None)
            if longest is None:
                self.drop(TOO_MANY)
                return
            longest.drop()
        self._follow()

    def data_received(self, data: bytes) -> None:
        """Receive a part of a request."""
        super().data_received(data)
        self._follow()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        super().on_response_complete()
        self._follow()

    def pause_writing(self) -> None:
        """Wait for a client that reads slowly."""
        super().pause_writing()
        self._full = True
        self._follow()

    def resume_writing(self) -> None:
        """Continue an answer."""
        super().resume_writing()
        self._full = False
        self._follow()

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection."""
        self._enter(None)
        super().connection_lost(exc)

    def drop(self, said: bytes = b"") -> None:
        """Close the connection at once, discarding pending output."""
        self._enter(None)
        self.transport.write(said)
        self.transport.abort()

    def _follow(self) -> None:
        """Enter the phase that the connection is in now."""
        phase: Phase | None = None
        if self._full or (self.transport.is_closing() and self.transport.get_write_buffer_size()):
            phase = "answer"
        elif self.transport.is_closing():
            pass
        elif self.conn.their_state is h11.SEND_BODY:
            phase = "body"
        elif self.conn.their_state is h11.IDLE:
            phase = "headers" if self.conn.trailing_data[0] else "idle"
        if phase != self._phase:  # further bytes of the same request do not extend its time
            self._enter(phase)

    def _enter(self, phase: Phase | None) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._waiting.pop(self, None)
        self._phase, self._timer = phase, None
        if phase is not None:
            self._waiting[self] = None
            self._unsent = self.transport.get_write_buffer_size()
            self._timer = self.loop.call_later(getattr(self._limits, f"{phase}_s"), self._end)

    def _end(self) -> None:
        """Close the connection unless the answer has advanced."""
        if self._phase == "answer" and self.transport.get_write_buffer_size() < self._unsent:
            self._enter(self._phase)
        else:
            self.drop(TOO_SLOW if self._phase == "headers" else b"")


class LimitedServer(uvicorn.Server):
    """Server that continues after a lack of open files."""

    def __init__(self, config: uvicorn.Config, waiting: dict[LimitedConnection, None]) -> None:
        super().__init__(config)
        self._waiting = waiting
        self._lacked_s, self._closing = float("-inf"), False

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start to accept connections."""
        asyncio.get_running_loop().set_exception_handler(self._on_error)
        await super().startup(sockets=sockets)
        for listener in sockets or ():
            listener.listen(QUEUE)  # asyncio uses one number for the queue and for connections accepted at once

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Stop in an orderly manner at a signal."""
        with super().capture_signals():
            yield
            self._captured_signals.clear()

    def _on_error(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if not isinstance(error, OSError) or error.errno not in OUT_OF_FILES:
            loop.default_exception_handler(context)
            return
        if not self._closing:  # asyncio tries again at once, before a closed file is free
            self._closing = True
            loop.call_soon(self._close_some)
        if loop.time() - self._lacked_s > QUIET_S:
            print(
                f"note: the viewer accepts no further connections at present: {error.strerror}; it continues when "
                "connections are closed ('ulimit -n' shows how many files may be open)",
                file=sys.stderr,
                flush=True,
            )
        self._lacked_s = loop.time()

    def _close_some(self) -> None:
        """Close half of the connections, longest waiting time first."""
        self._closing = False
        for connection in list(self._waiting)[: len(self._waiting) // 2 + 1]:
            connection.drop()


def make_server(app: App, limits: Limits | None = None) -> LimitedServer:
    """Make a server that does not run yet, with limits."""
    known = limits or Limits()
    waiting: dict[LimitedConnection, None] = {}
    # uvicorn accepts any callable with these parameters
    protocol = cast("type[asyncio.Protocol]", partial(LimitedConnection, limits=known, waiting=waiting))
    config = uvicorn.Config(
        cast("Any", app),
        loop="asyncio",
        http=protocol,
        ws="none",
        lifespan="on",
        access_log=False,
        server_header=False,
        log_level="critical",
        backlog=TAKEN_AT_ONCE,
        timeout_graceful_shutdown=END_S,
        timeout_keep_alive=cast("int", known.idle_s),
    )
    return LimitedServer(config, waiting)
