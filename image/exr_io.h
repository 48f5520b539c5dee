#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/layers.h"

namespace brume {

/// What an EXR holds, without its pixels.
struct ExrInfo {
  struct Channel {
    std::string name, type;
    PixelWindow data = {};  ///< of its part
    size_t part = 0;        ///< in `parts`
    std::string own = {};   ///< its name in the part; empty: `name`
  };
  struct Part {
    std::string name, view;  ///< may be empty
    std::string type;        ///< "scanlineimage", "tiledimage", "deepscanline", "deeptile"
    PixelWindow data = {};
    std::vector<std::string> channels = {};  ///< as the part names them
    bool deep() const { return type.starts_with("deep"); }
  };
  int width = 0, height = 0;  ///< of the display window
  PixelWindow data, display;  ///< the data window is the first part's
  std::string compression;
  std::vector<Channel> channels;  ///< of flat parts
  std::vector<Part> parts = {};
  std::vector<std::string> views = {};  ///< attribute multiView: views that lie in one part, the default one first
  std::map<std::string, Attribute> header;

  /// Whether it has parts and none that is flat.
  bool deep() const;
};

/// An EXR that is open: what it holds is looked up once, its pixels are read when they are asked for. Radiance HDR
/// pictures and portable float maps are read as EXRs of R G B, or Y.
class ExrFile {
 public:
  /// @throws InputError: missing, not an EXR
  explicit ExrFile(const std::filesystem::path& path);
  ~ExrFile();
  ExrFile(ExrFile&&) noexcept;

  const std::filesystem::path& path() const { return path_; }
  /// The EXR that is read: the file, or what stands in for one of another format (exr_stand_in.h).
  const std::filesystem::path& exr() const;
  /// @throws InputError: truncated
  const ExrInfo& info() const;
  /// As read_exr().
  Layers read(const std::function<bool(const std::string&)>& wanted = {}) const;

 private:
  struct Open;
  std::filesystem::path path_;
  std::unique_ptr<Open> open_;
  mutable std::optional<ExrInfo> info_;
};

/// @throws InputError: missing, not an EXR, truncated
ExrInfo read_exr_info(const std::filesystem::path& path);

/// Reads the channels that `wanted` accepts (all without it) as float, over the data window, which may be smaller than
/// the display window (a crop) or reach beyond it (overscan): Layers::origin and Layers::display say where it lies.
/// Several parts become one frame, their channels prefixed with the part's name where it is missing; it spans the data
/// windows of all parts that are read, 0 where a part has no pixels. Subsampled channels are spread over all pixels;
/// luminance and chroma (Y, RY, BY) become R, G, B. Deep parts are left out.
/// @throws InputError: missing, not an EXR, truncated, no part but deep ones, parts of different sizes
Layers read_exr(const std::filesystem::path& path, const std::function<bool(const std::string&)>& wanted = {});

/// Reads the words that Layers::words() held, over the data window, with the header and the layers `guide.*`, which are
/// made of no samples; no words where the frame was written without. Every byte of a file with words is held to its
/// checksum. @throws InputError: missing, not an EXR, truncated, damaged; Interrupted
Layers read_exr_state(const std::filesystem::path& path, const Task& task = {});

/// Reads every pixel of a file and forgets it, to know that it is whole; the checksum too of files with words.
/// @throws InputError: missing, not an EXR, truncated or damaged, deep; Interrupted
void check_exr(const std::filesystem::path& path, const Task& task = {});

/// Channels of 32-bit words that are made while they are written, so that they never lie in memory whole.
struct WordRows {
  std::vector<std::string> names;  ///< sorted
  /// Fills words[(channel * lines + line) * width + x] for the lines from y on, of which there are 16 at most and y is
  /// a multiple of 16. Called from several threads.
  std::function<void(int y, int lines, uint32_t* words)> fill;
};

/// Writes float32 scan lines, ZIP, single part. The file appears whole or not at all.
/// @param task  only whether it is cancelled   @param rows  beside the layers' own words
/// @throws InputError; Interrupted
void write_exr(const std::filesystem::path& path, const Layers& layers, const Task& task = {},
               const WordRows& rows = {});

/// Threads that pack and unpack EXRs from now on; 0: all of the machine's. One until called.
void set_exr_threads(int threads);

}  // namespace brume
