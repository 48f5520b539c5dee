#pragma once
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "filters/api/filter.h"
#include "filters/api/options.h"
#include "filters/inputs/alpha_weight.h"
#include "filters/inputs/extremes.h"
#include "filters/run/alignment.h"

namespace brume {

/// A frame that is read: the one to clean, or another of the sequence. Not copied unless it has something to repair.
class Source {
 public:
  /// @param limited  signals whose extremes are limited
  /// @throws InputError for a signal without a finite pixel
  Source(const SequenceFrame& frame, const std::set<std::string>& readable, const std::vector<LayerName>& signals,
         const std::vector<LayerName>& limited, const Task& task);
  /// As it was recorded, repaired.
  const Layers& recorded() const { return repaired_ ? *repaired_ : *frame_; }
  /// As filters are to see it.
  const Layers& layers() const { return given_ ? *given_ : recorded(); }
  /// Weighs signals by an alpha that tells without noise where they have light.
  /// @param goes_on  makes them go on outside of there, as filters are to see them
  /// @param carried  layers that go on where the first signal does
  void weigh_by_alpha(const std::vector<LayerName>& signals, const std::vector<LayerName>& carried, bool goes_on,
                      const Task& task);
  bool goes_on() const { return goes_on_; }
  size_t channels() const { return channels_.size(); }
  /// Brings what is read of it to where it is in the frame to clean, channel by channel.
  void align_with(const Source& target, const Alignment& alignment, const Task& task);
  /// What is read of a part of it: views, where its rows are aligned.
  Layers crop_to(const Box& box) const;

  int distance;
  RecordReader* records;
  double samples = 0;                               // per pixel
  size_t repaired = 0;                              // pixels
  std::map<std::string_view, Extremes> extremes;    // by signal
  std::map<std::string_view, AlphaWeight> weights;  // by signal; none: alpha says nothing

 private:
  /// The recorded layers, as a copy.
  Layers& own_copy() {
    if (!repaired_) repaired_ = *frame_;
    return *repaired_;
  }

  const Layers* frame_;
  std::optional<Layers> repaired_, given_;  // given_ may hold views of the others
  bool goes_on_ = false;
  std::vector<std::string> channels_;
};

/// The frame to clean, then those of its sequence: repaired, their extremes limited, weighed by alpha, and brought to
/// where the frame to clean is, where the filter wants that.
std::vector<Source> read_sources(const FilterSettings& filter, const Layers& frame, const ApplyOptions& options,
                                 const Task& task);

}  // namespace brume
