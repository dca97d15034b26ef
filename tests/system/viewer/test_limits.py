"""Clients that keep the viewer's server waiting, over real sockets: they give way, and others are served."""

import socket
import threading
from contextlib import ExitStack, contextmanager

import pytest

import processes

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")

from doppelgait.viewer import app
from doppelgait.viewer.server import open_socket
from viewer_client import running

REQUEST = b"GET / HTTP/1.1\r\nHost: here\r\n\r\n"
LARGE = 20_000_000  # bytes: more than two sockets hold


class Application:
    """Answers ``/large`` with many bytes, ``/held`` when it is released, and everything else at once."""

    def __init__(self):
        self.release = threading.Event()
        self.held = 0

    async def __call__(self, scope, receive, send):
        import anyio

        if scope["type"] == "lifespan":
            for kind in ("startup", "shutdown"):
                await receive()
                await send({"type": f"lifespan.{kind}.complete"})
            return
        if scope["path"] == "/held":
            self.held += 1
            while not self.release.is_set():
                await anyio.sleep(0.01)
        body = bytes(LARGE) if scope["path"] == "/large" else b"answer"
        headers = [(b"content-length", str(len(body)).encode())]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": body})


@contextmanager
def serving():
    application = Application()
    with open_socket(0) as listener, ExitStack() as ends:

        def connect(sent=b""):
            client = ends.enter_context(socket.create_connection(listener.getsockname(), timeout=processes.LIMIT_S))
            client.sendall(sent)
            return client

        with running(app.make_server(application), listener) as server:
            yield application, server, connect
            application.release.set()


def all_of(client):
    """What a client gets until its connection is closed."""
    got = []
    try:
        while part := client.recv(1 << 16):
            got.append(part)
    except ConnectionResetError:
        pass
    return b"".join(got)


def answer_of(client):
    """One answer; the connection stays open."""
    got = b""
    while not got.endswith(b"answer"):
        part = client.recv(1000)
        assert part, got
        got += part
    return got


def test_answers_do_not_wait_for_receipts():
    with serving() as (_, server, connect):
        answer_of(connect(REQUEST))
        (connection,) = server.server_state.connections
        accepted = connection.transport.get_extra_info("socket")
        assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_headers_of_megabytes_are_refused():
    with serving() as (_, _, connect):
        client = connect()
        try:
            client.sendall(b"GET / HTTP/1.1\r\nX: " + bytes(10_000_000).replace(b"\0", b"x"))
        except ConnectionError:  # closed while it sends
            return
        assert b" 400 " in all_of(client)


@pytest.mark.parametrize("sent", [b"", b"GET / HTT", REQUEST.replace(b"/ ", b"/large ")])
def test_waiting_connections_give_way_to_others(sent, monkeypatch):
    monkeypatch.setattr(app, "MAX_CONNECTIONS", 4)
    with serving() as (_, server, connect):
        for _ in range(12):
            connect(sent)
        client = connect(REQUEST)
        assert answer_of(client).startswith(b"HTTP/1.1 200 ")
        assert len(server.server_state.connections) <= 4
        client.sendall(REQUEST)
        assert answer_of(client).startswith(b"HTTP/1.1 200 ")


def test_connections_that_are_answered_stay(monkeypatch):
    monkeypatch.setattr(app, "MAX_CONNECTIONS", 3)
    with serving() as (application, _, connect):
        held = [connect(REQUEST.replace(b"/ ", b"/held ")) for _ in range(3)]
        processes.wait_until(lambda: application.held == 3)
        assert all_of(connect(REQUEST)).startswith(b"HTTP/1.1 503 ")
        application.release.set()
        assert all(answer_of(one).startswith(b"HTTP/1.1 200 ") for one in held)
        assert answer_of(connect(REQUEST)).startswith(b"HTTP/1.1 200 ")  # in the place of one that waits again
