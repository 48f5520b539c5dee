"""A scene that is looked at: the program `brume view` as a child process, and the WebSocket over which it is told what to show
and sends pictures (docs/view.md, For programs). Knows NumPy and nothing of Blender."""

import base64
import json
import os
import socket
import struct
import threading
from dataclasses import dataclass

import numpy as np

from .child import Child

PATIENCE = 30  # seconds for a handshake
LARGEST = 1 << 30  # bytes of a message
TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10  # kinds of frames


class Gone(Exception):
    """The other end has closed, or says what is no WebSocket."""


class WebSocket:
    """One page's end of it. One thread may receive while another one sends."""

    def __init__(self, address):
        """@param address  as the program prints it, http://HOST:PORT/SECRET/   @throws OSError, Gone"""
        place, _, path = address.partition("://")[2].partition("/")
        host, _, port = place.rpartition(":")
        self._socket = socket.create_connection((host.strip("[]"), int(port)), PATIENCE)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sending = threading.Lock()
        self._bytes = b""
        key = base64.b64encode(os.urandom(16)).decode()
        self._socket.sendall(
            f"GET /{path}live HTTP/1.1\r\nHost: {place}\r\nOrigin: http://{place}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n".encode()
        )
        answer = b""
        while not answer.endswith(b"\r\n\r\n"):
            answer += self._take(1)
        if not answer.startswith(b"HTTP/1.1 101"):
            raise Gone(answer.partition(b"\r\n")[0].decode("utf-8", "replace"))
        self._socket.settimeout(None)

    def close(self):
        """Ends a receive() of another thread, too."""
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass  # it is closed
        self._socket.close()

    def send(self, text):
        self._send(TEXT, text.encode())

    def receive(self):
        """The next message: text, or bytes. @throws OSError, Gone"""
        kind, pieces, last = None, [], False
        while not last:
            first, data = self._frame()
            if first & 15 == PING:
                self._send(PONG, data)
            elif first & 15 == CLOSE:
                raise Gone("closed")
            elif first & 15 != PONG:
                kind = first & 15 or kind
                pieces.append(data)
                last = first & 0x80
        data = b"".join(pieces)
        return data.decode("utf-8", "replace") if kind == TEXT else data

    def _frame(self):
        first, second = self._take(2)
        length = second & 127
        if length == 126:
            (length,) = struct.unpack(">H", self._take(2))
        elif length == 127:
            (length,) = struct.unpack(">Q", self._take(8))
        if second & 128 or length > LARGEST:
            raise Gone("no frame of a server")
        return first, self._take(length)

    def _send(self, kind, data):
        """Masked by zeros, as a client's frames must be by something."""
        length = len(data)
        head = bytes([0x80 | kind])
        if length < 126:
            head += bytes([0x80 | length])
        else:
            head += bytes([0x80 | 126]) + struct.pack(">H", length) if length < 1 << 16 else bytes([0x80 | 127]) + struct.pack(">Q", length)
        with self._sending:
            self._socket.sendall(head + bytes(4) + data)

    def _take(self, count):
        pieces, there = [self._bytes], len(self._bytes)
        while there < count:
            more = self._socket.recv(1 << 20)
            if not more:
                raise Gone("closed")
            pieces.append(more)
            there += len(more)
        data = b"".join(pieces)
        taken, self._bytes = data[:count], data[count:]
        return taken


@dataclass
class Picture:
    """One layer, half floats of (channels, height, width), rows from the top, and what the program says of it."""

    values: np.ndarray
    about: dict

    @staticmethod
    def of(data):
        (length,) = struct.unpack_from("<I", data)
        about = json.loads(data[4 : 4 + length])
        shape = about["channels"], about["height"], about["width"]
        return Picture(np.frombuffer(data, "<f2", offset=4 + length).reshape(shape), about)


class Live:
    """Looks at a scene's file from a thread of its own. Of what is asked and answered the newest alone counts."""

    def __init__(self, program, scene, words=()):
        """@throws CannotStart"""
        self._child = Child(program, ["view", scene, *words], prints=True)
        self._lock = threading.Lock()
        self._web, self._look, self._number = None, None, 0
        self._pictures, self._progress, self._problem, self._news = {}, {}, None, False
        self._light_groups = []
        self._why_it_ended = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def pid(self):
        return self._child.pid

    def look(self, **asked):
        """Asks for pictures, as docs/view.md says. @return the number by which answers name this look"""
        with self._lock:
            self._number += 1
            self._look = json.dumps({"type": "look", "id": self._number, **asked})
            self._problem = None
            web = self._web
        if web is not None:
            self._send(web)
        return self._number

    def news(self):
        """Whether a picture, other light groups or a problem came since the last call."""
        with self._lock:
            news, self._news = self._news, False
            return news

    def rests(self):
        """Whether nothing more comes of the last look."""
        with self._lock:
            done = self._progress.get("id") == self._number and self._progress.get("stage") == "done"
            return done or self._problem is not None or self._why_it_ended is not None

    def pictures(self):
        """The newest of each layer, by its name."""
        with self._lock:
            return dict(self._pictures)

    def progress(self):
        with self._lock:
            return self._progress

    def problem(self):
        """What is wrong with the last look, or why the program has ended; None: nothing."""
        with self._lock:
            return self._why_it_ended or self._problem

    def light_groups(self):
        """Names of those that the scene has and that can be mixed, as it was read last."""
        with self._lock:
            return self._light_groups

    def ended(self):
        with self._lock:
            return self._why_it_ended is not None

    def close(self):
        """Ends the program."""
        with self._lock:
            web = self._web
        if web is not None:
            web.close()
        self._child.interrupt()
        self._thread.join()
        self._child.close()

    def _send(self, web):
        with self._lock:
            text, self._look = self._look, None
        if text is not None:
            try:
                web.send(text)
            except OSError:
                pass  # the thread finds it closed

    def _run(self):
        try:
            address = self._child.line()
            if address:
                web = WebSocket(address)
                with self._lock:
                    self._web = web
                self._send(web)
                while True:
                    self._hear(web.receive())
        except (OSError, Gone, ValueError, KeyError) as reason:
            gone = f"the program's answers ended: {reason}"
        else:
            gone = None
        by_itself = self._child.ends_soon()
        if not by_itself:
            self._child.interrupt()
        status, _ = self._child.finish()
        with self._lock:
            self._why_it_ended, self._news = self._child.problem(status) if by_itself else gone, True

    def _hear(self, message):
        picture = Picture.of(message) if isinstance(message, bytes) else None
        told = json.loads(message) if picture is None else None
        with self._lock:
            if picture is not None:
                self._pictures[picture.about["layer"]], self._news = picture, True
            elif told["type"] == "progress":
                self._progress = told
            elif told["type"] == "scene":
                groups = told.get("light_groups", [])
                self._news = self._news or groups != self._light_groups
                self._light_groups = groups
            elif told["type"] == "problem" and told["id"] in (0, self._number):
                self._problem, self._news = told["text"], True
