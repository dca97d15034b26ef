"""A viewer's server in a thread, and what the tests ask it over a real socket."""

import http.client
import json
import threading
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

import processes
from doppelgait.viewer.app import make_app, make_server
from doppelgait.viewer.server import open_socket

TOKEN = "token-of-this-test"


def walking_scene(duration_s):
    """Scene file's tables of a person who comes nearer."""
    person = {
        "label": "human",
        "motion": {"kind": "boulic", "speed_mps": 1.3, "height_m": 1.75},
        "start_position_m": [5.0, 0.3],
        "heading_deg": 180.0,
    }
    radar = {"radar_position_m": [0.0, 0.0, 1.0], "radar": {"preset": "x4"}}
    return {"seed": 4, "duration_s": duration_s, **radar, "targets": [person]}


def unpack(body):
    """Header and arrays of a payload, by the description alone."""
    assert body[:4] == b"DGV1"
    length = int.from_bytes(body[4:8], "little")
    facts = json.loads(body[8 : 8 + length])
    arrays = {}
    for name, entry in facts["arrays"].items():
        start = 8 + length + entry["offset"]
        assert start % 8 == 0
        kind = np.dtype(entry["dtype"]).newbyteorder("<")
        count = int(np.prod(entry["shape"]))
        arrays[name] = np.frombuffer(body, kind, count, start).reshape(entry["shape"])
    return facts, arrays


@dataclass
class Answer:
    status: int
    headers: dict
    body: bytes


@dataclass
class Client:
    """Asks the viewer on a port of this computer."""

    port: int

    def ask(self, path, *, method="GET", host=None, **headers):
        """Answer to a request for a whole path; ``host=""`` sends no Host header."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        for name, value in {"Host": f"127.0.0.1:{self.port}" if host is None else host, **headers}.items():
            if value:
                connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        body = answer.read()
        connection.close()
        return Answer(answer.status, {k.lower(): v for k, v in answer.getheaders()}, body)

    def get(self, path):
        """Answer of ``api/PATH``."""
        return self.ask(f"/{TOKEN}/api/{path}")

    def facts(self, path):
        """JSON, or the header of a payload."""
        answer = self.get(path)
        assert answer.status == 200, answer.body
        if answer.body[:4] != b"DGV1":
            return json.loads(answer.body)
        return json.loads(answer.body[8 : 8 + int.from_bytes(answer.body[4:8], "little")])

    def fault(self, path, status=400):
        """Reason of a refusal."""
        answer = self.get(path)
        assert answer.status == status, (path, answer.status, answer.body[:500])
        document = json.loads(answer.body)
        assert set(document) == {"error"}
        return document["error"]


@contextmanager
def served(opened, settings=None):
    """Client of a viewer that has something open, or nothing."""
    with open_socket(0) as listener:
        port = listener.getsockname()[1]
        with running(make_server(make_app(opened, token=TOKEN, port=port, settings=settings)), listener):
            yield Client(port)


@contextmanager
def running(server, listener):
    """Run a server in a thread, for the time of the block."""
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    processes.wait_until(lambda: server.started or not thread.is_alive())
    assert server.started
    try:
        yield server
    finally:
        server.should_exit = True
        processes.join(thread)
