// What a session writes into the headers of frames and checkpoints, and reads again to go on from one.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "base/error.h"
#include "base/text.h"
#include "image/exr_io.h"
#include "image/light_layers.h"
#include "render/scene/light_groups.h"
#include "render/session/render_session.h"

namespace brume {

void RenderSession::resume() {
  const Layers saved = read_exr_state(job_.resume);
  Layers expected(film_.width(), film_.height());
  finish_header(expected, {});
  check_same_render(saved, job_.resume.string(), expected, "this render", /*same_samples=*/true);
  film_.merge_state(saved, job_.resume.string(), quiet(task_));
  if (job_.parts > 1 && most_taken() > static_cast<uint32_t>(end_ - first_))
    throw InputError(fmt::format("{}: holds {} samples per pixel from sample {} on, part {}/{} only {}",
                                 job_.resume.string(), most_taken(), first_, job_.part, job_.parts, end_ - first_));
  develop_all();
  if (const std::string goals = saved.text("roundGoals"); job_.next_round && !goals.empty()) read_goals(goals);
  if (const std::string errors = saved.text("roundErrors"); !errors.empty()) read_errors(errors);
  resumed_.seconds = saved.number("renderTimeSeconds").value_or(0.0);
  resumed_.cpu_seconds = saved.number("cpuSeconds").value_or(0.0);
  resumed_.counters.capped_paths = static_cast<uint64_t>(saved.number("cappedPaths").value_or(0.0));
  resumed_.counters.limited = limited_light_of(saved);
  resumed_.invalid_samples = static_cast<uint64_t>(saved.number("invalidSampleCount").value_or(0.0));
}

void RenderSession::read_goals(const std::string& text) {
  for (const std::string& word : split(text, ',')) {
    uint32_t goal = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), goal);
    if (error != std::errc() || end != word.data() + word.size()) break;
    goals_.push_back(goal);
  }
  if (goals_.size() != tiles_.size())
    throw InputError(fmt::format("{}: roundGoals in its header holds {} numbers; expected {}, one for each tile",
                                 job_.resume.string(), goals_.size(), tiles_.size()));
}

void RenderSession::read_errors(const std::string& text) {
  for (const std::string& word : split(text, ',')) {
    RoundError round{};
    const char* const end = word.data() + word.size();
    const auto samples = std::from_chars(word.data(), end, round.samples);
    const bool more = samples.ec == std::errc() && samples.ptr != end && *samples.ptr == ':';
    const auto error = std::from_chars(more ? samples.ptr + 1 : end, end, round.error);
    if (error.ec != std::errc() || error.ptr != end)
      throw InputError(
          fmt::format("{}: roundErrors in its header holds '{}'; expected SAMPLES:ERROR", job_.resume.string(), word));
    errors_.push_back(round);
  }
}

bool RenderSession::write_checkpoint() {
  // Interrupted or not, it is written whole, and soon: who ends this render waits for the file. Beside the sums it has
  // a picture to look at, and the guides where they were made already; other layers follow from the sums.
  Layers frame(film_.width(), film_.height());
  for (const LayerName& l : {layer::beauty, layer::alpha})
    for (const std::string& channel : l.channel_names()) frame.set(channel, film_.layers().at(channel));
  for (const auto& [name, plane] : guides_.channels()) frame.set(name, plane);
  finish_header(frame, report());
  if (!goals_.empty()) {
    std::vector<std::string> goals;
    for (const uint32_t goal : goals_) goals.push_back(std::to_string(goal));
    frame.header["roundGoals"] = join(goals, ",");
    std::vector<std::string> errors;  // in full: what follows from them must not depend on a checkpoint
    for (const RoundError& e : errors_) errors.push_back(fmt::format("{}:{}", e.samples, e.error));
    if (!errors.empty()) frame.header["roundErrors"] = join(errors, ",");
  }
  return checkpoint_.write(frame, film_.state_rows());
}

