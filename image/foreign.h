#pragma once
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "image/exr_io.h"
#include "image/layers.h"

// Frames of other renderers: which channel plays which part, and what their statistics mean. docs/frames.md has the
// tables.

namespace brume {

/// Three channels by their full names; all one name for a grey picture.
using ChannelTriple = std::array<std::string, 3>;

/// What a file calls variance. Brume's own is that of the pixel's mean.
enum class VarianceMeaning {
  kOfMean,
  kOfSamples,     ///< of one sample: the mean's times the sample count
  kSecondMoment,  ///< mean of the squared samples
  kUnstated,      ///< its pattern is known, its level is not
};

struct ForeignVariance {
  std::vector<std::string> channels;  ///< as many as their layer has
  VarianceMeaning meaning = VarianceMeaning::kOfMean;
  /// Of second moments of CIE XYZ: the means of X, Y and Z, from which red, green and blue follow, taken to err
  /// together.
  std::optional<ChannelTriple> xyz = {};
  bool of_surfaces = false;  ///< counts only samples that met a surface: 0 in a medium, whatever the noise
};

/// Light in a file of another renderer, with its statistics where there are any.
struct ForeignSignal {
  std::string name;  ///< as a user knows it
  ChannelTriple channels;
  std::optional<ForeignVariance> variance = {};
  std::optional<std::array<ChannelTriple, 2>> halves = {};
  std::optional<ChannelTriple> factor = {};  ///< what it is multiplied by before passes are added
  bool indirect = false;                     ///< light scattered more than once
  std::string group = {};                    ///< of a light: its light group
};

/// A layer that tells edges from noise.
struct ForeignFeature {
  LayerName layer;  ///< brume's name for it
  std::vector<std::string> channels;
  std::optional<ForeignVariance> variance = {};
};

/// One picture in a file of another renderer.
struct ForeignFrame {
  std::string renderer;  ///< "Blender Cycles multilayer"
  bool of_brume = false;
  bool cie_xyz = false;       ///< its channels are CIE XYZ: they are cleaned as red, green and blue (rgb_from_xyz)
  std::string view = {};      ///< its view layer, part or eye; may be empty
  bool one_of_views = false;  ///< another eye's layers may lie in the file, too
  ForeignSignal color = {};   ///< what is read
  ChannelTriple target = {};  ///< where its clean picture goes: the same channels, as a rule
  /// Other layers that are the picture by their names. Where they hold its very pixels they are given the clean ones,
  /// too; where not, nobody but the user knows which one is meant.
  std::vector<ChannelTriple> alike = {};
  /// Parts of it. What they leave of the picture is a part of its own. Those that follow one another with one factor
  /// are added before they are multiplied.
  std::vector<ForeignSignal> passes = {};
  /// Light of single groups of lights, which add up to it.
  std::vector<ForeignSignal> lights = {};
  std::string alpha = {};
  std::vector<ForeignFeature> features = {};
  std::string sample_count = {};  ///< channel with the samples of each pixel, or with their share of `samples`
  bool count_is_share = false;
  double samples = 0;                       ///< per pixel, from the header; 0: unknown
  std::vector<std::string> remarks = {};    ///< what a user should know
  std::vector<std::string> conflicts = {};  ///< parts that several layers could play

  /// Every channel that is read to clean it.
  std::vector<std::string> channels() const;
  /// "Blender Cycles multilayer 'ViewLayer'"
  std::string label() const;
};

/// Whether brume wrote a file: by its header, or by layers that only brume records.
bool is_brume_frame(const ExrInfo& file);

/// The pictures in a file: Blender Cycles multilayer, pbrt-v4 G-buffer film, Mitsuba 3 aov and moment, RenderMan,
/// Arnold, and otherwise colour with whatever has a common name, in each view (exr_views.h). Empty where no colour is
/// found.
std::vector<ForeignFrame> recognise(const ExrInfo& file);

/// Makes linear Rec. 709 of the planes of CIE XYZ, white staying as bright and of its colour, and back.
void rgb_from_xyz(const std::array<Plane*, 3>& planes);
void xyz_from_rgb(const std::array<Plane*, 3>& planes);

/// Gives a frame the signal as its beauty, with variance of the mean and halves where the file has them.

/// @return why statistics that the file has could not be used; empty where they could or there are none
std::string adopt_signal(const ForeignFrame& picture, const ForeignSignal& signal, const Layers& file, Layers& frame);

/// Gives a frame the features and sample counts of a picture. A depth of 1e9 and more, as
/// renderers write where they meet nothing, becomes 0.
void adopt_features(const ForeignFrame& picture, const Layers& file, Layers& frame);

/// What the file has, for a user whose picture is not recognised: "RGBA of part C, ...", shortened where it is much.
std::string channels_text(const ExrInfo& file);

/// Gives a frame that has no channels R, G, B those of its first picture, and `indirect` and `direct`, which is the
/// rest, where its passes tell them apart. All other channels are left as they are.
/// @return one line saying what was recognised; empty when nothing was
/// @param file  what it was read from, where that is known: parts and views
std::string adopt_foreign_layers(Layers& layers, const ExrInfo* file = nullptr);

}  // namespace brume
