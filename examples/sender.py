"""Play a radar recording as a live source, in real time or faster.

    python examples/sender.py RECORDING                          # to standard output: ... | doppelgait live -
    python examples/sender.py RECORDING tcp://127.0.0.1:7290     # to a listening doppelgait live
    python examples/sender.py RECORDING udp://127.0.0.1:7290
    python examples/sender.py RECORDING walk.dgf                 # a growing file
    python examples/sender.py RECORDING tcp://127.0.0.1:7290 --speed 10 --seconds 60

A sensor's own program does the same: a header, then one record a frame, in the format that docs/howto/live.md lists.
"""

from __future__ import annotations

import argparse
import socket
import sys
import time
from collections.abc import Callable, Iterator
from itertools import chain, islice
from urllib.parse import urlsplit

from doppelgait.radar import open_stream
from doppelgait.radar.frames import END_RECORD, Header, encode_frame, encode_header

HEADER_PERIOD_S = 1.0
"""Time between headers in datagrams, for receivers that start later."""
CONNECT_S = 10.0
"""How long a receiver that does not listen yet is waited for."""


def connect(address: tuple[str, int]) -> socket.socket:
    """Connect to a receiver, which may start a little later."""
    stop_s = time.monotonic() + CONNECT_S
    while True:
        try:
            return socket.create_connection(address, timeout=CONNECT_S)
        except ConnectionRefusedError:
            if time.monotonic() > stop_s:
                raise
            time.sleep(0.1)


def pieces(source: str, speed: float, seconds: float | None) -> Iterator[tuple[bytes, bytes]]:
    """Yield (header, record) of every frame when its time has come."""
    with open_stream(source, timeout_s=0) as stream:
        opening = encode_header(Header(stream.radar, stream.range_m))
        stop = None if seconds is None else round(seconds * stream.radar.prf_hz)
        begun_s, first_s = time.monotonic(), None
        for number, (time_s, row) in enumerate(islice(stream, stop)):
            first_s = time_s if first_s is None else first_s
            if speed and (wait_s := begun_s + (time_s - first_s) / speed - time.monotonic()) > 0:
                time.sleep(wait_s)
            yield opening, encode_frame(number, time_s, row)
    yield opening, END_RECORD


def main() -> None:
    """Send what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", help="a doppelgait recording (.h5), frames (.dgf) or a XeThru data file")
    parser.add_argument("target", nargs="?", default="-", help="-, tcp://HOST:PORT, udp://HOST:PORT or a file")
    parser.add_argument("--speed", type=float, default=1.0, help="times real time; 0: as fast as possible")
    parser.add_argument("--seconds", type=float, help="play only so much")
    given = parser.parse_args()
    played, parts = pieces(given.recording, given.speed, given.seconds), urlsplit(given.target)
    opening, record = next(played)
    records = chain([record], (one for _, one in played))
    if parts.scheme == "udp":
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            due_s = 0.0
            for one in records:
                if time.monotonic() >= due_s:  # a receiver that starts later needs a header, too
                    sender.sendto(opening, (parts.hostname, parts.port))
                    due_s = time.monotonic() + HEADER_PERIOD_S
                sender.sendto(one, (parts.hostname, parts.port))
        return
    if parts.scheme == "tcp":
        with connect((parts.hostname, parts.port)) as sender:
            _send(sender.sendall, opening, records)
    elif given.target == "-":
        _send(lambda one: (sys.stdout.buffer.write(one), sys.stdout.buffer.flush()), opening, records)
    else:
        with open(given.target, "wb", buffering=0) as file:
            _send(file.write, opening, records)


def _send(write: Callable[[bytes], object], opening: bytes, records: Iterator[bytes]) -> None:
    write(opening)
    for one in records:
        write(one)


if __name__ == "__main__":
    try:
        main()
    except (BrokenPipeError, ConnectionResetError):
        sys.exit("the receiver has gone")
    except KeyboardInterrupt:
        sys.exit(130)
