#include "apps/python/work.h"

#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "apps/python/convert.h"
#include "base/error.h"
#include "filters/api/filter.h"

namespace brume::python {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kBetweenLooks{50};
constexpr std::chrono::milliseconds kBetweenPictures{100};  // from the end of a look at one to the next one

/// What the thread that works tells the one that waits.
struct Mailbox {
  std::mutex mutex;
  std::condition_variable changed;
  bool done = false;
  double fraction = 0;
  std::vector<std::pair<const char*, std::string>> lines;  // the logger's method, the text
  const std::function<void()>* job = nullptr;              // that the waiting thread is to run
  std::exception_ptr failure_of_job;
  std::condition_variable job_done;
  std::shared_ptr<Layers> picture;  // the newest that has not been shown
  bool looking = false;             // whether the one before is being shown
  Clock::time_point looked = Clock::now() - kBetweenPictures;
};

/// Leaves a job for the thread that waits, and waits itself.
void ask_caller(Mailbox& mail, const std::function<void()>& job) {
  std::unique_lock lock(mail.mutex);
  mail.job = &job;
  mail.failure_of_job = nullptr;
  mail.changed.notify_one();
  mail.job_done.wait(lock, [&] { return !mail.job; });
  if (mail.failure_of_job) std::rethrow_exception(std::exchange(mail.failure_of_job, nullptr));
}

/// With Python's lock: does the job that was left, if there is one. @throws py::error_already_set
/// @param give_up  whether none is done any more
void do_job(Mailbox& mail, bool give_up) {
  const std::function<void()>* job = nullptr;
  {
    const std::scoped_lock lock(mail.mutex);
    job = mail.job;
  }
  if (!job) return;
  std::exception_ptr failure;
  std::optional<py::error_already_set> raised;
  try {
    if (give_up) throw Interrupted();
    (*job)();
  } catch (const py::error_already_set& error) {
    raised = error;
    failure = std::make_exception_ptr(Interrupted());
  } catch (...) {
    failure = std::current_exception();
  }
  {
    const std::scoped_lock lock(mail.mutex);
    mail.failure_of_job = failure;
    mail.job = nullptr;
    mail.job_done.notify_one();
  }
  if (raised) throw py::error_already_set(std::move(*raised));
}

/// What a picture's header says of it.
py::dict about(const Layers& picture) {
  py::dict info;
  const bool clean = picture.has(layer::noisy);
  const std::optional<double> error = picture.number(clean ? "estimatedCleanError" : "estimatedRelativeError");
  info["samples"] = static_cast<int>(picture.number("samplesPerPixel").value_or(0.0));
  info["seconds"] = picture.number("renderTimeSeconds").value_or(0.0);
  info["clean"] = clean;
  info["error"] = error && std::isfinite(*error) ? py::object(py::float_(*error)) : py::none();
  return info;
}

/// With Python's lock: shows the picture that has come in. @throws py::error_already_set
void show(Mailbox& mail, const py::object& on_picture) {
  std::shared_ptr<Layers> picture;
  {
    const std::scoped_lock lock(mail.mutex);
    if (!mail.picture || mail.done) return;
    picture = std::move(mail.picture);
    mail.looking = true;
  }
  const py::dict info = about(*picture);
  on_picture(py::cast(std::move(picture)), info);
  const std::scoped_lock lock(mail.mutex);
  mail.looking = false;
  mail.looked = Clock::now();
}

/// With Python's lock: hands over what has come in. @throws py::error_already_set
void deliver(Mailbox& mail, const Callbacks& callbacks, double& told) {
  std::vector<std::pair<const char*, std::string>> lines;
  double fraction = 0;
  {
    const std::scoped_lock lock(mail.mutex);
    lines.swap(mail.lines);
    fraction = mail.fraction;
  }
  if (!lines.empty()) {
    const py::object logger = py::module_::import("logging").attr("getLogger")("brume");
    for (const auto& [level, text] : lines) logger.attr(level)("%s", to_str(text));
  }
  if (!callbacks.progress.is_none()) {
    told = fraction;
    callbacks.progress(fraction);
  }
  if (!callbacks.on_picture.is_none()) show(mail, callbacks.on_picture);
  if (PyErr_CheckSignals() != 0) throw py::error_already_set();
}

/// Pieces of work that run, which the interpreter's end has to end: a thread that asks for Python's lock after it never
/// comes back, and with it the process aborts.
class RunningWorks {
 public:
  /// Of this process. It outlives the interpreter.
  static RunningWorks*& all() {
    static auto* all = new RunningWorks;
    return all;
  }

