"""`dmae live`: poses of frames as they arrive, for other programs."""

import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from io import BufferedIOBase
from pathlib import Path
from socketserver import StreamRequestHandler, TCPServer
from typing import Any

from dmae.commands.config import LiveCommand
from dmae.completion.complete import completers
from dmae.data.skeleton import get_skeleton
from dmae.formats.calibrations import read_calibration
from dmae.online.capture import OnlineCapture
from dmae.online.json_lines import LONGEST, answer_lines
from dmae.progress import LINE_EVERY


def run(config: LiveCommand, out: None) -> None:
    rig = read_calibration(Path(config.calibration), **asdict(config.world))
    skeleton = get_skeleton(config.skeleton)
    completer = None
    if config.complete:
        completer = completers(config.weights)(skeleton)

    def answers(lines: Iterable[str]) -> Iterable[str]:
        capture = OnlineCapture(rig, skeleton, config.fps, config.capture, completer, config.look_ahead)
        return answer_lines(timed(lines, config.fps), capture, rig.names, skeleton, config.fps)

    if config.listen is None:
        for line in answers(sys.stdin):
            print(line, flush=True)
        return

    answers(())  # Options that it refuses are refused before a program connects

    class Handler(StreamRequestHandler):
        def handle(self) -> None:
            try:
                for line in answers(lines_of(self.rfile)):
                    self.wfile.write(f"{line}\n".encode())
            except OSError:
                pass  # the connected program has closed the connection

    host, _, port = config.listen.rpartition(":")
    try:
        waiting = TCPServer((host, int(port)), Handler)
    except OSError as error:
        raise ValueError(f"listen={config.listen}: {error.strerror or error}; give another address or port") from None
    with waiting as server:
        address: Any = server.server_address
        print(f"listening on {address[0]}:{address[1]}", flush=True)
        server.serve_forever()


def timed(lines: Iterable[str], fps: float) -> Iterator[str]:
    """Yield lines of frames; say on stderr, each minute and at the end, if answering takes longer than frames last.

    The first second of frames does not count: it loads and compiles.
    """
    frames, busy, said, warm_up = 0, 0.0, time.monotonic(), round(fps)

    def say() -> None:
        if busy > frames / fps:
            took, there = (f"{1000 * seconds:.3g} ms" for seconds in (busy / frames, 1 / fps))
            print(
                f"answers fall behind the cameras: a frame took {took}, and there are {there} at {fps:g} frames/s",
                file=sys.stderr,
                flush=True,
            )

    try:
        for line in lines:
            start = time.monotonic()
            yield line
            now = time.monotonic()
            if warm_up > 0:
                warm_up -= 1
                continue
            frames, busy = frames + 1, busy + now - start
            if now >= said + LINE_EVERY:
                say()
                frames, busy, said = 0, 0.0, now
    finally:
        say()


def lines_of(stream: BufferedIOBase) -> Iterator[str]:
    """Yield the lines of a stream. A longer line is cut and then refused, so that no sender can fill the memory."""
    while part := stream.readline(LONGEST + 1):
        yield part.decode(errors="replace")
        while len(part) > LONGEST and not part.endswith(b"\n"):
            part = stream.readline(LONGEST + 1)
