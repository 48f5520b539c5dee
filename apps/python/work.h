#pragma once
#include <pybind11/pybind11.h>

#include <functional>
#include <string>

#include "base/progress.h"
#include "image/layers.h"
#include "workflows/host.h"

namespace brume::python {

namespace py = pybind11;

/// What a piece of work is given while Python runs on.
struct Work {
  Task task;
  std::function<void(const std::string&)> note;  ///< what the user should know: a warning of the logger "brume"
  std::function<void(const std::string&)> log;   ///< what may interest them: its level INFO
  /// Has something done by the thread that waits, with Python's lock, and waits for it. What it throws is thrown here;
  /// but an exception of Python's ends the work, as one of `progress` does. @throws Interrupted then
  std::function<void(const std::function<void()>& job)> in_caller;
  /// Hands over a picture for `on_picture`, in place of one that has not been looked at.
  std::function<void(const Layers&)> show;
  /// Whether a picture would be looked at soon.
  std::function<bool()> waits;
};

/// Whom of Python to call meanwhile; None: nobody.
struct Callbacks {
  py::object progress = py::none();    ///< with the finished fraction, about twenty times a second
  py::object on_picture = py::none();  ///< with Layers and a dict about them; none is made while it runs
};

/// Runs `body` in a thread of its own, without Python's lock. Meanwhile the calling thread serves signals, tells
/// the callbacks, and passes notes on. A signal handler's exception, as KeyboardInterrupt, or one of a callback ends
/// the work and is raised.
void run_work(const Callbacks& callbacks, int threads, const std::function<void(const Work&)>& body);

/// Where the words of a workflow go: to the logger "brume".
Host host_of(const Work& work);

}  // namespace brume::python
