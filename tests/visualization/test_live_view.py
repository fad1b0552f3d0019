"""The page is served on loopback alone, and what a visitor is sent changes with each frame."""

from __future__ import annotations

import socket
import sys
from urllib.request import urlopen

import pytest

from robust6dof.errors import MissingExtraError
from robust6dof.visualization.live_view import LiveView
from visualization.tracked_mug import mug_views

ZSTD = b"\x28\xb5\x2f\xfd"
"""What every compressed message begins with, after its lengths."""


@pytest.fixture
def live():
    pytest.importorskip("viser", reason="extra viewer is not installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with LiveView(port) as page:
        yield page


def received(live: LiveView) -> bytes:
    """What a new visitor is sent until nothing more comes."""
    import viser
    import zstandard
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    protocol = Subprotocol(f"viser-v{viser.__version__}")
    parts: list[bytes] = []
    with connect(live.url.replace("http", "ws"), subprotocols=[protocol], max_size=None) as visitor:
        while True:
            try:
                message = visitor.recv(timeout=1.0)
            except TimeoutError:
                return b"".join(parts)
            assert isinstance(message, bytes)
            packed = message[message.index(ZSTD) :]
            parts.append(zstandard.ZstdDecompressor().decompressobj().decompress(packed))


def test_serves_a_page_on_loopback_alone(live: LiveView) -> None:
    assert live.url.startswith("http://127.0.0.1:")
    with urlopen(live.url, timeout=10) as page:
        assert page.status == 200
        assert b"<html" in page.read().lower()
    port = int(live.url.rsplit(":", 1)[1])
    with socket.socket() as other:
        other.settimeout(2.0)
        assert other.connect_ex(("127.0.0.2", port)) != 0, "bound to 127.0.0.1, nothing else"


def test_a_visitor_sees_the_latest_frame(live: LiveView) -> None:
    first, *_, last = mug_views()
    live.show(first)
    sent = received(live)
    for text in (b"frame 1 ", b"/cloud", b"/keypoints", b"/box", b"/axes", b"tracking"):
        assert text in sent
    live.show(last)
    sent = received(live)
    assert b"frame 2 " in sent
    assert b"frame 1 " not in sent


def test_without_viser_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'robust6dof\[viewer\]'"):
        LiveView()
