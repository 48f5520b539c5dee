"""Bakes of a viewport, in a thread of their own, so that Blender's window goes on: a translation leaves out what is not baked
yet, and finds it when it comes again."""

import copy
import os
import threading
import traceback

from .baking import Baked, bake, nothing_to_bake
from .notes import LeftOut, Notes

MOST_KEPT = 64  # bakes that the last translation had no use for


class Pending(LeftOut):
    """What its volume is made of is not known yet."""


class Cancelled(Exception):
    """Nobody waits for a bake any longer."""


class Result:
    """What came of a bake, for all translations whose shader, grids and place are the same."""

    lasts = True  # whether it is kept when a translation has no use for it

    def __init__(self, baked, shader, notes):
        self._baked, self._notes = baked, notes
        self._left = [shader.closures.index(closure) for closure in baked.closures]
        self._told = shader.place.told
        self.elsewhere = not self._told  # whether it is the same at another place

    def is_there(self):
        return all(os.path.exists(path) for path, *_ in self._baked.files)

    def given(self, shader, source, notes):
        baked = copy.copy(self._baked)
        baked.closures = [shader.closures[i] for i in self._left]
        baked.parts, baked.glows = copy.deepcopy((baked.parts, baked.glows))  # which are merged in place
        baked.tell(source)
        shader.place.told = shader.place.told or self._told
        self._notes.tell(notes)
        return baked

    def drop(self):
        """Nobody will ask for it; its folder knows its files."""


class Failure:
    """A mistake in a bake, shown where its result is asked for."""

    elsewhere, lasts = False, True

    def __init__(self, text):
        self._text = text

    def is_there(self):
        return True

    def given(self, *_):
        raise RuntimeError(self._text)

    def drop(self):
        pass

    @staticmethod
    def of(function):
        """What a function of a job gives, or its Failure. @throws Cancelled"""
        try:
            return function()
        except Cancelled:
            raise
        except Exception as error:
            traceback.print_exc()
            return Failure(f"{type(error).__name__}: {error}")


class Job:
    def __init__(self, shader, source, folder, most_voxels):
        self.name, self.cancelled = shader.name, False
        self._shader, self._source, self._folder, self._most = shader, source, folder, most_voxels

    def run(self):
        """@throws Cancelled"""
        notes = self._shader.notes = Notes()
        return Failure.of(
            lambda: Result(bake(self._shader, self._source, self._folder, self._most, notes, self._check), self._shader, notes)
        )

    def _check(self):
        if self.cancelled:
            raise Cancelled


class Bakes:
    """Of a viewport, from one translation to the next: begin(), bake() of each shader and result() of each picture, settle()."""

    def __init__(self):
        self._lock = threading.Lock()
        self._done, self._jobs, self._asked, self._used = {}, {}, {}, set()  # by keys of what is baked
        self._thread, self._news = None, False

    def begin(self):
        """A translation begins."""
        self._asked, self._used = {}, set()

    def bake(self, shader, source, folder, most_voxels, notes):
        """As baking.bake. @throws Pending: it has to be baked first"""
        if nothing_to_bake(shader, source):
            return Baked(shader.closures)
        anywhere = (
            shader.name, shader.signature, most_voxels, repr((source.state(), source.grids, source.colours, source.factor, source.least)),
            repr((source.constants, source.to_copy(()))), shader.place.box_key(),
        )  # fmt: skip
        here = (*anywhere, shader.place.key())
        self._used.update((anywhere, here))
        with self._lock:
            found = self._done.get(anywhere) or self._done.get(here)
        if found is not None and found.is_there():
            return found.given(shader, source, notes)
        self._asked[here] = (anywhere, Job(shader, source, folder, most_voxels))
        raise Pending("what its nodes compute is being baked")

    def result(self, key, made):
        """What came of a job. @param key  of what it gives   @param made  function that gives the job, where it has to be done
        @throws Pending"""
        self._used.add(key)
        with self._lock:
            found = self._done.get(key)
            known = self._asked.get(key) or self._jobs.get(key)
        if found is not None and found.is_there():
            return found
        self._asked[key] = known or (key, made())
        raise Pending("what its nodes compute is being baked")

    def settle(self):
        """A translation has ended: ends the bakes that it has not asked for, and begins those that it has.
        @return the names of what they are of"""
        with self._lock:
            for key in [key for key in self._jobs if key not in self._asked]:
                self._jobs.pop(key)[1].cancelled = True
            unused = {key: result.lasts for key, result in self._done.items() if key not in self._used}
            lasting = [key for key, lasts in unused.items() if lasts]
            for key in [key for key, lasts in unused.items() if not lasts] + lasting[:-MOST_KEPT]:
                self._done.pop(key).drop()
            for key, job in self._asked.items():
                self._jobs.setdefault(key, job)
            if self._jobs and self._thread is None:
                self._thread = threading.Thread(target=self._run, daemon=True)
                self._thread.start()
            return [job.name for _, job in self._jobs.values()]

    def news(self):
        """Whether all that was asked for has been baked since the last call."""
        with self._lock:
            news, self._news = self._news and not self._jobs, self._news and bool(self._jobs)
            return news

    def busy(self):
        with self._lock:
            return bool(self._jobs)

    def close(self):
        self.begin()
        self.settle()
        thread = self._thread
        if thread is not None:
            thread.join()

    def _run(self):
        while True:
            with self._lock:
                if not self._jobs:
                    self._thread = None
                    return
                here, (anywhere, job) = next(iter(self._jobs.items()))
            try:
                result = job.run()
            except Cancelled:
                continue
            with self._lock:
                if job.cancelled:
                    result.drop()
                else:
                    del self._jobs[here]
                    self._done[anywhere if result.elsewhere else here] = result
                    self._news = True
