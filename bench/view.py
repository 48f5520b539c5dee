#!/usr/bin/env python3
"""How fast `brume view` answers: medians and 95th percentiles of what a person waits for, as a Markdown table.

usage: bench/view.py [--brume build/release/brume] [--size 640x480] [--repeat 40] [SCENE ...]

Without scenes: the clone's cloud and smoke. Times are those of a page on this machine, from the message to the whole
picture: the first picture after the start, a drag of the camera, the whole picture after it rests, a changed sun, albedo
and density, and the first clean picture. Needs nothing but Python.
"""

import argparse
import base64
import json
import os
import socket
import statistics
import struct
import subprocess
import time


class Page:
    """The page's end of the WebSocket."""

    def __init__(self, address):
        place, _, path = address[len("http://") :].partition("/")
        host, _, port = place.rpartition(":")
        self.socket = socket.create_connection((host, int(port)))
        self.bytes = b""
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            f"GET /{path}live HTTP/1.1\r\nHost: {place}\r\nOrigin: http://{place}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n".encode()
        )
        while b"\r\n\r\n" not in self.bytes:
            self.bytes += self.socket.recv(65536)
        self.bytes = self.bytes.partition(b"\r\n\r\n")[2]
        self.number = 0

    def take(self, count):
        pieces, there = [self.bytes], len(self.bytes)
        while there < count:
            more = self.socket.recv(1 << 20)
            if not more:
                raise SystemExit("view.py: the server has gone")
            pieces.append(more)
            there += len(more)
        data = b"".join(pieces)
        taken, self.bytes = data[:count], data[count:]
        return taken

    def frame(self):
        first, second = self.take(2)
        length = second & 127
        if length == 126:
            length = struct.unpack(">H", self.take(2))[0]
        elif length == 127:
            length = struct.unpack(">Q", self.take(8))[0]
        return first, self.take(length)

    def receive(self):
        """A message: text, or the header of a picture."""
        first, data = self.frame()
        pieces = [data]
        while not first & 0x80:
            more, piece = self.frame()
            first |= more & 0x80
            pieces.append(piece)
        data = b"".join(pieces)
        if first & 15 == 2:
            length = struct.unpack("<I", data[:4])[0]
            return {"type": "picture", **json.loads(data[4 : 4 + length])}
        return json.loads(data) if first & 15 == 1 else {"type": "other"}

    def look(self, size, assignments, moving, wanted):
        """Seconds until a picture that is wanted."""
        self.number += 1
        message = {"type": "look", "id": self.number, "set": assignments, "size": size, "moving": moving, "layers": ["picture"]}
        data = json.dumps(message).encode()
        head = b"\x81" + (bytes([0x80 | len(data)]) if len(data) < 126 else bytes([0xFE]) + struct.pack(">H", len(data)))
        start = time.perf_counter()
        self.socket.sendall(head + b"\0\0\0\0" + data)
        while True:
            message = self.receive()
            if message["type"] == "problem":
                raise SystemExit(f"view.py: {message['text']}")
            if message["type"] == "picture" and message["id"] == self.number and wanted(message):
                return time.perf_counter() - start, message


def measure(brume, scene, size, repeat):
    start = time.perf_counter()
    program = subprocess.Popen([brume, "view", scene, "-q"], stdout=subprocess.PIPE, text=True)
    try:
        page = Page(program.stdout.readline().strip())
        page.look(size, [], False, lambda p: True)
        rows = [("first picture after the start", [time.perf_counter() - start])]
        page.look(size, [], False, lambda p: p["stage"] == "clean")
        angle = iter(range(1, 1 << 20))

        def camera():
            return [f"camera.fov={30 + 0.1 * (next(angle) % 50)}"]

        drags = [page.look(size, camera(), True, lambda p: True) for _ in range(repeat)]
        rows.append((f"drag ({drags[-1][1]['width']} x {drags[-1][1]['height']})", [d[0] for d in drags]))
        few = max(3, repeat // 5)
        keys = [camera() for _ in range(few)]
        rows.append(("key, first picture", [page.look(size, key, False, lambda p: True)[0] for key in keys]))
        rows.append(("rest, whole picture", [page.look(size, camera(), False, lambda p: p["full"])[0] for _ in range(few)]))
        for name, assignment in (
            ("changed sun", "lights.0.direction=[-0.8, {}, 0.6]"),
            ("changed albedo", "volumes.0.albedo={}"),
            ("changed density", "volumes.0.density={}"),
            ("changed anisotropy", "volumes.0.g={}"),
        ):
            rows.append((name, [page.look(size, [assignment.format(0.3 + 0.4 * i / few)], True, lambda p: True)[0] for i in range(few)]))
        seconds = [page.look(size, [f"camera.fov={31 + i}"], False, lambda p: p["stage"] == "clean" and p["samples"] >= 8)[0] for i in range(3)]
        rows.append(("clean, 8 samples a pixel", seconds))
        return rows
    finally:
        program.terminate()
        program.wait()


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenes", nargs="*", default=["data/scenes/cloud.toml", "data/scenes/smoke.toml"])
    parser.add_argument("--brume", default="build/release/brume")
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--repeat", type=int, default=40)
    options = parser.parse_args()
    size = [int(n) for n in options.size.split("x")]
    print(f"| scene, {options.size} | median [s] | 95th percentile [s] | times |\n|---|---|---|---|")
    for scene in options.scenes:
        for name, seconds in measure(options.brume, scene, size, options.repeat):
            ordered = sorted(seconds)
            high = ordered[min(len(ordered) - 1, int(0.95 * len(ordered)))]
            print(f"| {os.path.basename(scene)}: {name} | {statistics.median(seconds):.3f} | {high:.3f} | {len(seconds)} |", flush=True)


if __name__ == "__main__":
    main()
