#include "workflows/denoise_frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>

#include "base/error.h"
#include "base/output_file.h"
#include "base/rng.h"
#include "base/sequence.h"
#include "base/text.h"
#include "filters/api/recommend.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/inputs/guide_layers.h"
#include "image/exr_io.h"
#include "image/foreign.h"
#include "workflows/deep_frame.h"
#include "workflows/finished_frame.h"
#include "workflows/open_frame.h"
#include "workflows/version.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

/// Where the frame to clean and those beside it lie. No frame: a number below zero.
using FilesAt = std::function<FrameFiles(int distance)>;

/// OUT.exr for one filter, OUT.FILTER.exr for several, OUT.FILTER.2.exr for the second of one name.
fs::path output_for(const fs::path& path, const std::vector<FilterSettings>& filters, size_t i) {
  if (filters.size() == 1) return path;
  const std::string& name = filters[i].entry().name;
  size_t same = 1;
  for (size_t k = 0; k < i; ++k) same += filters[k].entry().name == name;
  return path.parent_path() /
         (path.stem().string() + "." + name + (same > 1 ? "." + std::to_string(same) : "") + path.extension().string());
}

/// "shot.0007.exr" for "shot.0005.exr" and 2: the last number of a file's name counts its frame. Empty for a number
/// below zero.
/// @throws InputError for a name without a number
fs::path file_beside(const fs::path& path, int distance) {
  const std::string stem = path.stem().string();
  const size_t last = stem.find_last_of("0123456789");
  if (last == std::string::npos)
    throw InputError(fmt::format("{}: --extra-frames needs the frame's number in the file's name, as in shot.0005{}",
                                 path.string(), path.extension().string()));
  const size_t before = stem.find_last_not_of("0123456789", last), first = before == std::string::npos ? 0 : before + 1;
  const std::string digits = stem.substr(first, last + 1 - first);
  if (digits.size() > 9) throw InputError(fmt::format("{}: {} is no frame's number", path.string(), digits));
  const int number = std::stoi(digits) + distance;
  if (number < 0) return {};
  return path.parent_path() / fmt::format("{}{:0{}}{}{}", stem.substr(0, first), number, digits.size(),
                                          stem.substr(last + 1), path.extension().string());
}

FilesAt beside(const FrameFiles& files) {
  return [files](int distance) {
    if (distance == 0) return files;
    FrameFiles there;
    there.distance = distance;
    for (fs::path FrameFiles::*name :
         {&FrameFiles::frame, &FrameFiles::second, &FrameFiles::records, &FrameFiles::guides})
      if (!(files.*name).empty()) there.*name = file_beside(files.*name, distance);
    return there;
  };
}

FilesAt of_frame(const FrameFiles& patterns, int frame) {
  return [patterns, frame](int distance) {
    FrameFiles files;
    files.distance = distance;
    if (frame + distance < 0) return files;
    for (fs::path FrameFiles::*name : {&FrameFiles::frame, &FrameFiles::second, &FrameFiles::records,
                                       &FrameFiles::guides, &FrameFiles::output, &FrameFiles::preview})
      if (!(patterns.*name).empty()) files.*name = file_of_frame(patterns.*name, frame + distance);
    return files;
  };
}

FilesAt without_guides(const FilesAt& files_at) {
  return [files_at](int distance) {
    FrameFiles files = files_at(distance);
    files.guides.clear();
    return files;
  };
}

/// What a clean frame is made from, as a number: filter, parameters, and every byte of the files that are read.
std::string made_from(const DenoisePlan& plan, const FrameFiles& own, const DenoiseOptions& options) {
  uint64_t hash = 0;
  const auto add_text = [&](const std::string& text) {
    for (const char c : text + ";") hash = hash_combine(hash, static_cast<uint64_t>(static_cast<unsigned char>(c)));
  };
  std::vector<char> bytes(1 << 20);
  const auto add_file = [&](const fs::path& path) {
    if (path.empty()) return;
    std::ifstream file(path, std::ios::binary);
    while (file) {
      file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
      const size_t count = static_cast<size_t>(file.gcount()), words = count / 8;
      for (size_t i = 0; i < words; ++i) {
        uint64_t word;
        std::memcpy(&word, bytes.data() + 8 * i, 8);
        hash = hash_combine(hash, word);
      }
      for (size_t i = 8 * words; i < count; ++i) hash = hash_combine(hash, static_cast<uint64_t>(bytes[i]));
    }
  };
  add_text(version_text());
  for (const FilterSettings& filter : plan.filters) add_text(filter.entry().name + filter.text());
  const ApplyOptions& how = plan.how;
  add_text(fmt::format("{} {} {} {} {} {}", static_cast<int>(how.component), static_cast<int>(how.background),
                       static_cast<int>(how.noise), static_cast<int>(how.outliers), how.tile,
                       options.extra_frames.value_or(-1)));
  add_text(join(how.features));
  for (const LayerName& l : how.carried) add_text(l.label());
  for (const std::string& text :
       {options.picture.exposure, options.file.suffix, options.file.map.string(), std::to_string(options.file.samples)})
    add_text(text);
  for (const fs::path& path : {own.frame, own.second, own.records, own.guides}) add_file(path);
  for (const FrameFiles& files : plan.others) {
    add_text(std::to_string(files.distance));
    for (const fs::path& path : {files.frame, files.second, files.records, files.guides}) add_file(path);
  }
  return fmt::format("{:016x}", hash);
}

