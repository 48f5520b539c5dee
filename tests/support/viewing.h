#pragma once
#include <Imath/half.h>

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "workflows/view/viewer.h"

// Somebody who looks at a scene, for tests of what is computed for it and shown.
namespace brume::test {

/// Keeps what a viewer tells, and waits for it.
class Audience : public ViewListener {
 public:
  void scene(const ViewSceneText& scene) override {
    add([&] { scenes.push_back(scene); });
  }
  void picture(ViewPicture picture) override {
    add([&] { pictures.push_back(std::move(picture)); });
  }
  void progress(const ViewProgress& progress) override {
    add([&] {
      stages.emplace_back(progress.id, progress.stage);
      told.push_back(progress);
    });
  }
  void problem(const ViewProblem& problem) override {
    add([&] {
      problems.emplace_back(problem.id, problem.text);
      wrong.push_back(problem);
    });
  }
  void point(uint64_t id, std::optional<dvec3> position) override {
    add([&] { points.emplace_back(id, position); });
  }

  /// @return whether it came to be within ten minutes
  bool wait(const std::function<bool(const Audience&)>& is) {
    std::unique_lock lock(mutex_);
    return came_.wait_for(lock, std::chrono::seconds(600), [&] { return is(*this); });
  }
  std::optional<ViewPicture> first(const std::function<bool(const ViewPicture&)>& is) {
    std::optional<ViewPicture> found;
    wait([&](const Audience& a) {
      for (const ViewPicture& p : a.pictures)
        if (is(p)) return found = p, true;
      return false;
    });
    return found;
  }

  std::vector<ViewSceneText> scenes;
  std::vector<ViewPicture> pictures;
  std::vector<std::pair<uint64_t, ViewStage>> stages;
  std::vector<ViewProgress> told;
  std::vector<std::pair<uint64_t, std::string>> problems;
  std::vector<ViewProblem> wrong;
  std::vector<std::pair<uint64_t, std::optional<dvec3>>> points;

 private:
  void add(const std::function<void()>& what) {
    {
      const std::lock_guard lock(mutex_);
      what();
    }
    came_.notify_all();
  }
  std::mutex mutex_;
  std::condition_variable came_;
};

inline float value(const ViewPicture& p, int channel, int x, int y) {
  Imath::half h;
  h.setBits(p.halves[(static_cast<size_t>(channel) * p.height + y) * p.width + x]);
  return h;
}

inline double mean(const ViewPicture& p) {
  double sum = 0;
  for (const uint16_t bits : p.halves) {
    Imath::half h;
    h.setBits(bits);
    sum += static_cast<float>(h);
  }
  return sum / static_cast<double>(p.halves.size());
}

inline ViewLook look(uint64_t id, std::vector<std::string> assignments = {}, ivec2 size = {48, 36}) {
  ViewLook look;
  look.id = id;
  look.assignments = std::move(assignments);
  look.size = size;
  look.layers = {"picture"};
  return look;
}

struct Viewing {
  Audience audience;
  Viewer viewer;
  explicit Viewing(const std::filesystem::path& scene, std::vector<int> frames = {})
      : viewer({scene, std::move(frames), {}, "transport_regression"}, {}, audience) {}
};

}  // namespace brume::test
