"""Progress, threads, processes, and how work ends."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import unittest

import numpy as np

import brume
from support import CLOUD, TINY, random_frame


class WhileItWorks(unittest.TestCase):
    def test_progress_rises_to_one_in_the_callers_thread(self):
        told = []
        brume.render(CLOUD, spp=16, **TINY, progress=lambda f: told.append((f, threading.get_ident())))
        self.assertEqual(told[-1][0], 1.0)
        self.assertEqual(sorted(told), told)
        self.assertEqual({thread for _, thread in told}, {threading.get_ident()})

    def test_an_exception_of_the_callback_ends_the_work(self):
        def refuse(fraction):
            raise LookupError("enough")

        with self.assertRaisesRegex(LookupError, "enough"):
            brume.render(CLOUD, spp=1 << 20, progress=refuse)

    def test_keyboard_interrupt_ends_the_work(self):
        # What Ctrl-C sends, once the render is on its way; without an answer to it this would take days.
        timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        self.addCleanup(timer.cancel)
        with self.assertRaises(KeyboardInterrupt):
            brume.render(CLOUD, spp=1 << 20)

    def test_daemon_threads_that_work_end_with_the_interpreter(self):
        # Without an end these would take days.
        script = """
import sys, threading, brume
begun = [threading.Event() for _ in range(3)]
def work(event):
    brume.render(sys.argv[1], spp=1 << 20, progress=lambda f: event.set())
for event in begun:
    threading.Thread(target=work, args=(event,), daemon=True).start()
for event in begun:
    event.wait()
"""
        end = subprocess.run([sys.executable, "-c", script, CLOUD], capture_output=True, text=True, check=False)
        self.assertEqual((end.returncode, end.stderr), (0, ""))
        # What is to be done at the end may use brume.
        script = "import atexit, sys, brume; atexit.register(lambda: print(brume.render(sys.argv[1], spp=1).shape)); brume.render(sys.argv[1], spp=1)"
        end = subprocess.run([sys.executable, "-c", script, CLOUD], capture_output=True, text=True, check=True)
        self.assertRegex(end.stdout, r"^\(\d+, \d+\)$")

    def test_other_threads_run_meanwhile(self):
        # The render would take days: it ends because the other thread gets on with its counting.
        counted = threading.Event()

        def count():
            for _ in range(100):
                time.sleep(0.001)
            counted.set()

        def stop_when_counted(fraction):
            if counted.is_set():
                raise StopIteration

        counter = threading.Thread(target=count)
        counter.start()
        with self.assertRaises(StopIteration):
            brume.render(CLOUD, spp=1 << 20, progress=stop_when_counted)
        counter.join()

    def test_several_processes_may_clean_at_once(self):
        frames = [random_frame(23, 37), random_frame(11, 7)]
        with multiprocessing.get_context("spawn").Pool(2) as pool:
            for frame, clean in zip(frames, pool.map(brume.denoise, frames)):
                np.testing.assert_array_equal(clean.image(), brume.denoise(frame).image())

    def test_several_threads_may_clean_at_once(self):
        frame, results = random_frame(), []
        expected = brume.denoise(frame, "nl_means").image()
        workers = [threading.Thread(target=lambda: results.append(brume.denoise(frame, "nl_means"))) for _ in range(4)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        self.assertEqual(len(results), 4)
        for result in results:
            np.testing.assert_array_equal(result.image(), expected)


if __name__ == "__main__":
    unittest.main()