/// Cleans frames from file to file: open, recognise, choose, then align, filter, combine and write (OpenFrame::clean).
class Denoiser {
 public:
  Denoiser(const DenoiseOptions& options, const Host& host, bool sequence)
      : options_(options), host_(host), sequence_(sequence) {}

  FrameEnd operator()(const FilesAt& asked) {
    if (ExrFile(asked(0).frame).info().deep()) {
      denoise_deep(asked(0), options_, host_);
      if (host_.wrote) host_.wrote(asked(0).output);
      return FrameEnd::kDone;
    }
    const std::unique_ptr<OpenFrame> frame = open_frame(asked(0), options_, window_, host_);
    const std::string wrong = frame->what_forbids_guides();
    const FilesAt files_at = wrong.empty() ? asked : without_guides(asked);
    const FrameFiles own = files_at(0);
    if (!wrong.empty()) {
      host_.say(Host::Word::kWarning, wrong);
      frame->leave_guides();
    }
    DenoisePlan plan = choose(*frame, files_at);
    check_outputs(plan, own);
    if (sequence_) plan.inputs = made_from(plan, own, options_);
    if (options_.resume && is_complete(plan, own)) return FrameEnd::kSkipped;
    frame->read(plan);
    for (size_t i = 0; i < plan.filters.size(); ++i) {
      std::vector<FrameFiles> near;
      for (const FrameFiles& other : plan.others)
        if (std::abs(other.distance) <= frame_window_of(plan.filters[i])) near.push_back(other);
      const fs::path output = output_for(own.output, plan.filters, i);
      frame->clean(plan.filters[i], near, output,
                   own.preview.empty() ? own.preview : output_for(own.preview, plan.filters, i));
      if (host_.wrote) host_.wrote(output);
    }
    return FrameEnd::kDone;
  }

 private:
  DenoisePlan choose(const OpenFrame& frame, const FilesAt& files_at) {
    const FrameFiles own = files_at(0);
    DenoisePlan plan;
    plan.how = options_.how;
    plan.sequence = sequence_;
    if (!frame.ours() && !plan.how.carried.empty())
      throw InputError(
          "--carry: the passes of this frame are cleaned by themselves, and add up; it is for frames by brume");
    const Layers outline = frame.outline();
    if (!frame.ours()) tell_clean(outline.text("brume.filter"), host_);
    plan.filters = options_.filters;
    if (plan.filters.empty()) {
      if (frame.ours()) plan.how = as_recommended(plan.how, outline, host_);
      plan.filters = {recommended(frame, outline, own, plan.how)};
    }
    int frame_window = 0;
    for (const FilterSettings& filter : plan.filters) frame_window = std::max(frame_window, frame_window_of(filter));
    plan.others = others_within(frame_window, files_at);
    return plan;
  }

  /// The best filter that the frame's layers allow.
  FilterSettings recommended(const OpenFrame& frame, const Layers& outline, const FrameFiles& own, ApplyOptions how) {
    if (!frame.ours()) {
      how.component = Component::kAll;  // of each signal
      if (!outline.has(layer::beauty, statistic::mean_variance) && !has_halves(outline, layer::beauty))
        how.noise = NoiseSource::kSpatial;
    }
    try {
      const Recommendation best = recommend_filter(outline, how, /*sequence=*/options_.extra_frames.value_or(0) > 0);
      tell_choice(best, frame.ours(), own);
      return best.filter;
    } catch (const InputError& error) {
      throw InputError(fmt::format("{}: {}", own.frame.string(), error.what()));
    }
  }

