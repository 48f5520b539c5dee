#pragma once
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "image/exr_io.h"
#include "image/foreign.h"
#include "workflows/denoise_frame.h"

namespace brume {

/// What is done with a frame, decided once from what its file has.
struct DenoisePlan {
  std::vector<FilterSettings> filters;
  ApplyOptions how;
  std::vector<FrameFiles> others;  ///< beside it, within the widest frame window of the filters
  bool sequence = false;           ///< one of many: another frame that cannot be used is named and left out
  std::string inputs;              ///< what it is made from, for its header; empty: not written
};

/// Frames in memory, so that each is read once while a sequence goes by.
class FrameWindow {
 public:
  /// A frame as filters get it: with its guides, and raw where it is clean already. @throws InputError
  /// @param file  the frame's; null: not open yet
  const Layers& get(const FrameFiles& files, const std::set<std::string>& channels, const Host& host,
                    const ExrFile* file = nullptr);
  /// Lets go of all frames but these.
  void keep(const FrameFiles& own, const std::vector<FrameFiles>& others);

 private:
  struct Entry {
    std::set<std::string> channels;
    std::optional<Layers> layers;
  };
  std::map<std::filesystem::path, Entry> frames_;
};

/// A file that is open to be cleaned, its header read and its layers recognised, its pixels not yet read.
class OpenFrame {
 public:
  virtual ~OpenFrame() = default;

  /// The layers that filters will be given, of one pixel; of several pictures, those of which the file says least.
  virtual Layers outline() const = 0;
  /// Whether it is read and written as a frame by brume.
  virtual bool ours() const = 0;
  /// Why its guides must not be used, measured where their header does not tell; empty: nothing, or there are none.
  std::string what_forbids_guides() const;
  void leave_guides();
  /// Reads what the plan needs. @throws InputError
  virtual void read(const DenoisePlan& plan) = 0;
  /// Aligns, filters, combines and writes.
  /// @param filter  of the plan   @param near  frames of the plan within its frame window   @param preview  empty: none
  virtual void clean(const FilterSettings& filter, const std::vector<FrameFiles>& near,
                     const std::filesystem::path& output, const std::filesystem::path& preview) = 0;

 protected:
  OpenFrame(const FrameFiles& files, ExrFile file, const DenoiseOptions& options, const Host& host);
  /// As the function of that name (workflows/frame.h).
  virtual std::string what_speaks_against_guides() const = 0;
  std::set<std::string> guide_names() const;

  FrameFiles files_;
  const ExrFile file_;
  Layers guides_;  // of one pixel
  const DenoiseOptions& options_;
  const Host& host_;
  std::optional<RecordReader> records_;
};

/// Opens a file as what it is: a frame by brume, or a file in which everything is kept, what is cleaned being replaced.
/// @throws InputError
std::unique_ptr<OpenFrame> open_frame(const FrameFiles& files, const DenoiseOptions& options, FrameWindow& window,
                                      const Host& host);
/// Nothing for a file that is to be written as brume writes its own; else it takes the file.
std::unique_ptr<OpenFrame> open_kept_file(const FrameFiles& files, ExrFile& file, const DenoiseOptions& options,
                                          const Host& host);

/// The pictures that a mapping file names in an EXR. @throws InputError with the line underlined
std::vector<ForeignFrame> read_map(const std::filesystem::path& path, const ExrInfo& file);

/// The header entry with what a frame of a sequence is made from.
inline constexpr const char* kMadeFrom = "filterInputs";

/// How a frame is cleaned by the filter that is best for it: its noise is estimated from the picture where it has no
/// statistics, which is told.
ApplyOptions as_recommended(const ApplyOptions& how, const Layers& outline, const Host& host);

/// Tells that a frame was filtered before, and has no noisy layer to go back to.
void tell_clean(const std::string& filter, const Host& host);
/// Puts what a clean frame was made from in the place of the picture.
void take_noisy(Layers& frame, const Host& host);

struct CleanLayers {
  Layers layers{1, 1};
  double seconds = 0;
};
/// Cleans a frame in memory, and tells what there is to tell of it.
CleanLayers run_filter(const FilterSettings& filter, const Layers& frame, const ApplyOptions& how, const Host& host);

}  // namespace brume
