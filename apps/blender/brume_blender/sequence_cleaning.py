"""Cleans an animation that Cycles has rendered, as multilayer EXRs: guides of each frame's volumes as Blender has them,
then `brume denoise` over the sequence. Files come back as they were, with every channel; they change all together at the
end, or not at all."""

import contextlib
import os
import re
import shutil
import tempfile
from dataclasses import dataclass, field

import bpy

from . import program
from .child import DONE, Child, Progress
from .translate import CannotTranslate, translate

REACH = 3  # frames before and after that a filter may look at
CHUNK = 8  # frames whose guides are on disk at once, beside those
BESIDE = "of the frames beside it"  # how the program names those that are missing
LOOK = 0.1  # seconds between two looks at whether to stop


class Problem(Exception):
    """Why nothing was cleaned, or not all of it."""


@dataclass
class Options:
    pattern: str  # of the frames' files, with #### for the number
    frames: list
    suffix: str = ""  # of the clean files' names, before the number's #s; empty: they replace the noisy ones
    filter: str = ""  # NAME or NAME:parameter=value,...; empty: the best for the file
    program: str = ""  # as the preferences say
    threads: int = 0  # 0: all
    notes: list = field(default_factory=list)  # filled: what the user should know


def pattern_of(path):
    """A file name with #### where a frame's number goes, as Blender completes the name of a render's output."""
    path = bpy.path.abspath(path)
    if "#" not in os.path.basename(path):
        return path + "####.exr"
    return path if path.lower().endswith(".exr") else path + ".exr"


def file_of(pattern, frame):
    return re.sub("#+", lambda hashes: f"{frame:0{len(hashes.group())}}", pattern)


def clean_name(pattern, suffix):
    """The pattern of the clean files: the suffix before the number."""
    folder, name = os.path.split(pattern)
    stem, hashes, rest = re.match("([^#]*)(#+)(.*)", name).groups()
    separator = stem[-1:] if stem[-1:] in ("_", ".", "-") else ""
    return os.path.join(folder, stem[: len(stem) - len(separator)] + suffix + separator + hashes + rest)


def check(options):
    """@throws Problem: there is nothing to clean, or not all of it"""
    if not options.frames:
        raise Problem("no frames to clean")
    if min(options.frames) < 0:
        raise Problem(f"frame {min(options.frames)}: brume counts frames from 0")
    if "#" not in os.path.basename(options.pattern):
        raise Problem(f"{options.pattern}: expected a name with #### where the frame's number goes")
    missing = [frame for frame in options.frames if not os.path.isfile(file_of(options.pattern, frame))]
    if missing:
        more = f", and {len(missing) - 1} more are not there" if len(missing) > 1 else ""
        raise Problem(f"{file_of(options.pattern, missing[0])} is not there{more}; render the animation as OpenEXR MultiLayer first")


def clean(scene, view_layer, options):
    """A generator that does it step by step and yields (share that is done, what is being done); closing it cancels.

    The scene goes through its frames, and back to where it was. @throws Problem, NoProgram, CannotStart"""
    check(options)
    target = clean_name(options.pattern, options.suffix) if options.suffix else options.pattern
    home = os.path.dirname(target)
    before = scene.frame_current
    with contextlib.ExitStack() as stack:
        stack.callback(lambda: scene.frame_set(before))
        work = stack.enter_context(_folder(bpy.app.tempdir))
        made = stack.enter_context(_folder(home))  # renamed from there in one step
        job = _Job(scene, view_layer, options, program.find(options.program), work, os.path.join(made, os.path.basename(target)))
        yield from job.run()
        for frame in options.frames:
            os.replace(file_of(job.output, frame), file_of(target, frame))


@contextlib.contextmanager
def _folder(where):
    path = tempfile.mkdtemp(prefix=".brume_clean_", dir=where)
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)


class _Job:
    def __init__(self, scene, view_layer, options, path, work, output):
        self._scene, self._view_layer, self._options = scene, view_layer, options
        self._program, self._work, self.output = path, work, output
        self._guides = os.path.join(work, "guides.####.exr")
        self._there = set()  # frames whose guides are there

    def run(self):
        frames = self._options.frames
        steps, done = 2 * len(frames), 0
        for start in range(0, len(frames), CHUNK):
            chunk = frames[start : start + CHUNK]
            reached = [f for f in frames if chunk[0] - REACH <= f <= chunk[-1] + REACH]
            for frame in sorted(self._there - set(reached)):
                os.remove(file_of(self._guides, frame))
                self._there.remove(frame)
            for frame in (f for f in reached if f not in self._there):
                for share in self._make_guides(frame):
                    yield (done + share) / steps, f"guides of frame {frame}"
                self._there.add(frame)
                done += 1
            for share in self._denoise(chunk):
                yield (done + share * len(chunk)) / steps, f"cleaning frames {chunk[0]} to {chunk[-1]}"
            done += len(chunk)

    def _make_guides(self, frame):
        scene = os.path.join(self._work, f"frame_{frame}")
        os.mkdir(scene)
        self._translate(frame, scene)
        like = file_of(self._options.pattern, frame)
        words = ["guides", "--like", like, "--scene", os.path.join(scene, "scene.toml"), "-o", file_of(self._guides, frame)]
        yield from self._run(words, f"guides of frame {frame}")
        shutil.rmtree(scene)

    def _translate(self, frame, folder):
        self._scene.frame_set(frame)
        depsgraph = self._view_layer.depsgraph
        try:
            result = translate(depsgraph, self._scene, folder, set_frame=lambda f, sub: self._scene.frame_set(f, subframe=sub))
        except CannotTranslate as reason:
            raise Problem(f"frame {frame}: {reason}") from None
        if not result.volumes:
            raise Problem(f"frame {frame}: there is no volume in it that brume can make guides of: {'; '.join(result.notes)}")
        self._note(result.notes)
        with open(os.path.join(folder, "scene.toml"), "w", encoding="utf-8") as file:
            file.write(result.text)

    def _denoise(self, chunk):
        words = ["denoise", self._options.pattern, "--frames", ",".join(map(str, chunk)), "--guides", self._guides]
        words += ["--keep-file", "-o", self.output]
        if self._options.filter:
            words += ["-f", self._options.filter]
        yield from self._run(words, f"frames {chunk[0]} to {chunk[-1]}")

    def _run(self, words, what):
        if self._options.threads:
            words = [*words, "--threads", self._options.threads]
        with Child(self._program, words) as child:
            share = 0.0
            yield share
            while not child.ended():
                for event in child.events(LOOK):
                    if isinstance(event, Progress):
                        share = event.fraction
                yield share
            status, _ = child.finish()
            if status != DONE:
                raise Problem(f"{what}: {child.problem(status)}")
            self._note(child.remarks())

    def _note(self, texts):
        for text in texts:
            # Before the first frame and after the last there are none.
            if BESIDE not in text and text not in self._options.notes:
                self._options.notes.append(text)
