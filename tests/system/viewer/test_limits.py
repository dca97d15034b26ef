"""Clients that keep the viewer's server waiting, over real sockets: they are closed, and others are served."""

import os
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
from contextlib import ExitStack, contextmanager

import pytest

import processes

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")

from doppelgait.viewer.limits import Limits, make_server
from doppelgait.viewer.server import open_socket
from viewer_client import running

SOON_S = 0.2
NEVER_S = 1e6
PATIENT = {"idle_s": NEVER_S, "headers_s": NEVER_S, "body_s": NEVER_S, "answer_s": NEVER_S}
REQUEST = b"GET / HTTP/1.1\r\nHost: here\r\n\r\n"
LARGE = 50_000_000
"""Bytes: more than two sockets hold."""
MIDDLE = 40_000
"""Bytes: more than two small sockets hold, and less than what pauses the server."""


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
        body = {"/large": bytes(LARGE), "/middle": bytes(MIDDLE)}.get(scope["path"], b"answer")
        headers = [(b"content-length", str(len(body)).encode())]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": body})


@contextmanager
def serving(server_buffer=None, **limits):
    """Application, server and a function that connects, with limits of which none is reached unless it is named."""
    application = Application()
    with open_socket(0) as listener, ExitStack() as ends:
        port = listener.getsockname()[1]
        if server_buffer is not None:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, server_buffer)

        def connect(sent=b"", buffer=None):
            client = ends.enter_context(socket.socket())
            if buffer is not None:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
            client.settimeout(processes.LIMIT_S)
            client.connect(("127.0.0.1", port))
            client.sendall(sent)
            return client

        with running(make_server(application, Limits(**{**PATIENT, **limits})), listener) as server:
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


def trickle(client, byte):
    """Send byte after byte until the connection is closed, and give what came."""
    got = []

    reader = threading.Thread(target=lambda: got.append(all_of(client)), daemon=True)
    reader.start()

    def ended():
        try:
            client.sendall(byte)
        except OSError:
            return True
        return not reader.is_alive()

    processes.wait_until(ended)
    processes.join(reader)
    return got[0]


def test_answers_do_not_wait_for_receipts():
    with serving() as (_, server, connect):
        answer_of(connect(REQUEST))
        (connection,) = server.server_state.connections
        accepted = connection.transport.get_extra_info("socket")
        assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_idle_connections_are_closed():
    with serving(idle_s=SOON_S) as (_, server, connect):
        assert all_of(connect()) == b""
        answer = all_of(connect(REQUEST))  # idle after its answer
        assert answer.startswith(b"HTTP/1.1 200 ")
        assert answer.endswith(b"answer")
        processes.wait_until(lambda: not server.server_state.connections)


def test_slow_headers_are_refused():
    with serving(headers_s=SOON_S) as (_, _, connect):
        assert trickle(connect(b"GET / HTTP/1.1\r\nX: "), b"x").startswith(b"HTTP/1.1 408 ")
        answer = trickle(connect(REQUEST + b"GET / HTTP/1.1\r\nX: "), b"x")  # of a second request, too
        assert answer.startswith(b"HTTP/1.1 200 ")
        assert b"HTTP/1.1 408 " in answer


def test_slow_bodies_are_refused():
    start = b"GET / HTTP/1.1\r\nHost: here\r\nContent-Length: 1000000\r\n\r\n"
    with serving(body_s=SOON_S) as (application, server, connect):
        assert trickle(connect(start), b"x").endswith(b"answer")
        held = connect(start.replace(b"GET /", b"GET /held"))
        assert trickle(held, b"x") == b""
        assert application.held == 1
        processes.wait_until(lambda: not server.server_state.connections)


@pytest.mark.parametrize(("path", "after"), [("large", ""), ("large", "close"), ("middle", "close")])
def test_clients_that_take_no_answer_are_closed(path, after):
    with serving(answer_s=SOON_S, server_buffer=4096) as (_, server, connect):
        request = f"GET /{path} HTTP/1.1\r\nHost: here\r\nConnection: {after or 'keep-alive'}\r\n\r\n"
        client = connect(request.encode(), buffer=4096)
        processes.wait_until(lambda: server.server_state.total_requests + len(server.server_state.tasks))
        processes.wait_until(lambda: not server.server_state.connections)
        assert 0 < len(all_of(client)) < {"large": LARGE, "middle": MIDDLE}[path]


def test_clients_that_take_some_of_an_answer_get_all_of_it():
    with serving() as (_, server, connect):
        client = connect(b"GET /large HTTP/1.1\r\nHost: here\r\nConnection: close\r\n\r\n")
        processes.wait_until(lambda: any(one._phase == "answer" for one in server.server_state.connections))
        (connection,) = server.server_state.connections
        count = 0
        while connection.transport.get_write_buffer_size() == connection._unsent:
            count += len(client.recv(1 << 20))
        connection.loop.call_soon_threadsafe(connection._end)  # as at the end of the time
        while part := client.recv(1 << 20):
            count += len(part)
        assert count > LARGE


@pytest.mark.parametrize("sent", [b"", b"GET / HTT", b"GET /held HTTP/1.1\r\nHost: here\r\nContent-Length: 9\r\n\r\n"])
def test_waiting_connections_give_way_to_others(sent):
    with serving(connections=4) as (_, server, connect):
        waiting = [connect(sent) for _ in range(20)]
        client = connect(REQUEST)
        assert answer_of(client).startswith(b"HTTP/1.1 200 ")
        assert [all_of(one) for one in waiting[:17]] == [b""] * 17  # the longest first
        assert len(server.server_state.connections) == 4
        client.sendall(REQUEST)
        assert answer_of(client).startswith(b"HTTP/1.1 200 ")


def test_connections_that_are_answered_stay():
    with serving(connections=3) as (application, _, connect):
        held = [connect(REQUEST.replace(b"/ ", b"/held ")) for _ in range(3)]
        processes.wait_until(lambda: application.held == 3)
        assert all_of(connect(REQUEST)).startswith(b"HTTP/1.1 503 ")
        application.release.set()
        assert all(answer_of(one).startswith(b"HTTP/1.1 200 ") for one in held)
        assert answer_of(connect(REQUEST)).startswith(b"HTTP/1.1 200 ")  # in the place of one that waits again


PROGRAM = """
import resource
resource.setrlimit(resource.RLIMIT_NOFILE, (FILES, FILES))
from doppelgait.cli.app import main
main()
"""


@pytest.mark.skipif(os.name != "posix", reason="has no limit of open files")
def test_lack_of_open_files_is_one_line():
    files = 60  # below the limit of connections
    command = [sys.executable, "-c", PROGRAM.replace("FILES", str(files)), "view", "--no-browser"]
    with processes.started(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        url = process.stdout.readline().strip()
        port = int(url.split(":")[2].split("/")[0])
        urllib.request.urlopen(url, timeout=processes.LIMIT_S).read()  # its modules and files are loaded
        with ExitStack() as ends:
            for _ in range(200):
                ends.enter_context(socket.create_connection(("127.0.0.1", port), timeout=processes.LIMIT_S))
            assert process.stderr.readline().startswith("note: the viewer accepts no further connections at present: ")
            for _ in range(5):  # while the others stay open
                with urllib.request.urlopen(url, timeout=processes.LIMIT_S) as answer:
                    assert answer.status == 200
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=processes.LIMIT_S)
    assert (process.returncode, err) == (0, "")