void RenderSession::finish_header(Layers& frame, const RenderReport& report) const {
  if (job_.crop) {
    frame.origin = ivec2(window_.x0, window_.y0);
    frame.display = ivec2(scene_.scene().film.width, scene_.scene().film.height);
  }
  describe(frame, report, first_, first_ + report.samples_per_pixel);
  if (report.most_samples_per_pixel > report.samples_per_pixel)
    frame.header["samplesPerPixelMost"] = report.most_samples_per_pixel;
  if (report.uneven)
    frame.header["interrupted"] = std::string("true: some tiles have more samples than samplesPerPixel");
  if (job_.next_round)
    frame.header["adaptive"] = std::string("true: sample_count says how many samples each pixel has");
  if (job_.stamp) job_.stamp(frame);
}

void RenderSession::describe(Layers& frame, const RenderReport& report, int first, int end) const {
  const Scene& scene = scene_.scene();
  const Plan& plan = scene_.plan();
  auto& header = frame.header;
  describe_render(frame, scene, plan.layers, job_);
  header["samplesPerPixel"] = end - first;
  header["sampleFirst"] = first;
  header["sampleEnd"] = end;
  // A whole frame that stopped by time or error is finished with the samples it has.
  const bool open_ended = job_.parts == 1 && (job_.time_limit > 0 || job_.target_error > 0);
  header["sampleTotal"] = open_ended ? end - first : job_.spp;
  header["sampleRanges"] = fmt::format("{}-{}", first, end);
  header["exposure"] = static_cast<float>(scene.film.exposure);
  header["renderTimeSeconds"] = static_cast<float>(report.seconds);
  header["cpuSeconds"] = static_cast<float>(report.cpu_seconds);
  header["invalidSampleCount"] = static_cast<int>(std::min<uint64_t>(report.invalid_samples, INT32_MAX));
  header["cappedPaths"] = static_cast<int>(std::min<uint64_t>(report.counters.capped_paths, INT32_MAX));
  if (scene.render.indirect_limit > 0) write_limited_light(frame, report.counters.limited);
  if (report.error) header["estimatedRelativeError"] = static_cast<float>(*report.error);
  std::string estimators = !plan.has_media() ? "no medium"
                           : plan.chromatic  ? "delta tracking with spectral MIS"
                                             : "delta tracking";
  if (plan.emission) estimators += "; stratified emission";
  estimators += plan.light_sampling ? "; ratio tracking; next-event estimation with balance heuristic"
                                    : "; direction sampling only";
  header["estimators"] = estimators;
  std::vector<std::string> biases;
  if (report.counters.capped_paths) biases.emplace_back("paths were cut at max_events");
  if (report.counters.limited.paths) biases.emplace_back("paths were limited by indirect_limit");
  if (scene_.straight_shadows()) biases.emplace_back("straight shadows of dielectrics");
  write_biases(frame, biases);
  header["varianceConvention"] = std::string("mean_variance is the variance of the pixel mean: sample variance / n");
  if (plan.flash) header["flashIntensity"] = static_cast<float>(context_.flash.intensity);
  header["worldToCamera"] = camera_.world_to_camera();
  header["worldToNDC"] = camera_.world_to_ndc();
}

void describe_colors(Layers& frame, const FilmSettings& film) {
  const WorkingSpace space(film.color_space);
  if (space.from_rec709) frame.header["chromaticities"] = space.chromaticities;
}

void describe_render(Layers& frame, const Scene& scene, const LayerRequest& layers, const RenderJob& job) {
  auto& header = frame.header;
  header["scene"] = scene.name;
  header["sceneHash"] = scene.hash;
  header["sceneSettings"] = scene.settings;
  header["seed"] = std::to_string(job.seed);
  header["frame"] = scene.render.frame;
  describe_colors(frame, scene.film);
  LayerRequest recorded = layers;
  recorded.light_groups = light_groups_of(scene).names;
  recorded.light_parts = recorded.light_parts && !recorded.light_groups.empty();
  if (recorded.light_groups.empty()) std::erase(recorded.names, kLightAimed);
  header["recordedLayers"] = join(recorded.text(), ",");
  header["statistics"] = std::string(layers.buckets ? "buckets" : layers.statistics ? "halves" : "none");
  header["program"] = job.program;
}

}  // namespace brume
