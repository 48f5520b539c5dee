#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "evaluate/metrics/temporal.h"
#include "evaluate/report/contact_sheet.h"
#include "workflows/comparison.h"

namespace brume {

/// What is compared of a picture and its reference, and how they are seen.
struct CompareOptions {
  std::string layer;                ///< empty: the beauty
  bool each_layer = false;          ///< also every layer of three colours that both have
  std::string exposure = "header";  ///< as choose_exposure takes it, of the reference
  bool clip = true;                 ///< to [0, 1] before CIE-Lab
};

/// How a picture differs from its reference.
struct ComparisonReport {
  struct Layer {
    std::string name;
    std::vector<Errors> regions;  ///< the whole picture and, where it is known, the medium
  };
  std::string picture, reference;  ///< names
  std::string policy;              ///< in words
  PixelWindow window, display;
  bool two_references = false;  ///< whose noise was taken off
  std::vector<Layer> layers;    ///< the one asked for first

  bool has_medium() const { return layers.front().regions.size() > 1; }
  /// As `brume compare --json` prints it.
  std::string json() const;
};

/// @throws InputError: as Comparison, and for a layer that one of them has not; Interrupted
ComparisonReport compare_frames(NamedFrame picture, NamedFrame reference, std::optional<NamedFrame> second,
                                const CompareOptions& options, const Host& host);

/// How a sequence errs, and how much it flickers beyond its reference: frame after frame, two of them in memory.
class SequenceComparison {
 public:
  /// @param options  without layers   @param sheet  a PNG of some of the frames; empty: none   @throws InputError
  SequenceComparison(const CompareOptions& options, std::filesystem::path sheet, std::vector<int> frames);

  /// The next frame. @return its errors over the whole picture
  /// @throws InputError: as Comparison, and for another size than the frame before; Interrupted
  const Errors& add(NamedFrame picture, NamedFrame reference, std::optional<NamedFrame> second, const Host& host);

  struct Region {
    std::vector<double> lab_rms;  ///< of each frame
    double mean_lab_rms;          ///< root of the mean of their squares
    std::optional<TemporalError::Result> temporal;
  };
  Region whole() const { return region(*whole_); }
  /// Nothing where some reference does not tell where the medium is.
  std::optional<Region> medium() const;
  const std::vector<int>& frames() const { return frames_; }
  const std::string& policy() const { return policy_text_; }
  bool two_references() const { return two_references_; }
  /// Writes the sheet, where one is wanted.
  void finish() const;
  /// As `brume compare --frames --json` prints it.
  std::string json(const std::string& picture, const std::string& reference) const;

 private:
  struct Sums {
    std::vector<double> lab_rms;
    TemporalError temporal;
    explicit Sums(const LabPolicy& policy) : temporal(policy) {}
  };
  static Region region(const Sums& sums);

  const CompareOptions options_;
  const std::filesystem::path sheet_path_;
  const std::vector<int> frames_;
  size_t added_ = 0;
  ivec2 size_{0};
  std::optional<LabPolicy> policy_;
  std::string policy_text_;
  bool two_references_ = false;
  std::vector<Errors> errors_;  // of the last frame
  std::optional<Sums> whole_, medium_;
  mutable std::optional<ContactSheet> sheet_;
};

}  // namespace brume
