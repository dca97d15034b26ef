"""Who the viewer's server refuses: asked over a real socket, as a browser or an intruder would."""

import json
import socket

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")

from doppelgait.viewer.app import STATIC
from viewer_client import TOKEN, served

HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "media-src 'self' blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "cross-origin-resource-policy": "same-origin",
}


@pytest.fixture(scope="module")
def viewer():
    """A viewer with nothing open."""
    with served(None) as client:
        yield client


def refused(answer, status):
    """Whether an answer is a refusal in the form that all errors have, with the headers of every answer."""
    assert answer.status == status
    assert set(json.loads(answer.body)) == {"error"}
    assert {name: answer.headers.get(name) for name in HEADERS} == HEADERS
    return True


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST"])
def test_page_and_files_are_given_to_who_knows_the_token(viewer, host):
    page = viewer.ask(f"/{TOKEN}/", host=f"{host}:{viewer.port}")
    assert (page.status, page.headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert page.body == (STATIC / "index.html").read_bytes()
    assert {name: page.headers.get(name) for name in HEADERS} == HEADERS
    assert "server" not in page.headers
    script = viewer.ask(f"/{TOKEN}/static/main.js", Sec_Fetch_Site="same-origin")
    assert (script.status, script.headers["content-type"]) == (200, "text/javascript; charset=utf-8")
    head = viewer.ask(f"/{TOKEN}/static/main.js", method="HEAD", Origin=f"http://127.0.0.1:{viewer.port}")
    assert (head.status, head.body) == (200, b"")


@pytest.mark.parametrize(
    "path",
    ["/", "//", "/api/session", "/static/main.js", "/wrong/", "/wrong", f"/{TOKEN}x", f"/{TOKEN}x/", f"/{TOKEN[:-1]}/",
     f"/x/../{TOKEN}/", f"//{TOKEN}/", f"/{TOKEN.upper()}/", "/%C3%A9/"],
)  # fmt: skip
def test_wrong_token_is_refused(viewer, path):
    assert refused(viewer.ask(path), 403)


def test_the_address_without_its_last_slash_leads_to_the_page(viewer):
    answer = viewer.ask(f"/{TOKEN}")
    assert (answer.status, answer.headers["location"]) == (307, f"/{TOKEN}/")
    assert {name: answer.headers.get(name) for name in HEADERS} == HEADERS
    assert viewer.ask(f"/{TOKEN}?tab=try").headers["location"] == f"/{TOKEN}/?tab=try"
    assert refused(viewer.ask(f"/{TOKEN}", host="rebound.example"), 403)
    assert refused(viewer.ask(f"/{TOKEN}", method="POST"), 405)


@pytest.mark.parametrize(
    "host",
    ["", "127.0.0.1", "localhost", "127.0.0.1:1", "[::1]:{port}", "0.0.0.0:{port}", "rebound.example:{port}",
     "127.0.0.1.rebound.example:{port}", "127.0.0.1:{port}.", "user@127.0.0.1:{port}", "127.1:{port}"],
)  # fmt: skip
def test_other_hosts_are_refused(viewer, host):
    answer = viewer.ask(f"/{TOKEN}/", host=host.format(port=viewer.port))
    assert refused(answer, 403) if host else answer.status in (400, 403)


def test_two_hosts_are_refused(viewer):
    with socket.create_connection(("127.0.0.1", viewer.port), timeout=10) as connection:
        own = f"127.0.0.1:{viewer.port}"
        connection.sendall(f"GET /{TOKEN}/ HTTP/1.1\r\nHost: {own}\r\nHost: x.example\r\n\r\n".encode())
        assert connection.recv(100).split()[1] in (b"400", b"403")


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "get"])
def test_other_methods_are_refused(viewer, method):
    answer = viewer.ask(f"/{TOKEN}/api/session", method=method)
    assert refused(answer, 405)
    assert answer.headers["allow"] == "GET, HEAD"


@pytest.mark.parametrize(
    "headers",
    [{"Origin": "http://rebound.example"}, {"Origin": "null"}, {"Origin": "https://127.0.0.1:{port}"},
     {"Sec_Fetch_Site": "cross-site"}, {"Sec_Fetch_Site": "same-site"}],
)  # fmt: skip
def test_other_sites_are_refused(viewer, headers):
    sent = {name: value.format(port=viewer.port) for name, value in headers.items()}
    assert refused(viewer.ask(f"/{TOKEN}/api/session", **sent), 403)


def test_the_page_alone_is_opened_from_elsewhere(viewer):
    opened = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "navigate", "Sec_Fetch_Dest": "document"}
    assert viewer.ask(f"/{TOKEN}/", **opened).status == 200
    for path in (f"/{TOKEN}/api/session", f"/{TOKEN}/static/main.js", "/wrong/", "/"):
        assert refused(viewer.ask(path, **opened), 403)
    for other in ({"Sec_Fetch_Dest": "iframe"}, {"Sec_Fetch_Mode": "no-cors"}, {"Origin": "http://rebound.example"}):
        assert refused(viewer.ask(f"/{TOKEN}/", **{**opened, **other}), 403)


def test_long_addresses_are_refused(viewer):
    assert refused(viewer.ask(f"/{TOKEN}/api/rows?text={'a' * 4096}"), 414)
    assert refused(viewer.ask(f"/{TOKEN}/{'a' * 4096}"), 414)
    assert viewer.ask(f"/{TOKEN}/api/rows?text={'a' * 3000}").status == 400  # no dataset is open


@pytest.mark.parametrize(
    "path",
    ["static/../app.py", "static/..%2Fapp.py", "static/%2e%2e/app.py", "static/%2e%2e%2fapp.py", "static//etc/passwd",
     "static/%2Fetc%2Fpasswd", "static/", "static", "static/main.js/", "static/main.js%00", "static/./main.js",
     "static/..\\app.py", "static/%5c..%5capp.py", "../", "%2e%2e/", "etc/passwd", "api", "api/", "api/session/",
     "static/main.js.map", "index.html"],
)  # fmt: skip
def test_nothing_but_the_table_is_served(viewer, path):
    assert refused(viewer.ask(f"/{TOKEN}/{path}"), 404)


def test_web_sockets_are_refused(viewer):
    with socket.create_connection(("127.0.0.1", viewer.port), timeout=10) as connection:
        lines = (
            f"GET /{TOKEN}/api/session HTTP/1.1", f"Host: 127.0.0.1:{viewer.port}", "Upgrade: websocket",
            "Connection: Upgrade", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version: 13", "", "",
        )  # fmt: skip
        connection.sendall("\r\n".join(lines).encode())
        assert b" 101 " not in connection.recv(100)
