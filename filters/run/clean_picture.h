#pragma once
#include <set>
#include <string>
#include <vector>

#include "filters/run/apply.h"
#include "image/foreign.h"

namespace brume {

/// What a cleaned picture's channels become.
struct CleanPicture {
  struct Channel {
    std::string name;
    Plane values;
  };
  std::vector<Channel> channels;            ///< values as they are stored: rounded where the channel is half
  std::vector<std::string> cleaned;         ///< names of the passes that went through the filter
  std::string sum;                          ///< "Combined = VolumeDir + VolumeInd + Env + Emit"; empty without passes
  std::map<std::string, Attribute> header;  ///< filter, parameters and what was done around them
  std::vector<std::string> notes;
  double seconds = 0;
};

/// Cleans a picture of another renderer: each of its passes, and what they leave of it, by itself; the picture becomes
/// the sum of the parts as they are stored, added in float in their order (those with one factor first, then times it)
/// and rounded once, so that who adds them up gets it to the last bit. A picture without passes is cleaned as it is.
///
/// Where the file has no variance of a signal, NoiseSource::kSpatial is used for it. A variance of unstated level is
/// given the level of that estimate; one that only counts samples which met a surface is that estimate where it is 0.
/// Light groups are cleaned, too, and made to add up to the clean picture (add_up.h).
/// Passes that are the same everywhere are left alone. With Component::kIndirect only indirect passes are cleaned.
/// @param file    as read_exr gives it, with the picture's channels at least
/// @param info    of the file: the channels' types say how values are stored
/// @param options  the frames of its sequence are the same picture in other files
/// @param suffix  clean layers stand beside the noisy ones under names with this behind, which `sum` uses; empty: they
///                replace them
/// @throws InputError as apply_filter; for whole numbers as colours
CleanPicture clean_picture(const FilterSettings& filter, const ForeignFrame& picture, Layers file, const ExrInfo& info,
                           const ApplyOptions& options, const Task& task, const std::string& suffix = "");

/// "ViewLayer.Combined_clean.R" for "ViewLayer.Combined.R" and "_clean"; "clean.R" for "R".
std::string channel_beside(const std::string& channel, const std::string& suffix);

/// The frame that the filter would be given for a signal of the picture, with the file's statistics as they are.
/// @param extra  channels under brume's names that are passed on
Layers frame_of_signal(const ForeignFrame& picture, const ForeignSignal& signal, const Layers& file,
                       const std::set<std::string>& extra);

/// What is cleaned: the passes, or the picture where it has none.
std::vector<ForeignSignal> cleaned_signals(const ForeignFrame& picture);

}  // namespace brume
