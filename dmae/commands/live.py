"""`dmae live`: poses of frames as they arrive, for other programs."""

import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from socketserver import StreamRequestHandler, TCPServer

from dmae.completion.complete import SMOOTHING, completers
from dmae.data.skeleton import get_skeleton
from dmae.formats.calibrations import read_calibration
from dmae.online.capture import OnlineCapture
from dmae.online.json_lines import LONGEST, answer_lines
from dmae.reconstruction.config import CaptureConfig

WRITES = None
EXAMPLES = (
    "dmae live calibration=rig.toml fps=25 < frames.jsonl > poses.jsonl",
    "dmae live calibration=rig.toml fps=25 complete=true listen=127.0.0.1:5555",
)


@dataclass(frozen=True)
class LiveCommand:
    """Answer detections of frames with poses, as lines of JSON (see `dmae.online.json_lines` or the documentation).

    Frames are read from standard input and answered on standard output, or on a socket with `listen`.
    """

    calibration: str = "???"
    """Calibration file of any supported format, or its folder."""
    fps: float = "???"
    """1/s; rate at which frames arrive."""
    skeleton: str = "body25"
    """Skeleton of the detections."""
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    complete: bool = False
    """Also complete the joints that no camera measured; this adds to the delay."""
    weights: str | None = None
    """Folder that `dmae train` wrote; by default the weights that come with the package."""
    look_ahead: float | None = None
    """s; longest time that any step waits for later frames. Less than the 0.4 of capture and the 0.28 of completion
    reduces accuracy; by default the time that they use."""
    listen: str | None = None
    """host:port to listen on, for one program at a time; each connection starts a new capture. By default standard
    input."""


def run(config: LiveCommand, out: None) -> None:
    rig, skeleton = read_calibration(Path(config.calibration)), get_skeleton(config.skeleton)
    completer = None
    if config.complete:
        weights = Path(config.weights) if config.weights else None
        completer = completers(weights, denoise=None, reject=True, smooth=SMOOTHING)(skeleton)

    def answers(lines: Iterable[str]) -> Iterable[str]:
        capture = OnlineCapture(rig, skeleton, config.fps, config.capture, completer, config.look_ahead)
        return answer_lines(lines, capture, rig.names, skeleton, config.fps)

    if config.listen is None:
        for line in answers(sys.stdin):
            print(line, flush=True)
        return

    class Handler(StreamRequestHandler):
        def handle(self) -> None:
            # A longer line is cut and then refused, so that no sender can fill the memory.
            read = iter(lambda: self.rfile.readline(LONGEST + 1), b"")
            try:
                for line in answers(part.decode(errors="replace") for part in read):
                    self.wfile.write(f"{line}\n".encode())
            except OSError:
                pass  # the connected program has closed the connection

    with TCPServer(_address(config.listen), Handler) as server:
        host, port = server.server_address[:2]
        print(f"listening on {host}:{port}", flush=True)
        server.serve_forever()


def _address(text: str) -> tuple[str, int]:
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdigit() or int(port) > 65535:
        raise ValueError(f"listen={text}: expected host:port, as 127.0.0.1:5555")
    return host, int(port)
