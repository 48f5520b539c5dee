#pragma once
#include <pybind11/pybind11.h>

#include <functional>
#include <string>

#include "base/progress.h"
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
};

/// Runs `body` in a thread of its own, without Python's lock. Meanwhile the calling thread serves signals, tells
/// `progress` (None, or called with the finished fraction) about twenty times a second, and passes notes on. A signal
/// handler's exception, as KeyboardInterrupt, or one of `progress` ends the work and is raised.
void run_work(const py::object& progress, int threads, const std::function<void(const Work&)>& body);

/// Where the words of a workflow go: to the logger "brume".
Host host_of(const Work& work);

}  // namespace brume::python
