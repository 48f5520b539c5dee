"""The brume program as a child process: started, listened to, ended. Knows nothing of Blender.

The child holds the reading end of a pipe as its stdin and ends when that closes (--stop-with-stdin), which is what the
end of this process does, however it comes.
"""

import json
import queue
import subprocess
import threading
import time
from dataclasses import dataclass

# Exit statuses of the program.
DONE, MISSED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 3

PATIENCE = 0.3  # seconds that an interrupted program has before it is killed
PREFIX = "brume: "


@dataclass
class Progress:
    stage: str
    fraction: float
    seconds_left: object  # a number, or None: unknown


@dataclass
class Update:
    picture: str  # EXR that is there, whole
    samples: float  # per pixel, on average
    error: object  # relative, estimated; None: not known
    last: bool


class CannotStart(Exception):
    """Why a program does not run."""


class Child:
    """Runs `program arguments...` with progress as JSON. Its ends of pipes are closed by close(), or the with statement."""

    def __init__(self, program, arguments, folder=None, prints=False):
        """@param prints  whether line() is to be asked for what it prints   @throws CannotStart"""
        words = [str(word) for word in (program, *arguments, "--quiet", "--progress", "json", "--stop-with-stdin")]
        try:
            self._process = subprocess.Popen(
                words, cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE if prints else subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            )  # fmt: skip
        except OSError as error:
            raise CannotStart(f"{program} cannot be started: {error.strerror}") from None
        self._lines = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._said = []  # lines that are no JSON

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def _read(self):
        for line in self._process.stderr:
            self._lines.put(line.decode("utf-8", "replace").rstrip("\n"))

    @property
    def pid(self):
        return self._process.pid

    def ended(self):
        return self._process.poll() is not None

    def line(self):
        """The next line that it prints, waited for; empty: it has ended."""
        return self._process.stdout.readline().decode("utf-8", "replace").strip()

    def events(self, seconds):
        """What it has told since the last call: waits so long for something, and no longer for more."""
        found = []
        try:
            found += self._understood(self._lines.get(timeout=seconds))
            while True:
                found += self._understood(self._lines.get_nowait())
        except queue.Empty:
            return found

    def _understood(self, line):
        try:
            told = json.loads(line) if line.startswith("{") else None
        except ValueError:
            told = None
        if not isinstance(told, dict):
            self._said.append(line)
            return []
        if "picture" in told:
            return [Update(told["picture"], told["samples"], told["error"], told["last"])]
        if "progress" in told:
            return [Progress(told["stage"], told["progress"], told["seconds_left"])]
        return []

    def interrupt(self):
        """Asks it to end as Ctrl-C does, kills it where it does not, and waits for that."""
        self._process.terminate()
        if not self.ends_soon():
            self._process.kill()
        self._process.wait()

    def ends_soon(self):
        """Waits a little for its end. @return whether it came"""
        end = time.monotonic() + PATIENCE
        while not self.ended() and time.monotonic() < end:
            time.sleep(0.005)
        return self.ended()

    def close(self):
        """Ends it if it runs, and gives back what it used."""
        if not self.ended():
            self.interrupt()
        self._process.stdin.close()
        self._reader.join()
        self._process.stderr.close()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def finish(self):
        """Waits for its end and reads the rest. @return exit status; below 0: the signal that killed it; and the last events"""
        status = self._process.wait()
        self._reader.join()
        return status, self.events(0)

    def remarks(self):
        """Notes and warnings, without the words before them."""
        found = []
        for text in self._messages():
            for word in ("note: ", "warning: "):
                if text.startswith(word):
                    found.append(text[len(word) :])
        return found

    def problem(self, status):
        """What it said last that is neither note nor warning; else how it ended."""
        found = [text for text in self._messages() if not text.startswith(("note: ", "warning: "))]
        if found:
            return found[-1]
        if status < 0:
            return f"the program was killed by signal {-status}; was there enough memory?"
        return f"the program ended with status {status} and said nothing"

    def _messages(self):
        """Its words, those that go over several lines together, without the program's name."""
        messages = []
        for line in self._said:
            if line.startswith(PREFIX):
                messages.append(line[len(PREFIX) :])
            elif messages:
                messages[-1] += "\n" + line
            elif line:
                messages.append(line)
        return messages
