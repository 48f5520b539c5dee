#pragma once
#include <atomic>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "base/progress.h"

namespace brume {

/// What a front end hands to a workflow beside its options: threads, the stop signal, and where its words go. A
/// workflow keeps nothing between two calls, and several may run at once.
struct Host {
  enum class Word {
    kLog,      ///< what was done, for who wants to follow it
    kRemark,   ///< how the input was understood, for who did not ask for silence
    kNote,     ///< what the user should know of the input or the result
    kMessage,  ///< what went otherwise than asked, as a sentence of its own
    kWarning,  ///< what may spoil the result
  };

  /// A picture that is there, whole, while its render goes on or at its end.
  struct Update {
    std::filesystem::path picture;
    int number = 0;               ///< of the picture, from 1 on
    double samples = 0;           ///< per pixel, on average
    std::optional<double> error;  ///< relative, estimated; nothing where none is
    double seconds = 0;           ///< since the render began
    bool last = false;
  };

  int threads = 0;                                          ///< 0: all of the machine's
  const std::atomic<bool>* cancel = nullptr;                ///< set from outside; the workflow ends with Interrupted
  std::function<void(Word, const std::string&)> tell = {};  ///< from any thread, one at a time; null: dropped
  /// Begins a stage, "render smoke", and gives whom to tell the finished fraction of it; null: not reported.
  std::function<std::function<void(double)>(const std::string& stage)> progress = {};
  std::function<void(const std::filesystem::path&)> wrote = {};  ///< told of each EXR that is there, whole
  std::function<void(const Update&)> updated = {};               ///< told of each of RenderOptions::updates

  Task task(const std::string& stage) const {
    return {threads, progress ? progress(stage) : std::function<void(double)>(), cancel};
  }
  Task silent() const { return {threads, {}, cancel}; }
  void say(Word word, const std::string& text) const {
    if (tell) tell(word, text);
  }
  void log(const std::string& text) const { say(Word::kLog, text); }
  void note(const std::string& text) const { say(Word::kNote, text); }
  void message(const std::string& text) const { say(Word::kMessage, text); }
};

}  // namespace brume