  /// Says why, once for all frames of a sequence, and what would serve better, as far as it can be had.
  void tell_choice(const Recommendation& best, bool ours, const FrameFiles& own) {
    const std::string reason = ours ? best.reason : split(best.reason, ';')[0];
    if (reason == told_) return;
    told_ = reason;
    host_.log(reason);
    if (!ours && !best.filter.entry().guides)
      host_.log(fmt::format(
          "of smoke and clouds in it, guides from their volume leave a quarter of the error: brume guides --like {0} --scene SCENE.toml -o GUIDES.exr (or --volume FILE.vdb), then brume denoise {0} --guides GUIDES.exr",
          own.frame.string()));
  }

  /// How far a filter looks: as it declares in a sequence, or as the caller says.
  int frame_window_of(const FilterSettings& filter) const {
    return options_.extra_frames.value_or(sequence_ ? filter.entry().frame_window : 0);
  }

  /// The frames before and after that there are, with all that is read of them.
  /// @throws InputError when some are asked for and none is there
  std::vector<FrameFiles> others_within(int frame_window, const FilesAt& files_at) const {
    std::vector<FrameFiles> others;
    std::vector<std::string> missing;
    const auto absent = [](const fs::path& path) { return !path.empty() && !fs::exists(path); };
    for (int d = -frame_window; d <= frame_window; ++d) {
      const FrameFiles there = d == 0 ? FrameFiles() : files_at(d);
      if (there.frame.empty()) continue;  // itself, or before frame 0
      if (absent(there.frame))
        missing.push_back(there.frame.filename().string());
      else if (const fs::path* const also = absent(there.guides)    ? &there.guides
                                            : absent(there.records) ? &there.records
                                            : absent(there.second)  ? &there.second
                                                                    : nullptr)
        missing.push_back(fmt::format("{} for {}", also->filename().string(), there.frame.filename().string()));
      else
        others.push_back(there);
    }
    const fs::path own = files_at(0).frame;
    if (frame_window > 0 && others.empty() && !sequence_)
      throw InputError(fmt::format("{}: --extra-frames {}: no frame beside it can be used{}", own.string(),
                                   frame_window, missing.empty() ? "" : "; not there: " + join(missing)));
    if (!missing.empty())
      host_.note(fmt::format("{}: of the frames beside it, {} {} not there", own.filename().string(), join(missing),
                             missing.size() == 1 ? "is" : "are"));
    return others;
  }

  /// @throws InputError before anything is computed
  void check_outputs(const DenoisePlan& plan, const FrameFiles& own) const {
    std::vector<fs::path> inputs = {own.frame};
    for (const fs::path& also : {options_.file.map, own.guides, own.second})
      if (!also.empty()) inputs.push_back(also);
    for (const FrameFiles& files : plan.others) inputs.push_back(files.frame);
    if (!own.preview.empty()) options_.picture.check();
    for (size_t i = 0; i < plan.filters.size(); ++i) {
      check_writable(output_for(own.output, plan.filters, i), inputs, ".exr");
      if (!own.preview.empty()) check_writable(output_for(own.preview, plan.filters, i), inputs, ".png");
    }
  }

  /// Whether every output is there, whole, and made from this.
  bool is_complete(const DenoisePlan& plan, const FrameFiles& own) const {
    for (size_t i = 0; i < plan.filters.size(); ++i) {
      const fs::path path = output_for(own.output, plan.filters, i);
      if (!fs::exists(path)) return false;
      try {
        const Layers frame = read_exr(path);
        if (frame.text(kMadeFrom, frame.text(std::string("brume.") + kMadeFrom)) != plan.inputs) return false;
      } catch (const InputError& error) {
        host_.message(fmt::format("{} is cleaned again: {}", path.string(), error.what()));
        return false;
      }
    }
    return true;
  }

  const DenoiseOptions& options_;
  const Host& host_;
  const bool sequence_;
  FrameWindow window_;
  std::string told_;  // of the filter that was chosen
};

}  // namespace

void denoise_frame(const FrameFiles& files, const DenoiseOptions& options, const Host& host) {
  Denoiser(options, host, /*sequence=*/false)(beside(files));
}

SequenceEnd denoise_sequence(const FrameFiles& patterns, const std::vector<int>& frames, const DenoiseOptions& options,
                             const Host& host) {
  Denoiser denoise(options, host, /*sequence=*/true);
  return each_frame(frames, host, [&](int frame) { return denoise(of_frame(patterns, frame)); });
}

}  // namespace brume
