#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "base/vec.h"
#include "image/layers.h"
#include "render/guides/deep_fit.h"

namespace brume {

/// What a march sees of media along a ray, step by step: for deep pictures. Lengths as the march counts them.
struct DeepSteps {
  struct Step {
    float begin, end;
    float left;     ///< transmittance up to its end
    float w = 0;    ///< transmittance that it takes: guides' w (docs/guides.md)
    vec3 light{0};  ///< predicted, that it sends to the eye
  };
  static constexpr float kThinStep = 0.01f;  ///< opacity of steps that are joined
  std::vector<Step> steps;
  size_t unlit = 0;  ///< steps from here on have got no scattered light yet

  void clear() {
    steps.clear();
    unlit = 0;
  }
  /// Adds a step, or makes the last one longer where both together take next to nothing.
  void add(float begin, float end, float w, float left) {
    if (steps.size() > unlit) {
      Step& last = steps.back();
      if (last.end == begin && last.w + w < kThinStep) {
        last.end = end;
        last.w += w;
        last.left = left;
        return;
      }
    }
    steps.push_back({begin, end, left, w});
  }
  /// Gives light to the steps up to a place in proportion to what they take. @param w  what they take together
  void light_up(float end, float w, const vec3& light);
};

/// A camera ray of a deep pixel: the media on its way, and what ends it.
struct DeepRay {
  DeepSteps media;
  double z = 0, z_per_step = 0;  ///< from lengths of steps to depths
  float left = 1;                ///< what the media leave to be covered by what is behind them
  float held = 0;                ///< share that holdouts among them hide of that
  enum class End { kNothing, kSurface, kLight };
  End end = End::kNothing;  ///< light that is seen covers nothing; nor does a holdout
  double end_z = 0;
  uint32_t surface = 0;  ///< its number
  vec3 light{0};         ///< predicted, that the end sends to the eye
  float mirrors = 0;     ///< transmittance to a surface whose mirrored light is not in `light`

  /// Clears it and keeps its memory.
  void begin() {
    DeepSteps kept = std::move(media);
    kept.clear();
    *this = {};
    media = std::move(kept);
  }
};

/// A sample of a deep pixel as guides know it. Of a point z_back is z.
struct DeepPart {
  float z, z_back;
  float left;  ///< mean transmittance of the pixel behind it, and of all before it
  vec3 light;  ///< predicted, that it sends to the eye
};

/// Where light is that comes from infinitely far [scene units].
inline constexpr float kDeepBackground = 1e10f;

/// Makes deep pixels; keeps its memory from one to the next.
class DeepPixels {
 public:
  /// The fewest parts that show the mean transmittance and light of a pixel's rays along its depth within a bound, or
  /// as near as `most` of them can: surfaces as points, media as volumes, each equally dense from end to end. Tidy.
  /// Light from infinitely far is one more.
  /// @param mirrored  light that the mirrors on all of its rays send to the eye
  std::vector<DeepPart> of_rays(std::span<const DeepRay> rays, const vec3& mirrored, size_t most);
  /// The same of several pixels' parts: of one pixel in red, green and blue.
  std::vector<DeepPart> mean(std::span<const std::vector<DeepPart>> pixels, size_t most);

 private:
  /// What ends rays at nearly the same depth.
  struct Hit {
    double z;
    size_t ray, count;
  };

  void join_hits(std::span<const DeepRay> rays, size_t most);
  void make_knots(std::span<const std::vector<DeepPart>> pixels, size_t most);
  void add_up(std::span<const std::vector<DeepPart>> pixels);

  std::vector<std::vector<DeepPart>> profiles_;
  std::vector<Hit> hits_;
  std::vector<std::pair<float, bool>> places_;  // depths of knots; whether a knot lies behind what is at its depth
  std::vector<DeepKnot> knots_;
  DeepFit fit_;
};

/// The parts of all pixels of a picture, as its guides are marched. Of chromatic media each colour's are kept apart.
class DeepRecord {
 public:
  DeepRecord(const ivec2& corner, const ivec2& size, size_t most);

  /// Parts of a pixel that are kept: more of each colour than of all together.
  size_t most(int colour) const { return colour < 0 ? most_ : 2 * most_; }
  /// Before a colour's pixels are stored.
  void prepare(int colour);
  /// Of a pixel of the whole picture, from any thread. @param colour  GuideColour
  void store(const ivec2& pixel, int colour, std::vector<DeepPart> parts);
  /// Of a pixel of the window, all colours together.
  std::vector<DeepPart> parts(const ivec2& pixel) const;

 private:
  size_t index(const ivec2& pixel) const { return static_cast<size_t>(pixel.y) * size_.x + pixel.x; }

  ivec2 corner_, size_;
  size_t most_;
  std::array<std::vector<std::vector<DeepPart>>, 3> pixels_;  // by colour; grey is the first
};

}  // namespace brume
