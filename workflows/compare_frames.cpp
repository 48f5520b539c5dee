#include "workflows/compare_frames.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.h"
#include "base/output_file.h"

namespace brume {
namespace {

using Json = nlohmann::json;

Json to_json(const Errors& e) {
  Json j;
  for (const auto& [name, value] : listed(e)) j[name] = value;
  j["pixels"] = e.pixels;
  return j;
}

Json to_json(const SequenceComparison::Region& r) {
  Json j = {{"lab_rms", r.mean_lab_rms}, {"lab_rms_of_frames", r.lab_rms}};
  if (const auto& t = r.temporal)
    j.update({{"temporal_error", t->temporal_error}, {"flicker", t->flicker}, {"reference_change", t->reference}});
  return j;
}

/// Names of files may hold any bytes.
std::string text_of(const Json& json) {
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

/// Root of the mean of squares: of errors that are roots themselves.
double root_mean_square(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

}  // namespace

std::string ComparisonReport::json() const {
  const bool medium = has_medium();
  Json j = {{"picture", picture},
            {"reference", reference},
            {"policy", policy},
            {"window", {window.lo.x, window.lo.y, window.hi.x, window.hi.y}},
            {"reference_noise_removed", two_references},
            {"metrics", to_json(layers.front().regions[0])}};
  if (medium) j["medium"] = to_json(layers.front().regions[1]);
  for (size_t i = 1; i < layers.size(); ++i) {
    j["layers"][layers[i].name]["metrics"] = to_json(layers[i].regions[0]);
    if (medium) j["layers"][layers[i].name]["medium"] = to_json(layers[i].regions[1]);
  }
  return text_of(j);
}

ComparisonReport compare_frames(NamedFrame picture, NamedFrame reference, std::optional<NamedFrame> second,
                                const CompareOptions& options, const Host& host) {
  ComparisonReport report;
  report.picture = picture.name;
  report.reference = reference.name;
  report.two_references = second.has_value();
  const Comparison pictures(std::move(picture), std::move(reference), std::move(second), host);
  const LabPolicy policy = pictures.policy(options.exposure, options.clip);
  report.policy = policy.text();
  report.window = pictures.window();
  report.display = pictures.display();
  const auto add = [&](const std::string& layer) {
    report.layers.push_back({layer, pictures.errors(layer, policy, ErrorScope::kAll, host.silent())});
  };
  add(options.layer);
  if (options.each_layer)
    for (const std::string& name : pictures.common_layers())
      if (name != options.layer) add(name);
  return report;
}

SequenceComparison::SequenceComparison(const CompareOptions& options, std::filesystem::path sheet,
                                       std::vector<int> frames)
    : options_(options), sheet_path_(std::move(sheet)), frames_(std::move(frames)) {
  if (!options.layer.empty() || options.each_layer)
    throw InputError("--frames compares the beauty of a sequence; leave out layers");
  if (!sheet_path_.empty()) check_writable(sheet_path_, {}, ".png");
}

const Errors& SequenceComparison::add(NamedFrame picture, NamedFrame reference, std::optional<NamedFrame> second,
                                      const Host& host) {
  two_references_ = second.has_value();
  const Comparison pictures(std::move(picture), std::move(reference), std::move(second), host);
  const ivec2 size(pictures.window().width(), pictures.window().height());
  if (added_ == 0) size_ = size;
  if (size != size_)
    throw InputError(fmt::format("frame {} has {} x {} pixels, the frames before it {} x {}; expected one size",
                                 frames_.at(added_), size.x, size.y, size_.x, size_.y));
  if (!policy_) {
    policy_ = pictures.policy(options_.exposure, options_.clip);
    policy_text_ = policy_->text();
  }
  const RgbPlanes x = pictures.picture(), r = pictures.reference(), other = pictures.second();
  const RgbPlanes* r2 = two_references_ ? &other : nullptr;
  errors_ = pictures.errors("", *policy_, ErrorScope::kPixels, host.silent());
  if (!whole_) whole_.emplace(*policy_);
  whole_->lab_rms.push_back(errors_[0].lab_rms);
  whole_->temporal.add(x, r, r2, {});
  if (!sheet_path_.empty()) {
    if (!sheet_) sheet_.emplace(*policy_, static_cast<int>(frames_.size()));
    sheet_->add(frames_.at(added_), x, r, errors_[0].lab_rms, whole_->temporal.last_change());
  }
  ++added_;
  if (const Mask& mask = pictures.medium(); !mask.empty()) {
    if (!medium_) medium_.emplace(*policy_);
    medium_->lab_rms.push_back(errors_[1].lab_rms);
    medium_->temporal.add(x, r, r2, mask);
  }
  return errors_[0];
}

SequenceComparison::Region SequenceComparison::region(const Sums& sums) {
  return {sums.lab_rms, root_mean_square(sums.lab_rms), sums.temporal.result()};
}

std::optional<SequenceComparison::Region> SequenceComparison::medium() const {
  if (!medium_ || medium_->lab_rms.size() != whole_->lab_rms.size()) return std::nullopt;
  return region(*medium_);
}

void SequenceComparison::finish() const {
  if (sheet_) write_png(sheet_path_, sheet_->draw());
}

std::string SequenceComparison::json(const std::string& picture, const std::string& reference) const {
  Json j = {{"picture", picture}, {"reference", reference},      {"policy", policy_text_},
            {"frames", frames_},  {"metrics", to_json(whole())}, {"reference_noise_removed", two_references_}};
  if (const auto m = medium()) j["medium"] = to_json(*m);
  return text_of(j);
}

}  // namespace brume
