#pragma once
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "app/command.h"
#include "filters/run/clean_picture.h"

namespace brume::app {

/// How a file is given back as it came: --keep-file, --suffix, --map, --samples, --guides.
struct KeepOptions {
  bool keep = false;
  std::string suffix, map, guides;
  int samples = 0;

  void add_to(CLI::App& command);
  bool asked() const { return keep || !suffix.empty() || !map.empty(); }
};

/// The pictures that a mapping file names in an EXR. @throws InputError with the line underlined
std::vector<ForeignFrame> read_map(const std::string& path, const ExrInfo& file);

/// A file of the sequence beside the one that is cleaned.
struct KeptNeighbour {
  int distance;
  std::string path, guides;  ///< no guides: empty
  RecordReader* records;     ///< null: none
  bool optional;             ///< left out, with a warning, where it cannot be used
};

/// A file that is cleaned where it stands: everything in it is kept, what is cleaned is replaced or stands beside.
class KeptFile {
 public:
  /// Nothing for a file that is to be written as brume writes its own. @throws InputError
  static std::optional<KeptFile> open(const std::string& path, const KeepOptions& options);

  /// The frame, of one pixel, that filters will be given for the signal of which the file says least.
  Layers outline() const;

  /// As what_speaks_against_guides: of the first picture that they do not suit; empty without guides.
  std::string what_speaks_against_guides(const Task& task) const;

  /// Cleans all pictures and writes the file again.
  /// @param attributes  to write beside the filter's
  /// @param preview  where to leave the first picture, clean, as R, G, B; null: nobody wants it
  void clean(const Common& common, const FilterSettings& filter, const ApplyOptions& options,
             const std::vector<KeptNeighbour>& others, const std::map<std::string, Attribute>& attributes,
             const std::string& output, Layers* preview) const;

 private:
  KeptFile(std::string path, ExrInfo info, KeepOptions options, std::vector<ForeignFrame> pictures)
      : path_(std::move(path)), info_(std::move(info)), options_(std::move(options)), pictures_(std::move(pictures)) {}
  /// A frame of one pixel with the file's channels.
  Layers channel_names() const;
  /// One line on what was done with a picture.
  std::string told(const ForeignFrame& picture, const FilterSettings& filter, const CleanPicture& result) const;

  std::string path_;
  ExrInfo info_;
  KeepOptions options_;
  std::vector<ForeignFrame> pictures_;
};

}  // namespace brume::app
