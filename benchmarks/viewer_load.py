"""Load on the viewer's server: idle connections, clients that send slow headers, and requests meanwhile.

Run as ``python benchmarks/viewer_load.py``; the server is a process of its own on this computer (Linux).
"""

from __future__ import annotations

import argparse
import http.client
import resource
import signal
import socket
import statistics
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import urlsplit

PATHS = ("", "static/main.js", "api/session")
"""What the requests ask for, one after the other."""
CLIENTS = 4
"""Browsers that ask at the same time."""


def main() -> None:
    """Start a viewer, load it and print a table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--idle", type=int, default=1000)
    options.add_argument("--slow", type=int, default=100)
    options.add_argument("--requests", type=int, default=20_000)
    chosen = options.parse_args()
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # of the clients: the server has its own limits
    command = [sys.executable, "-m", "doppelgait", "view", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server, ExitStack() as ends:
        assert server.stdout is not None
        url = urlsplit(server.stdout.readline().strip())
        address = (str(url.hostname), int(url.port or 0))
        measure(address, url.path, CLIENTS * 50)  # the first picture is made, and all modules are loaded
        time.sleep(5.0)
        rows = [("alone", *measure(address, url.path, chosen.requests // 10), memory_mb(server.pid))]
        for _ in range(chosen.idle):
            ends.enter_context(socket.create_connection(address))
        rows.append((f"{chosen.idle:,} idle connections", *measure(address, url.path, 200), memory_mb(server.pid)))
        stop = threading.Event()
        slow = threading.Thread(target=send_slowly, args=(address, chosen.slow, stop))
        slow.start()
        found = measure(address, url.path, chosen.requests)
        stop.set()
        slow.join()
        rows.append((f"and {chosen.slow} slow clients, {chosen.requests:,} requests", *found, memory_mb(server.pid)))
        server.send_signal(signal.SIGINT)
    print(f"{'':40} median ms   99 % ms   largest ms   failed   server MB")
    for name, median_ms, late_ms, largest_ms, failed, used_mb in rows:
        print(f"{name:40} {median_ms:9.2f} {late_ms:9.2f} {largest_ms:12.2f} {failed:8} {used_mb:11.0f}")


def measure(address: tuple[str, int], base: str, count: int) -> tuple[float, float, float, int]:
    """Ask so many times, each client on one connection; median, 99th percentile and largest latency (ms), failures."""
    latencies: list[float] = []
    failed: list[str] = []

    def ask(own: int) -> None:
        connection = http.client.HTTPConnection(*address, timeout=60)
        for number in range(own):
            began = time.perf_counter()
            try:
                connection.request("GET", base + PATHS[number % len(PATHS)])
                answer = connection.getresponse()
                answer.read()
                if answer.status != 200:
                    failed.append(str(answer.status))
            except (OSError, http.client.HTTPException):  # closed in between: a browser asks again
                failed.append("closed")
                connection.close()
            latencies.append(1e3 * (time.perf_counter() - began))
        connection.close()

    threads = [threading.Thread(target=ask, args=(count // CLIENTS,)) for _ in range(CLIENTS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return statistics.median(latencies), statistics.quantiles(latencies, n=100)[98], max(latencies), len(failed)


def send_slowly(address: tuple[str, int], count: int, stop: threading.Event) -> None:
    """Keep so many clients that send a byte of their headers a second, and begin anew when they are closed."""
    clients: list[socket.socket] = []
    while not stop.wait(1.0):
        while len(clients) < count:
            clients.append(socket.create_connection(address))
            clients[-1].sendall(b"GET / HTTP/1.1\r\nX: ")
        for client in clients[:]:
            try:
                client.sendall(b"x")
            except OSError:
                client.close()
                clients.remove(client)
    for client in clients:
        client.close()


def memory_mb(process: int) -> float:
    """Resident memory of a process."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))


if __name__ == "__main__":
    main()