  /// While it lives the work is one of them; made and ended with Python's lock. @throws SystemExit of Python's
  class Entry {
   public:
    explicit Entry(std::atomic<bool>& cancel) : cancel_(&cancel) {
      all()->end_with_interpreter();
      if (ends_with_interpreter()) leave();
      const std::scoped_lock lock(all()->mutex_);
      all()->cancels_.insert(cancel_);
    }
    ~Entry() {
      const std::scoped_lock lock(all()->mutex_);
      all()->cancels_.erase(cancel_);
      all()->changed_.notify_all();
    }
    Entry(Entry&&) = delete;
    bool ends_with_interpreter() const {
      const std::scoped_lock lock(all()->mutex_);
      return all()->ends_this_thread();
    }

   private:
    std::atomic<bool>* cancel_;
  };

  /// What ends a thread of Python's without a word.
  [[noreturn]] static void leave() {
    PyErr_SetNone(PyExc_SystemExit);
    throw py::error_already_set();
  }

 private:
  void end_with_interpreter() {
    if (std::exchange(registered_, true)) return;
    pthread_atfork(nullptr, nullptr, [] { all() = new RunningWorks; });  // whose threads are not there
    py::module_::import("atexit").attr("register")(py::cpp_function([] { all()->end(); }));
  }

  bool ends_this_thread() const { return ended_by_ != std::thread::id() && ended_by_ != std::this_thread::get_id(); }

  /// Cancels them and waits, with a look at Ctrl-C.
  void end() {
    for (bool done = false; !done;) {
      {
        const py::gil_scoped_release others_may_run;
        std::unique_lock lock(mutex_);
        ended_by_ = std::this_thread::get_id();
        for (std::atomic<bool>* cancel : cancels_) *cancel = true;
        changed_.wait_for(lock, kBetweenLooks, [this] { return cancels_.empty(); });
        done = cancels_.empty();
      }
      if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::set<std::atomic<bool>*> cancels_;
  bool registered_ = false;   // with Python's lock
  std::thread::id ended_by_;  // nobody at first; it may go on working, in what else is to be done at the end
};

}  // namespace

void run_work(const Callbacks& callbacks, int threads, const std::function<void(const Work&)>& body) {
  if (threads < 0)
    throw InputError("threads: expected 0 (all of the machine's) or more, found " + std::to_string(threads));
  Mailbox mail;
  std::atomic<bool> cancel{false};
  const RunningWorks::Entry entry(cancel);
  std::exception_ptr failure;
  Work work;
  work.task = {threads, {}, &cancel};
  if (!callbacks.progress.is_none())
    work.task.progress = [&mail](double fraction) {
      const std::scoped_lock lock(mail.mutex);
      mail.fraction = std::max(mail.fraction, std::min(fraction, 1.0));
    };
  const auto post = [&mail](const char* level) {
    return [&mail, level](const std::string& text) {
      const std::scoped_lock lock(mail.mutex);
      mail.lines.emplace_back(level, text);
    };
  };
  work.note = post("warning");
  work.log = post("info");
  work.in_caller = [&mail](const std::function<void()>& job) { ask_caller(mail, job); };
  work.waits = [&mail] {
    const std::scoped_lock lock(mail.mutex);
    return !mail.picture && !mail.looking && Clock::now() - mail.looked >= kBetweenPictures;
  };
  work.show = [&](const Layers& picture) {
    if (!work.waits()) return;
    auto copy = std::make_shared<Layers>(picture);
    const std::scoped_lock lock(mail.mutex);
    mail.picture = std::move(copy);
    mail.changed.notify_one();
  };

  std::thread thread([&] {
    try {
      body(work);
    } catch (...) {
      failure = std::current_exception();
    }
    const std::scoped_lock lock(mail.mutex);
    mail.done = true;
    mail.changed.notify_one();
  });
  double told = 0;
  std::optional<py::error_already_set> raised;
  for (bool done = false; !done;) {
    {
      const py::gil_scoped_release released;
      std::unique_lock lock(mail.mutex);
      mail.changed.wait_for(lock, kBetweenLooks, [&] { return mail.done || mail.job || (mail.picture && !raised); });
      done = mail.done;
    }
    try {
      do_job(mail, raised.has_value());
      if (raised) continue;
      deliver(mail, callbacks, told);
    } catch (const py::error_already_set& error) {
      raised = error;
      cancel = true;
    }
  }
  thread.join();
  if (raised) throw py::error_already_set(std::move(*raised));
  if (failure && entry.ends_with_interpreter()) RunningWorks::leave();
  if (failure) std::rethrow_exception(failure);
  if (!callbacks.progress.is_none() && told < 1) callbacks.progress(1.0);
}

Host host_of(const Work& work) {
  Host host{work.task.threads, work.task.cancel};
  host.tell = [&work](Host::Word word, const std::string& text) {
    (word == Host::Word::kLog || word == Host::Word::kRemark ? work.log : work.note)(text);
  };
  host.progress = [&work](const std::string&) { return work.task.progress; };
  return host;
}

}  // namespace brume::python
